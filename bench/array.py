"""Verdicts on the eight chips of an array, in two recordings: ``python -m bench.array``.

Each chip is a device of its own. IMULOOP_MIRROR names the folder of the recordings
(data/README.md). What is a chip's own shows in both.
"""

import os
import tempfile
from functools import partial
from itertools import product
from multiprocessing import Pool
from pathlib import Path

from bench.study.chain import through
from imuloop import chain
from imuloop.chain import Device
from imuloop.core.files import read_json

RECORDINGS, CHIPS = ("exp_1", "exp_5"), range(1, 9)
# counts of the chip: 2048 per g, 16.4 per deg/s; 16 g and 2000 deg/s
NOMINAL = {"acceleration": {"scale": 0.0047884}, "angular_rate": {"scale": 0.001064225}}
FULL_SCALE = {"acceleration": 156.9, "angular_rate": 34.87}
# gravity where they were recorded, m/s^2
GRAVITY = 9.818


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
    (log,) = Path(os.environ["IMULOOP_MIRROR"]).rglob(f"{recording}.parquet")
    chain.ingest(device, "poses", {"columns": columns, "units": units}, [log])
    return device


def diagnosed(folder, job):
    """Return the Device of a chip in a recording, diagnosed, its results in a folder."""
    recording, chip = job
    device = ingested(recording, chip, Path(folder) / recording / f"chip_{chip}")
    through(device)
    return device


def main():
    """Print the verdicts on the chips, in each recording."""
    jobs = list(product(RECORDINGS, CHIPS))
    with tempfile.TemporaryDirectory() as folder, Pool(2) as pool:
        devices = pool.imap(partial(diagnosed, folder), jobs)
        for (recording, _), device in zip(jobs, devices, strict=True):
            for sensor, parts in read_json(device.file("diagnosis.json"))["sensors"].items():
                for record, part in parts.items():
                    of = recording, device.name, sensor, record
                    print(*of, part["verdict"], *(effect["name"] for effect in part["effects"]))


if __name__ == "__main__":
    main()
