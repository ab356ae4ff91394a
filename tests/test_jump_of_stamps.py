"""Logs whose stamps jump ahead: two power cycles of a session, in all stages."""

import resource

import numpy as np
import pytest

from imuloop import chain
from imuloop.chain import Device
from imuloop.core.files import read_json
from imuloop.model.calibration import Calibration
from quick import hurry
from segment.logs import adis16405

# s: ten days, and a boot clock that meets GPS time
JUMPS = (864e3, 1.7e9)


def results(samples, jump, folder):
    """Return verdicts, calibration, noise and the peak of memory, kB, of a log with a jump."""
    folder.mkdir()
    table = samples.assign(t=np.where(samples.t < 50.0, samples.t, samples.t + jump))
    table.to_parquet(folder / "log.parquet")
    device = Device("imu", folder, {"log": "static"})
    chain.ingest(device, "log", {}, [folder / "log.parquet"])
    with hurry("imu"):
        chain.run(device)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    sensors = read_json(folder / "diagnosis.json")["sensors"]
    verdicts = {(s, k): part["verdict"] for s, of in sensors.items() for k, part in of.items()}
    noise = read_json(folder / "noise.json")["axes"]
    limits = [axis[name]["upper95"] for axis in noise.values() for name in "QNBKR"]
    calibration = Calibration.from_json(folder / "calibration.json")
    sensors = (calibration.accelerometer, calibration.gyroscope)
    parameters = [np.concatenate([s.T.ravel(), s.K, s.b]) for s in sensors]
    return verdicts, limits, parameters, peak


@pytest.mark.study
@pytest.mark.usefixtures("blank_figures")
def test_what_lies_between_changes_nothing(recordings, tmp_path):
    samples = adis16405(recordings)[:12_000]
    ten_days, gps = (results(samples, jump, tmp_path / f"{jump:g}") for jump in JUMPS)
    assert gps[0] == ten_days[0]
    # stamps of 1.7e9 s are known to 2e-7 s
    assert gps[1] == pytest.approx(ten_days[1], rel=1e-4)
    for one, other in zip(gps[2], ten_days[2], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-7)
    # a value per second between would be 13 GB; the memory that an allocator keeps varies by 60 MB
    assert gps[3] < 1.5 * ten_days[3]
