"""Verdicts on eight chips of one board, in two recordings: ``python -m bench.array``.

The chips are of one kind, and lay on one board in both recordings (data/README.md), which
IMULOOP_MIRROR names the folder of. What is a chip's own shows in both. The shaking that follows
the rests is cut by the diagnosis, which is of poses; it shows best how far the chips are apart.
"""

import json
import os
import tempfile
from functools import partial
from multiprocessing import Pool
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from imuloop import chain
from imuloop.chain import Device

RECORDINGS, CHIPS = ("exp_1", "exp_5"), range(1, 9)
# counts of the chip: 2048 per g, 16.4 per deg/s; 16 g and 2000 deg/s
NOMINAL = {"acceleration": {"scale": 0.0047884}, "angular_rate": {"scale": 0.001064225}}
FULL_SCALE = {"acceleration": 156.9, "angular_rate": 34.87}
# gravity where they were recorded, m/s^2
GRAVITY = 9.818
SENSORS = ("accelerometer", "gyroscope")


def recorded(name):
    """Return the path of a file of the recordings."""
    (path,) = Path(os.environ["IMULOOP_MIRROR"]).rglob(name)
    return path


def ingested(recording, chip, folder):
    """Ingest a chip of a recording into a folder and return the `Device`."""
    columns = {"time": "t_us"} | {
        quantity: [f"{letter}{axis}{chip}" for axis in "xyz"]
        for quantity, letter in (("acceleration", "a"), ("angular_rate", "g"))
    }
    declared = {
        "columns": columns,
        "units": {"time": "us", "acceleration": "count", "angular_rate": "count"},
    }
    settings = {"gravity": GRAVITY, "nominal": NOMINAL, "full_scale": FULL_SCALE}
    device = Device(f"chip_{chip}", Path(folder), {"poses": "multi_position"}, **settings)
    paths = [recorded(f"{recording}.parquet")]
    if failures := chain.ingest(device, "poses", declared, paths):
        raise RuntimeError(str(failures[0]))
    return device


def calibrated(folder, recording, chip):
    """Return the Device of a chip in a recording, its results up to the calibration in a folder."""
    device = ingested(recording, chip, Path(folder) / recording / f"chip_{chip}")
    failures = [
        failure for s in (chain.segment, chain.noise, chain.calibrate) for failure in s(device)
    ]
    if failures:
        raise RuntimeError(str(failures[0]))
    return device


def diagnosed(folder, job):
    """Return the Device of a chip in a recording, and the diagnosis of its poses by sensor."""
    device = calibrated(folder, *job)
    if failures := chain.diagnose(device):
        raise RuntimeError(str(failures[0]))
    sensors = json.loads(device.file("diagnosis.json").read_text())["sensors"]
    return device, {sensor: sensors[sensor]["poses"] for sensor in SENSORS}


def related(folder, devices):
    """Return board.json of chips in one recording."""
    board = Device("array", Path(folder), {})
    if failures := chain.board(board, devices):
        raise RuntimeError(str(failures[0]))
    return json.loads(board.file("board.json").read_text())


def places(content):
    """Return places, σ and the nominal places of all chips but the first, beside it, m, (7, 3).

    The nominal ones on the axes of the first chip, which is not square to the board: turned by what
    brings them nearest.
    """
    drawn = pd.read_csv(recorded("IMU_positions.csv"), index_col=0).to_numpy().T
    found = content["devices"].values()
    arms, std = (np.array([d[name] for d in found])[1:] for name in ("arm", "arm_std"))
    nominal = (drawn - drawn[0])[1:]
    return arms, std, Rotation.align_vectors(arms, nominal)[0].apply(nominal)


def words(part):
    """Return held-out errors over floor, the verdict where it is not consistent, and effects."""
    words = [f"{r['after'] / r['floor']:.2f}" for r in part["residuals"].values()]
    words += [part["verdict"]] * (part["verdict"] != "consistent")
    return ", ".join([*words, *(f"`{e['name']}`" for e in part["effects"])])


def size(test):
    """Return error over noise, and the verdict where it is not consistent."""
    words = [f"{test['error'] / test['floor']:.2f}"]
    return ", ".join(words + [test["verdict"]] * (test["verdict"] != "consistent"))


def main():
    """Print a table of the chips, both recordings beside each other, and one of the board."""
    jobs = [(recording, chip) for chip in CHIPS for recording in RECORDINGS]
    with tempfile.TemporaryDirectory() as folder:
        with Pool(2) as pool:
            results = pool.map(partial(diagnosed, folder), jobs, chunksize=1)
        found = dict(zip(jobs, results, strict=True))
        boards = {
            recording: related(folder, [found[recording, chip][0] for chip in CHIPS])
            for recording in RECORDINGS
        }
    heads = [f"{sensor}, `{recording}`" for sensor in SENSORS for recording in RECORDINGS]
    print("| chip | " + " | ".join(heads) + " |")
    print("|---|" + "---|" * len(heads))
    for chip in CHIPS:
        cells = [words(found[recording, chip][1][s]) for s in SENSORS for recording in RECORDINGS]
        print(f"| {chip} | " + " | ".join(cells) + " |")
    kinds = {"turn": "own turn", "gravity_norm": "own gravity"}
    heads = [f"{words}, `{r}`" for words in ("place, mm", *kinds.values()) for r in RECORDINGS]
    print("\n| chip | " + " | ".join(heads) + " |")
    print("|---|" + "---|" * len(heads))
    for chip in CHIPS:
        entries = [boards[recording]["devices"][f"chip_{chip}"] for recording in RECORDINGS]
        cells = [", ".join(f"{1e3 * x:.2f}" for x in entry["arm"]) for entry in entries]
        cells += [size(entry[kind]) for kind in kinds for entry in entries]
        print(f"| {chip} | " + " | ".join(cells) + " |")
    for recording, content in boards.items():
        arms, std, nominal = places(content)
        apart = 1e3 * np.sqrt(((arms - nominal) ** 2).sum(axis=1).mean())
        print(f"\n{recording}: places from nominal {apart:.3f} mm rms, σ {1e3 * std.mean():.2f} mm")
        for kind, test in content["common"].items():
            print(f"{recording}: common {kind} {test['error']:.3g}, noise {test['floor']:.3g}")


if __name__ == "__main__":
    main()
