"""What an offset in time found by imuloop is worth to a filter of others, on trials it never saw.

From the repository, its library on the path: ``python -m bench.vqf_offset DIAGNOSIS`` with the
diagnosis.json of ``config/reference.yaml``. BROAD ranks orientation filters beside motion capture
(Laidig et al., Data 6 (7), 72, 2021). The filter is VQF with the settings of its authors, from
gyroscope, accelerometer and magnetometer; the error is BROAD's own, of the inclination.
"""

import argparse
import os
import sys
from pathlib import Path, PurePosixPath

import numpy as np
import pooch
import requests
import yaml
from scipy.io import loadmat
from scipy.spatial.transform import Rotation, Slerp
from vqf import VQF

from bench.tables import REPOSITORY, publish, table
from imuloop.core.files import read_json

KINDS = {
    "undisturbed": "slow_rotation_A slow_rotation_B slow_rotation_C slow_rotation_with_breaks_A "
    "slow_rotation_with_breaks_B fast_rotation_A fast_rotation_B fast_rotation_with_breaks_A "
    "fast_rotation_with_breaks_B slow_translation_A slow_translation_B slow_translation_C "
    "slow_translation_with_breaks_A slow_translation_with_breaks_B fast_translation_A "
    "fast_translation_B fast_translation_with_breaks_A fast_translation_with_breaks_B "
    "slow_combined_240s slow_combined_360s fast_combined fast_combined_240s fast_combined_360s",
    "disturbed": "tapping_A tapping_B phone_vibration_A phone_vibration_B stationary_magnet_A "
    "stationary_magnet_B stationary_magnet_C stationary_magnet_D attached_magnet_1cm "
    "attached_magnet_2cm attached_magnet_3cm attached_magnet_4cm attached_magnet_5cm office_A "
    "office_B mixed",
}
_NAMES = [f"{group}_{kind}" for group, kinds in KINDS.items() for kind in kinds.split()]
# all 39, as their files are named
TRIALS = [f"{number:02}_{name}" for number, name in enumerate(_NAMES, 1)]
COLUMNS = "as published", "offset", "offset and half a period", "opposite"
HEAD = """The gyroscope's offset, found on three trials of BROAD that are not below: {ms:.2f} ms.
Error of VQF's inclination in the moving part of each trial, root mean square, °: by the reference
as published; read at the stamps plus the offset; also half a period later, by which this filter is
ahead of its samples; and, as a control, with the offset's sign reversed.

"""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("diagnosis", type=Path, help="diagnosis.json of config/reference.yaml")
    dt = offset(read_json(parser.parse_args().diagnosis))
    config = yaml.safe_load((REPOSITORY / "config/reference.yaml").read_text())
    seen = [each["file"]["url"] for each in config["devices"]["broad"]["sessions"].values()]
    urls = [f"{seen[0].rpartition('/')[0]}/{name}.mat" for name in TRIALS]
    paths = {PurePosixPath(url).stem: at_hand(url) for url in urls if url not in seen}
    missing = [name[:2] for name, path in paths.items() if not path]
    errors = {name: before_and_after(loadmat(path), dt) for name, path in paths.items() if path}
    if not errors:
        sys.exit("no trial is in the folder IMULOOP_MIRROR, nor can one be fetched")
    publish("vqf", "VQF beside motion capture, with an offset in time", report(dt, errors, missing))


def offset(diagnosis):
    """Return the offset of the gyroscope's stamps that was found beside the reference, s."""
    effects = diagnosis["sensors"]["gyroscope"]["reference"]["effects"]
    for effect in effects:
        if effect["name"] == "time_offset":
            return effect["parameters"]["dt"]
    sys.exit("no offset in time of the gyroscope was found")


def at_hand(url):
    """Return the file of a trial, from the mirror or its address; None where it is in neither."""
    name, mirror = url.rpartition("/")[2], os.environ.get("IMULOOP_MIRROR")
    if found := sorted(Path(mirror).rglob(name)) if mirror else []:
        return found[0]
    pooch.get_logger().setLevel("WARNING")
    try:
        # no hash: the commit in the address says which file it is
        return pooch.retrieve(url, None, name, REPOSITORY / "data/cache/broad")
    except requests.RequestException:
        return None


def before_and_after(trial, dt):
    """Return the filter's error by the reference as it is, and read at the stamps plus shifts, °.

    The filter turns by each sample over the whole period before its stamp: beside a rate that is
    sampled at the stamps, as imuloop takes it, its estimate is half a period ahead.
    """
    period = 1 / trial["sampling_rate"].item()
    imu = [np.ascontiguousarray(trial[f"imu_{name}"]) for name in ("gyr", "acc", "mag")]
    estimated = Rotation.from_quat(VQF(period).updateBatch(*imu)["quat9D"], scalar_first=True)
    seen = np.isfinite(trial["opt_quat"]).all(axis=1)
    t = period * np.arange(len(seen))
    reference = Slerp(t[seen], Rotation.from_quat(trial["opt_quat"][seen], scalar_first=True))
    shifts = 0.0, dt, dt + period / 2, -dt
    # the same samples for all, and no gap is bridged
    reach = int(np.ceil(np.abs(shifts).max() / period))
    whole = np.convolve(seen, np.ones(2 * reach + 1), "same") == 2 * reach + 1
    judged = trial["movement"].ravel().astype(bool) & whole
    return [inclination(estimated[judged], reference(t[judged] + shift)) for shift in shifts]


def inclination(estimated, reference):
    """Return the root-mean-square error of the inclination, °: that of BROAD's repository."""
    w, _, _, z = (estimated * reference.inv()).as_quat(scalar_first=True).T
    error = 2 * np.arccos(np.clip(np.hypot(w, z), 0, 1))
    return np.rad2deg(np.sqrt(np.mean(error**2)))


def report(dt, errors, missing):
    """Return the table of all trials in Markdown; names the worse ones and the missing ones."""
    found = np.array([*errors.values()])
    rows = [[name, *(f"{x:.3f}" for x in row)] for name, row in zip(errors, found, strict=True)]
    rows.append(["mean", *(f"{x:.3f}" for x in found.mean(axis=0))])
    lines = [table(("trial", *COLUMNS), rows) + "\n"]
    for column, after in zip(COLUMNS[1:3], found.T[1:3], strict=True):
        worse = [name for name, more in zip(errors, after > found[:, 0], strict=True) if more]
        better = f"{len(errors) - len(worse)} of {len(errors)}"
        lines.append(f"{column}: better in {better}; worse: {', '.join(worse) or 'none'}.")
    lines.append(f"Neither at hand nor to be fetched: {len(missing)} ({' '.join(missing)}).")
    return HEAD.format(ms=1e3 * dt) + "\n".join(lines)


if __name__ == "__main__":
    main()
