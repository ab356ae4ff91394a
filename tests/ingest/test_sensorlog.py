"""SensorLog's CSV."""

import numpy as np
import pytest

from imuloop.core.units import STANDARD_GRAVITY
from ingest.tables import ACCELERATION, check, table
from ingest.written import sensorlog


@pytest.fixture
def log(log):
    """The log with its acceleration in g, as the app has it."""
    log[ACCELERATION] = (log[ACCELERATION] / STANDARD_GRAVITY).round(6)
    return log


@pytest.mark.parametrize("rate", ["gyroRotation", "motionRotationRate"])
def test_sensorlog(log, run, tmp_path, rate):
    path = tmp_path / "log.csv"
    path.write_text(sensorlog(log, rate))
    done = run(path, format="sensorlog")
    # as exact as float64 holds stamps since the boot
    np.testing.assert_allclose(done.samples.t, log.t, atol=1e-11)
    check(done, log, -STANDARD_GRAVITY, t=done.samples.t)
    assert done.metadata["units"]["acceleration"] == "g"
    warned = " ".join(done.quality["warnings"])
    assert "sign turned into specific force" in warned
    assert ("less the bias" in warned) == (rate == "motionRotationRate")
    small = run(path, format="sensorlog", batch_rows=7).path.read_bytes()
    assert run(path, format="sensorlog").path.read_bytes() == small


# as phones and watches of several years wrote it
ACCELEROMETER = "accelerometerTimestamp_sinceReboot{s} {a}X{g} {a}Y{g} {a}Z{g}"
HEADERS = {
    "phone": f"loggingTime(txt) loggingSample(N) {ACCELEROMETER} gyroTimestamp_sinceReboot{{s}}"
    " {r}X{w} {r}Y{w} {r}Z{w} magnetometerTimestamp_sinceReboot{s} magnetometerX(µT)",
    "watch": "loggingTime(txt) locationTimestamp_since1970(s) motionTimestamp_sinceReboot{s} "
    f"{ACCELEROMETER} motionUserAccelerationX(G) motionUserAccelerationY(G)"
    " motionUserAccelerationZ(G) {r}X{w} {r}Y{w} {r}Z{w} motionGravityX(G) motionGravityY(G)",
}


def header_of(unit):
    """Return the columns of a phone's log that are read."""
    names = {"a": "accelerometerAcceleration", "r": "gyroRotation"}
    return HEADERS["phone"].format(**names, s="(s)", g=unit, w="(rad/s)").split()[2:10]


@pytest.mark.parametrize("units", [True, False])
@pytest.mark.parametrize("device", HEADERS)
def test_headers_of_sensorlog(log, run, tmp_path, device, units):
    rate = "gyroRotation" if device == "phone" else "motionRotationRate"
    filled = dict(s="(s)", g="(G)", w="(rad/s)") if units else dict(s="", g="", w="")
    header = HEADERS[device].format(a="accelerometerAcceleration", r=rate, **filled)
    # older versions wrote some axes so
    header = header if units else header.replace("AccelerationY", "accelerationY")
    columns = []
    for name in header.split():
        stem, axis = name.split("(")[0][:-1], name.split("(")[0][-1]
        if stem.lower() == "accelerometeracceleration":
            columns.append(log[f"a{axis.lower()}"])
        elif stem == rate:
            columns.append(log[f"g{axis.lower()}"])
        elif "sinceReboot" in name:
            columns.append(log.t)
        else:
            columns.append(["null"] * len(log))
    (tmp_path / "log.csv").write_text(table(header.split(), columns), encoding="utf-8")
    done = run(tmp_path / "log.csv")
    assert done.quality["log_format"] == "sensorlog"
    check(done, log, -STANDARD_GRAVITY)


def test_sensorlog_repeats_a_sample_until_there_is_a_new_one(log, run, tmp_path):
    path = tmp_path / "log.csv"
    lines = sensorlog(log).splitlines()
    path.write_text("\n".join([lines[0], *(line for line in lines[1:] for _ in range(2))]))
    done = run(path, format="sensorlog")
    assert done.quality["rows"] == 500
    assert done.quality["duplicates"] == 0
    assert "no new sample of gyro in 500 rows" in done.quality["warnings"]


def test_every_bit_of_sensorlog(hard, every_bit, tmp_path):
    t = 62608 + np.arange(300) / 100
    head = header_of("(G)")
    columns = hard.T.tolist()
    (tmp_path / "log.csv").write_text(table(head, [t, *columns[:3], t, *columns[3:]]))
    every_bit(tmp_path / "log.csv", hard * [-1, -1, -1, 1, 1, 1], t)


def test_units_of_sensorlog_are_those_of_its_header(log, run, tmp_path):
    path = tmp_path / "log.csv"
    columns = [log[name] for name in ("t", "ax", "ay", "az", "t", "gx", "gy", "gz")]
    path.write_text(table(header_of("(mG)"), columns))
    assert run(path).metadata["units"]["acceleration"] == "mg"
    assert run(path, units={"acceleration": "g"}).metadata["units"]["acceleration"] == "g"
