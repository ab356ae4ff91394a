"""Real recordings, as config/measured.yaml declares them, against their publishers' statements."""

import numpy as np
import pytest
import yaml

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.units import RawUnit

# rows, rate in Hz, duration in s
DEVICES = {
    "xsens_mti": (51175, 100, 512),
    "mpu9150_1": (15969, 100, 160),
    "mpu9150_2": (None, 100, 160),
    "mpu9150_3": (None, 100, 160),
    "thermal_chamber": (8400, 1.98, 70.7 * 60),
    "ferraris": (10376, 102.4, 101.3),
}


@pytest.fixture
def measured(repository, recordings, run):
    """Return a function that ingests a device's session; it gives the files and the results."""
    devices = yaml.safe_load((repository / "config/measured.yaml").read_text())["devices"]

    def ingested(device, **changed):
        (session,) = devices[device]["sessions"].values()
        declared = {**session, "nominal": devices[device].get("nominal"), **changed}
        file = declared.pop("file")
        sources = [file] if "url" in file else file.values()
        paths = [recordings(source["url"].rsplit("/", 1)[1]) for source in sources]
        return paths, run(*paths, **declared)

    ingested.devices = devices
    return ingested


@pytest.mark.parametrize("device", DEVICES)
def test_a_measured_recording_comes_back(measured, device):
    assert {*measured.devices} == {*DEVICES}
    paths, done = measured(device)
    quality, samples, (rows, rate, duration) = done.quality, done.samples, DEVICES[device]
    assert (quality["status"], quality["reasons"], quality["warnings"]) == ("ok", [], [])
    assert rows in (None, quality["rows"])
    assert quality["rate_hz"] == pytest.approx(rate, rel=3e-3)
    assert quality["duration_s"] == pytest.approx(duration, rel=1e-2)
    if device == "xsens_mti":
        # the raw counts come back, each one
        axes = {"acceleration": ACCELERATION, "angular_rate": ANGULAR_RATE}
        for path, (quantity, names) in zip(paths, axes.items(), strict=True):
            raw, unit = np.loadtxt(path), RawUnit(**done.metadata["raw_units"][quantity])
            np.testing.assert_array_equal(np.round(unit.from_si(samples[[*names]])), raw[:, 1:])
    elif device.startswith("mpu"):
        np.testing.assert_array_equal(samples[[*CHANNELS]], np.loadtxt(paths[0]))
    if device.startswith(("mpu", "xsens")):
        ratio = quality["faults"]["rests"]["turn_ratio"]
        assert ratio["value"] == pytest.approx(1, abs=0.02) and ratio["moves"] >= 19


def test_a_wrong_clock_is_rejected(measured):
    """The published rate is twice the turns' rate."""
    _, done = measured("ferraris", columns=None, rate=204.8)
    assert "the log's rate is off by as much" in done.quality["reasons"][0]


# --- recordings of others, sound and harmed

ADIS = {"units": {"acceleration": "g", "angular_rate": "deg/s"}, "rate": 100}
SIX = {"acceleration": [0, 1, 2], "angular_rate": [3, 4, 5]}
BROAD = {"columns": {"acceleration": "imu_acc", "angular_rate": "imu_gyr"}, "rate": 285.714}
INCREMENTS = {"columns": {"time": 0, "angular_rate": [1, 2, 3], "acceleration": [4, 5, 6]}}
# file, the declaration, and the reason if it is rejected: a whole file as a logger writes it
STATIC = {
    "adis_16405_imu1.parquet": (ADIS, None),
    "imu1.log": ({"columns": SIX, "rate": 100}, "; a static session lies still"),
    "03_undisturbed_slow_rotation_C.mat": (BROAD, "; a static session lies still"),
    "07_undisturbed_fast_rotation_B.mat": (BROAD, "; a static session lies still"),
    "unlabelled_increments_100Hz.txt.gz": (
        INCREMENTS, "declare units.acceleration: m/s and units.angular_rate: rad"),
}  # fmt: skip


@pytest.mark.parametrize("name", STATIC)
def test_rest_is_told_from_motion_and_rates_from_increments(recordings, run, name):
    declared, reason = STATIC[name]
    quality = run(recordings(name), kind="static", **declared).quality
    if reason:
        assert reason in quality["reasons"][0]
    else:
        assert (quality["reasons"], quality["warnings"]) == ([], [])
        assert quality["faults"]["rests"]["share"] > 0.999
