"""Real recordings, against what their publishers say of them."""

import numpy as np
import pytest

from imuloop.core.units import RawUnit

# counts of the Xsens MTi by its factory sheet, 415 per m/s^2 and 4768 per rad/s
NOMINAL = {
    "acceleration": {"scale": 1 / 415, "offset": 32768},
    "angular_rate": {"scale": 1 / 4768, "offset": 32768},
}
COUNTS = {"acceleration": "count", "angular_rate": "count"}


def test_xsens(run, recordings):
    paths = [recordings("xsens_acc.mat"), recordings("xsens_gyro.mat")]
    done = run(*paths, units=COUNTS, nominal=NOMINAL)
    assert done.quality["status"] == "ok"
    assert done.quality["rows"] == 51175
    assert done.quality["rate_hz"] == pytest.approx(100, rel=2e-4)
    assert done.quality["duration_s"] == pytest.approx(512, abs=0.5)
    assert done.quality["mean_specific_force"] == pytest.approx(9.81, rel=0.05)
    # the raw counts come back, each one
    for path, axes, name in zip(
        paths, (["ax", "ay", "az"], ["gx", "gy", "gz"]), ("acceleration", "angular_rate"),
        strict=True,
    ):  # fmt: skip
        raw = np.loadtxt(path)
        unit = RawUnit(**done.metadata["raw_units"][name])
        np.testing.assert_array_equal(np.round(unit.from_si(done.samples[axes])), raw[:, 1:])
        np.testing.assert_array_equal(done.samples.t, raw[:, 0] - raw[0, 0])
    assert done.quality["quantisation_step"]["ax"] == pytest.approx(1 / 415)


@pytest.mark.parametrize("board", [0, 1, 2])
def test_mpu9150(run, recordings, board):
    path = recordings(f"imu{board}.log")
    columns = {"acceleration": [0, 1, 2], "angular_rate": [3, 4, 5]}
    done = run(path, columns=columns, rate=100)
    assert done.quality["status"] == "ok"
    np.testing.assert_array_equal(done.samples[list(done.samples)[1:]], np.loadtxt(path))
    assert done.quality["duration_s"] == pytest.approx(160, abs=1)
    if board == 0:
        assert done.quality["rows"] == 15969


def test_thermal_chamber(run, recordings):
    path = recordings("imu_raw_data.csv")
    done = run(path, units={"time": "us"})
    assert done.quality["rows"] == 8400
    assert done.quality["duration_s"] / 60 == pytest.approx(70.7, abs=0.05)
    assert done.quality["rate_hz"] == pytest.approx(1.98, abs=0.005)
    assert done.quality["temperature_range"] == pytest.approx([-17.6, 74.0], abs=0.05)
    raw = np.loadtxt(path, delimiter="\t", skiprows=1, usecols=0, dtype=np.int64)
    np.testing.assert_array_equal(done.samples.t, (raw - raw[0]) * 1e-6)
    # in seconds it would be a log of 135 years
    assert run(path).quality["status"] == "rejected"


def test_ferraris(run, recordings):
    path = recordings("example_ferraris_session.csv")
    done = run(path, rate=102.4, units={"angular_rate": "deg/s"})
    raw = np.loadtxt(path, delimiter=",", skiprows=1)
    assert done.quality["rows"] == len(raw) == 10376
    np.testing.assert_array_equal(done.samples[["ax", "ay", "az"]], raw[:, 4:7])
    np.testing.assert_allclose(
        done.samples[["gx", "gy", "gz"]], np.deg2rad(raw[:, 1:4]), rtol=1e-15
    )
