"""Verdicts on eight chips of one board, in two recordings: ``python -m bench.array``.

The chips are of one kind, and lay on one board in both recordings (data/README.md), which
IMULOOP_MIRROR names the folder of. What is a chip's own shows in both. The shaking that follows
the rests is cut by the diagnosis, which is of poses; it shows best how far the chips are apart.
"""

import os
import tempfile
from functools import partial
from multiprocessing import Pool
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from bench.study.chain import sound, through
from imuloop import chain
from imuloop.chain import Device
from imuloop.core.files import read_json
from imuloop.discover.family import discover_type

RECORDINGS, CHIPS = ("exp_1", "exp_5"), range(1, 9)
# counts of the chip: 2048 per g, 16.4 per deg/s; 16 g and 2000 deg/s
NOMINAL = {"acceleration": {"scale": 0.0047884}, "angular_rate": {"scale": 0.001064225}}
FULL_SCALE = {"acceleration": 156.9, "angular_rate": 34.87}
# gravity where they were recorded, m/s^2
GRAVITY = 9.818


def recorded(name):
    """Return the path of a file of the recordings."""
    (path,) = Path(os.environ["IMULOOP_MIRROR"]).rglob(name)
    return path


def ingested(recording, chip, folder):
    """Ingest a chip of a recording into a folder and return the `Device`."""
    columns = {
        "time": "t_us",
        "acceleration": [f"a{axis}{chip}" for axis in "xyz"],
        "angular_rate": [f"g{axis}{chip}" for axis in "xyz"],
    }
    units = {"time": "us", "acceleration": "count", "angular_rate": "count"}
    settings = {"gravity": GRAVITY, "nominal": NOMINAL, "full_scale": FULL_SCALE}
    device = Device(f"chip_{chip}", Path(folder), {"poses": "multi_position"}, **settings)
    declared, log = {"columns": columns, "units": units}, recorded(f"{recording}.parquet")
    sound(chain.ingest(device, "poses", declared, [log]))
    return device


def calibrated(folder, recording, chip):
    """Return the Device of a chip in a recording, its results up to the calibration in a folder."""
    device = ingested(recording, chip, Path(folder) / recording / f"chip_{chip}")
    through(device, (chain.segment, chain.noise, chain.calibrate))
    return device


def diagnosed(folder, job):
    """Return the Device of a chip in a recording, diagnosed."""
    device = calibrated(folder, *job)
    sound(chain.diagnose(device))
    return device


def related(folder, devices):
    """Return board.json of chips in one recording."""
    board = Device("array", Path(folder), {})
    sound(chain.board(board, devices))
    return read_json(board.file("board.json"))


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


def main():
    """Print the verdicts on the chips, and what their board shows, of each recording."""
    with tempfile.TemporaryDirectory() as folder:
        for recording in RECORDINGS:
            with Pool(2) as pool:
                jobs = [(recording, chip) for chip in CHIPS]
                devices = pool.map(partial(diagnosed, folder), jobs, chunksize=1)
            for device in devices:
                for sensor, parts in read_json(device.file("diagnosis.json"))["sensors"].items():
                    for record, part in parts.items():
                        of = recording, device.name, sensor, record
                        print(*of, part["verdict"], *(effect["name"] for effect in part["effects"]))
                        if search := part.get("discovered"):
                            found = (search[k] for k in ("status", "searched", "chance", "formula"))
                            print(*of, "beyond the library:", *found)
            for sensor, joint in discover_type("array", devices)["sensors"].items():
                ratios = [
                    min(kind["ratio"] for kind in each["residuals"].values())
                    for each in joint["devices"].values()
                    if each["has"]
                ]
                found = (joint[k] for k in ("status", "searched", "chance", "formula"))
                print(recording, sensor, "jointly:", *found, *(f"{r:.2f}" for r in ratios))
            content = related(folder, devices)
            arms, std, nominal = places(content)
            apart = 1e3 * np.sqrt(((arms - nominal) ** 2).sum(axis=1).mean())
            print(f"{recording}: places off {apart:.3f} mm rms, σ {1e3 * std.mean():.2f} mm")
            for kind, test in content["common"].items():
                print(f"{recording}: common {kind} {test['error']:.3g}, noise {test['floor']:.3g}")


if __name__ == "__main__":
    main()
