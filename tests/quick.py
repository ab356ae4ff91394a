"""Results without what takes longest and no verdict hangs on: limits, attitude, pictures."""

from contextlib import contextmanager
from unittest.mock import patch

from bench.study.chain import ATTITUDE, LIMITS, run_stages
from imuloop import chain
from imuloop.core.files import read_json
from imuloop.validate.attitude import no_attitude

# what every picture of a report is drawn by
DRAW = "matplotlib.backends.backend_svg.FigureCanvasSVG.print_svg"


@contextmanager
def hurry(name):
    """Leave out detection limits, and the attitude of the device of that name."""
    attitude = no_attitude(name, "not asked for")
    with patch(LIMITS, return_value={}), patch(ATTITUDE, return_value=attitude):
        yield


def verdicts(device):
    with hurry(device.name):
        run_stages(device)
    return read_json(device.file("diagnosis.json"))["sensors"]


def diagnose_log(folder, log, kind="multi_position", **settings):
    device = chain.Device("imu", folder, {"log": kind}, **settings)
    log.to_parquet(folder / "log.parquet", index=False)
    chain.ingest(device, "log", {}, [folder / "log.parquet"])
    return verdicts(device)


def write_blank(canvas, file, **how):
    file.write("<svg></svg>")
