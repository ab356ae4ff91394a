"""Verdicts on eight chips of one board, in two recordings: ``python -m bench.array``.

The chips are of one kind, and lay on one board in both recordings (data/README.md), which
IMULOOP_MIRROR names the folder of. What is a chip's own shows in both. The shaking that follows
the rests is cut: the diagnosis is of poses.
"""

import json
import os
import tempfile
from multiprocessing import Pool
from pathlib import Path

from imuloop import chain
from imuloop.chain import Device

RECORDINGS, CHIPS = ("exp_1", "exp_5"), range(1, 9)
# counts of the chip: 2048 per g, 16.4 per deg/s
NOMINAL = {"acceleration": {"scale": 0.0047884}, "angular_rate": {"scale": 0.001064225}}
# gravity where they were recorded, m/s^2
GRAVITY = 9.818
SENSORS = ("accelerometer", "gyroscope")


def ingested(recording, chip, folder):
    """Ingest a chip of a recording into a folder and return the `Device`."""
    (path,) = Path(os.environ["IMULOOP_MIRROR"]).rglob(f"{recording}.parquet")
    columns = {"time": "t_us"} | {
        quantity: [f"{letter}{axis}{chip}" for axis in "xyz"]
        for quantity, letter in (("acceleration", "a"), ("angular_rate", "g"))
    }
    declared = {
        "columns": columns,
        "units": {"time": "us", "acceleration": "count", "angular_rate": "count"},
    }
    kinds = {"poses": "multi_position"}
    device = Device(f"chip_{chip}", Path(folder), kinds, gravity=GRAVITY, nominal=NOMINAL)
    if failures := chain.ingest(device, "poses", declared, [path]):
        raise RuntimeError(str(failures[0]))
    return device


def diagnosed(job):
    """Return the diagnosis of both sensors at the poses of a chip in a recording."""
    with tempfile.TemporaryDirectory() as folder:
        device, failures = ingested(*job, folder), []
        for stage in (chain.segment, chain.noise, chain.calibrate, chain.diagnose):
            failures += stage(device)
        if failures:
            raise RuntimeError(str(failures[0]))
        sensors = json.loads(device.file("diagnosis.json").read_text())["sensors"]
    return {sensor: sensors[sensor]["poses"] for sensor in SENSORS}


def words(part):
    """Return held-out errors over floor, the verdict where it is not consistent, and effects."""
    words = [f"{r['after'] / r['floor']:.2f}" for r in part["residuals"].values()]
    words += [part["verdict"]] * (part["verdict"] != "consistent")
    return ", ".join([*words, *(f"`{e['name']}`" for e in part["effects"])])


def main():
    """Print a table of the chips, both recordings beside each other."""
    jobs = [(recording, chip) for chip in CHIPS for recording in RECORDINGS]
    with Pool(2) as pool:
        found = dict(zip(jobs, pool.map(diagnosed, jobs, chunksize=1), strict=True))
    heads = [f"{sensor}, `{recording}`" for sensor in SENSORS for recording in RECORDINGS]
    print("| chip | " + " | ".join(heads) + " |")
    print("|---|" + "---|" * len(heads))
    for chip in CHIPS:
        cells = [words(found[recording, chip][s]) for s in SENSORS for recording in RECORDINGS]
        print(f"| {chip} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
