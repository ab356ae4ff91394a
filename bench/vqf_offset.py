"""What an offset in time found by imuloop is worth to a filter of others, on trials it never saw.

From the repository, its library on the path: ``python -m bench.vqf_offset DIAGNOSIS`` with the
diagnosis.json of ``config/reference.yaml``. BROAD ranks orientation filters by motion capture
(Laidig et al., Data 6 (7), 72, 2021). The filter is VQF with the settings of its authors, from
gyroscope, accelerometer and magnetometer; the error is BROAD's own, of the inclination.
"""

import os
import sys
from pathlib import Path

import numpy as np
import pooch
import yaml
from scipy.io import loadmat
from scipy.spatial.transform import Rotation, Slerp
from vqf import VQF

from bench.tables import REPOSITORY, publish, table
from imuloop.core.files import read_json

# none of those that the offset is found on
TRIALS = (
    "01_undisturbed_slow_rotation_A", "05_undisturbed_slow_rotation_with_breaks_B",
    "06_undisturbed_fast_rotation_A", "10_undisturbed_slow_translation_A",
    "18_undisturbed_fast_translation_with_breaks_B", "24_disturbed_tapping_A",
    "28_disturbed_stationary_magnet_A", "31_disturbed_stationary_magnet_D",
)  # fmt: skip
COLUMNS = "as published", "offset", "offset and half a period", "opposite"
HEAD = """The gyroscope's offset, found on three trials of BROAD that are not below: {ms:.2f} ms.
Error of VQF's inclination in the moving part of each trial, root mean square, °: by the reference
as published; read at the stamps plus the offset; also half a period later, by which this filter is
ahead of its samples; and, as a control, with the offset's sign reversed.

"""


def main():
    """Publish the errors of all trials by the offset in a diagnosis.json."""
    dt = offset(read_json(sys.argv[1]))
    config = yaml.safe_load((REPOSITORY / "config/reference.yaml").read_text())
    sessions = config["devices"]["broad"]["sessions"]
    place = sessions["trial_03"]["file"]["url"].rpartition("/")[0]
    errors = [before_and_after(loadmat(at_hand(f"{place}/{name}.mat")), dt) for name in TRIALS]
    named = zip((*TRIALS, "mean"), (*errors, np.mean(errors, axis=0)), strict=True)
    rows = [(name, *(f"{error:.3f}" for error in row)) for name, row in named]
    text = HEAD.format(ms=1e3 * dt) + table(("trial", *COLUMNS), rows)
    publish("vqf", "VQF by motion capture, with an offset in time", text)


def offset(diagnosis):
    """Return the offset of the gyroscope's stamps that was found by the reference, s."""
    effects = diagnosis["sensors"]["gyroscope"]["reference"]["effects"]
    return next(e["parameters"]["dt"] for e in effects if e["name"] == "time_offset")


def at_hand(url):
    """Return the file of a trial, from the mirror or its address."""
    name, mirror = url.rpartition("/")[2], os.environ.get("IMULOOP_MIRROR")
    if files := sorted(Path(mirror).rglob(name)) if mirror else []:
        return files[0]
    # no hash: the commit in the address says which file it is
    return pooch.retrieve(url, None, name, REPOSITORY / "data/cache/broad")


def before_and_after(trial, dt):
    """Return the filter's error by the reference as it is, and read at the stamps plus shifts, °.

    The filter turns by each sample over the whole period before its stamp. imuloop takes the rate
    as sampled at the stamps; so the estimate of the filter is half a period ahead.
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
    moving = trial["movement"].ravel().astype(bool) & whole
    return [inclination(estimated[moving], reference(t[moving] + shift)) for shift in shifts]


def inclination(estimated, reference):
    """Return the root-mean-square error of the inclination, °, as BROAD's repository defines it."""
    w, _, _, z = (estimated * reference.inv()).as_quat(scalar_first=True).T
    error = 2 * np.arccos(np.clip(np.hypot(w, z), 0, 1))
    return np.rad2deg(np.sqrt(np.mean(error**2)))


if __name__ == "__main__":
    main()
