"""Zips of phyphox and Sensor Logger."""

import zipfile

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.ingest import phone
from ingest.tables import ACCELERATION, RATE, check, table
from ingest.written import phyphox, sensor_logger, timed

pytestmark = pytest.mark.usefixtures("in_process")

# stamps of Sensor Logger, whole nanoseconds
STEPS = 10_000_000 * np.arange(500)


@pytest.fixture
def write(tmp_path):
    def call(members, method=zipfile.ZIP_DEFLATED):
        path = tmp_path / "log.zip"
        with zipfile.ZipFile(path, "w", method) as archive:
            for name, text in members.items():
                archive.writestr(name, text)
        return path

    return call


@pytest.fixture
def refused(run, write):
    def call(members):
        path = members if hasattr(members, "read_bytes") else write(members)
        (reason,) = run(path).quality["reasons"]
        return reason

    return call


@pytest.mark.parametrize("kind", [("Acceleration", "Gyroscope"), ("", ""), ("Accelerometer", "")])
@pytest.mark.parametrize(("separator", "decimal"), [",.", "\t.", ";,"])
def test_phyphox(log, run, write, kind, separator, decimal):
    done = run(write(phyphox(log, kind, separator, decimal)))
    check(done, log)
    assert done.metadata["units"] == {"time": "s", "acceleration": "m/s^2", "angular_rate": "rad/s"}
    assert done.quality["warnings"][0] == "an export of phyphox"
    assert done.quality["rows"] == 500


@pytest.mark.parametrize(("separator", "decimal"), [",.", ";,"])
def test_a_pause_of_phyphox_is_a_gap(log, run, write, separator, decimal):
    members = phyphox(log, ("Acceleration", "Gyroscope"), separator, decimal)
    # the phone's clock is set back by a minute, then the experiment pauses for 30 s and 7 s
    starts = [(0, 1.7e9), (1.005, 1.7e9 - 59), (2.005, 1.7e9 + 32.005), (3.005, 1.7e9 + 40.005)]
    members["meta/time.csv"] = timed(separator, decimal, *starts)
    done = run(write(members))
    late = np.select([log.t > 3.005, log.t > 2.005], [37, 30], 0)
    np.testing.assert_allclose(done.samples.t, log.t + late, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(done.samples.t[:200], log.t[:200])
    np.testing.assert_array_equal(done.samples.gx, log.gx)
    assert done.quality["gaps"]["count"] == 2
    assert any(
        line.startswith("paused 2 times, 37 s together") for line in done.quality["warnings"]
    )


def test_phyphox_in_one_table_and_a_folder(log, run, write):
    header = ["Time (s)", *(f"Acceleration {a} (m/s^2)" for a in "xyz"), "Absolute (m/s^2)"]
    header += [f"Gyroscope {a} (rad/s)" for a in "xyz"]
    columns = [log.t, *(log[a] for a in ACCELERATION), log.az, *(log[a] for a in RATE)]
    done = run(write({"run/Raw Data.csv": table(header, columns), "__MACOSX/run/._a.csv": "\0"}))
    check(done, log)
    assert done.quality["columns"]["acceleration"][0] == "Raw Data.Acceleration x (m/s^2)"


@pytest.mark.parametrize("digits", ["{:.9E}", "{!r}", "{:.30f}"])
def test_every_bit_of_phyphox(hard, every_bit, write, digits):
    t = 1 / 3 + np.arange(300) / 100
    members = {}
    for name, three in (("Acceleration", hard[:, :3]), ("Gyroscope", hard[:, 3:])):
        header = ["Time (s)", *(f"{name} {axis} (m/s^2)" for axis in "xyz")]
        columns = [t.tolist(), *three.T.tolist()]
        members[f"{name}.csv"] = table(header, columns, digits.format)
    nearest = np.array([[float(digits.format(x)) for x in row] for row in hard.tolist()])
    stamps = np.array([float(digits.format(x)) for x in t.tolist()])
    every_bit(write(members), nearest, stamps)


def test_every_bit_of_sensor_logger(hard, hard_stamps, every_bit, write):
    members = {}
    for name, three in (("TotalAcceleration", hard[:, :3]), ("Gyroscope", hard[:, 3:])):
        columns = [hard_stamps.tolist(), (hard_stamps * 1e-9).tolist(), *three.T.tolist()]
        members[f"{name}.csv"] = table(["time", "seconds_elapsed", *"xyz"], columns)
    every_bit(write(members), hard, hard_stamps)


def test_acceleration_without_gravity_is_not_taken(log, run, write, refused):
    members = phyphox(log)
    linear = phyphox(log * 0.1, ("Linear Acceleration", ""))["Accelerometer.csv"]
    done = run(write({"Linear Acceleration.csv": linear, **members}))
    check(done, log)
    members["Accelerometer.csv"] = linear
    assert refused(members).startswith("no acceleration found, gravity in it; the zip holds Acc")
    # unless the user wants it
    names = [f"Accelerometer.Linear Acceleration {a} (m/s^2)" for a in "xyz"]
    assert run(write(members), columns={"acceleration": names}).quality["mean_specific_force"] < 1


def test_sensor_logger(log, run, write):
    named = {"Accelerometer": RATE, "TotalAcceleration": ACCELERATION, "Gyroscope": RATE}
    done = run(write(sensor_logger(log, named)))
    check(done, log, t=1e-9 * STEPS)
    assert done.metadata["start"] == "2024-06-10T14:45:36.872695300Z"
    assert done.quality["columns"]["time"] == "Gyroscope stamps"
    assert done.quality["warnings"] == ["an export of Sensor Logger"]


def test_sensor_logger_before_corrections(log, run, write):
    log2 = log.assign(bx=log.ax + 1, by=log.ay + 1, bz=log.az + 1, hx=0.5, hy=0.5, hz=0.5)
    named = {
        "TotalAcceleration": ["bx", "by", "bz"],
        "AccelerometerUncalibrated": ACCELERATION,
        "Gyroscope": ["hx", "hy", "hz"],
        "GyroscopeUncalibrated": RATE,
    }
    path = write(sensor_logger(log2, named))
    check(run(path), log, t=1e-9 * STEPS)
    done = run(path, columns={"acceleration": "TotalAcceleration", "angular_rate": "Gyroscope"})
    np.testing.assert_array_equal(done.samples.ay, log2.by)
    assert set(done.samples.gz) == {0.5}


@pytest.mark.parametrize(
    ("about", "scale", "unit"),
    [
        (("android", "false"), 1, "m/s^2"),
        (("ios", "true"), 1, "m/s^2"),
        (("ios", "false"), -STANDARD_GRAVITY, "g"),
        (None, 1, "m/s^2"),
    ],
)
def test_sensor_logger_on_ios(log, run, write, about, scale, unit):
    if unit == "g":
        log[ACCELERATION] = np.round(-log[ACCELERATION] / STANDARD_GRAVITY, 6)
    named = {"AccelerometerUncalibrated": ACCELERATION, "Gyroscope": RATE}
    done = run(write(sensor_logger(log, named, about)))
    check(done, log, scale, t=1e-9 * STEPS)
    assert done.metadata["units"]["acceleration"] == unit
    assert done.samples.az.mean() > 9
    warned = " ".join(done.quality["warnings"])
    assert ("the sign of iOS is turned" in warned) == (unit == "g")
    assert ("no Metadata.csv" in warned) == (about is None)


def test_damaged_rows_are_counted(log, run, write):
    members = phyphox(log)
    lines = members["Accelerometer.csv"].splitlines()
    lines[3], lines[5], lines[7] = "what", "x,1,2,3", "0.06,1,NaN,3"
    members["Accelerometer.csv"] = "\n".join(lines)
    done = run(write(members))
    assert done.quality["bad_lines"] == 2
    # no sample of the accelerometer is near
    assert done.quality["non_finite"] == 3
    np.testing.assert_array_equal(done.samples.gx, log.gx.drop([2, 4, 6]))


def test_a_sensor_that_is_missing_or_there_twice(log, run, write, refused):
    members = phyphox(log)
    twice = {**members, "Second.csv": members["Gyroscope.csv"]}
    with pytest.raises(ImuloopError, match="Gyroscope and Second both hold angular_rate; name"):
        run(write(twice))
    check(run(write(twice), columns={"angular_rate": "Second"}), log)
    with pytest.raises(ImuloopError, match=r"no stream 'Secnod'.*did you mean 'Second'"):
        run(write(twice), columns={"angular_rate": "Secnod"})
    members["Gyroscope.csv"] = '"Time (s)","X (rad/s)"\n'
    assert refused(members).startswith("no angular_rate found; the zip holds Accelerometer (Accel")
    assert refused({"a.txt": "a"}) == (
        "the zip holds no table of phyphox or Sensor Logger, nor one table, nor one whose name "
        "says acc and one gyr, but 'a.txt'"
    )
    assert "but nothing" in refused({})


def test_a_file_of_the_zip_that_cannot_be_read_is_named(log, write):
    path = write(phyphox(log))
    data = bytearray(path.read_bytes())
    # of the first entry of the directory, the flag of encryption
    data[data.index(b"PK\1\2") + 8] = 1
    path.write_bytes(data)
    with pytest.raises(RejectedLog, match=r"format phone \(RuntimeError: .*time.csv.*encrypted"):
        phone.read({"log": path})
