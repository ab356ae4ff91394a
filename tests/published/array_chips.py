"""The eight chips of an array, in two recordings; errors of a single chip show in both."""

import os
from pathlib import Path

from imuloop import chain
from imuloop.chain import Device

RECORDINGS = "exp_1", "exp_5"
# counts of the chip: 2048 per g, 16.4 per deg/s; 16 g and 2000 deg/s
NOMINAL = {"acceleration": {"scale": 0.0047884}, "angular_rate": {"scale": 0.001064225}}
FULL_SCALE = {"acceleration": 156.9, "angular_rate": 34.87}
# gravity where they were recorded, m/s^2
GRAVITY = 9.818


def ingest_chip(recording, chip, folder):
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
