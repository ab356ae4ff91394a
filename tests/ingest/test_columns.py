"""Which columns hold what."""

import re

import pytest

from imuloop.core.errors import ImuloopError
from imuloop.ingest.columns import resolve
from imuloop.ingest.spellings import stated_unit

# headers as loggers write them, each `time, ax ay az, gx gy gz, temperature`
HEADERS = {
    "contract": "t ax ay az gx gy gz temp",
    "short": "time acc_x acc_y acc_z gyr_x gyr_y gyr_z temperature",
    "mikoff": "timestamp ax ay az wx wy wz temperature",
    "dots": "timestamp imu.acc.x imu.acc.y imu.acc.z imu.gyro.x imu.gyro.y imu.gyro.z"
    " imu.temperature",
    "camel": "Timestamp accelX accelY accelZ gyroX gyroY gyroZ Temp",
    "long": "time_us accelerometer_x accelerometer_y accelerometer_z gyroscope_x gyroscope_y"
    " gyroscope_z temp_c",
    "ros": "stamp linear_acceleration.x linear_acceleration.y linear_acceleration.z"
    " angular_velocity.x angular_velocity.y angular_velocity.z temperature",
    "mavlink": "time xacc yacc zacc xgyro ygyro zgyro temperature",
}


@pytest.mark.parametrize("name", HEADERS)
def test_usual_names_are_known(name):
    found = resolve(HEADERS[name].split())
    assert found.time == 0
    assert found.acceleration == (1, 2, 3)
    assert found.angular_rate == (4, 5, 6)
    assert found.temperature == 7


@pytest.mark.parametrize(
    ("quantity", "text", "unit"),
    [
        ("acceleration", "m s-2", "m/s^2"),
        ("acceleration", "m/(s^2)", "m/s^2"),
        ("angular_rate", "°/s", "deg/s"),
        ("angular_rate", "mrad/s", "mrad/s"),
        ("time", "µs", "us"),
        ("temperature", "degrees Celsius", "degC"),
        ("acceleration", "uT", None),
    ],
)
def test_spellings_of_units(quantity, text, unit):
    assert stated_unit(quantity, text) == unit


@pytest.mark.parametrize(
    ("names", "at", "unit"),
    [
        (["T(°)", "Time(s)"], 1, "s"),
        (["Time(s)", "T(°)"], 0, "s"),
        (["T(°)"], None, None),
        (["T [K]", "Time (UTC)"], 1, "UTC"),
        (["millis"], 0, "ms"),
        (["micros"], 0, "us"),
        (["UTC_Hour", "UTC_Minute", "sampleTimeMillis", "timestamp_ms"], 3, "ms"),
    ],
)
def test_the_time_column_is_one_whose_unit_is_of_time(names, at, unit):
    found = resolve([*names, *"ax ay az gx gy gz".split()])
    assert (found.time, found.units.get("time")) == (at, unit)


def test_what_begins_as_a_sensor_is_none():
    names = [f"{stem}_{axis}" for stem in ("accuracy", "gyro", "accel_bias") for axis in "xyz"]
    found = resolve(["t", *names])
    assert found.acceleration is None and found.angular_rate == (4, 5, 6)


def test_the_stamp_of_a_message_comes_before_its_receipt():
    # as rostopic echo -p prints it
    names = "%time field.header.seq field.header.stamp ax ay az gx gy gz".split()
    assert resolve(names).time == 2


def test_missing_angular_rate_and_repeated_names():
    assert resolve("t ax ay az".split()).angular_rate is None
    with pytest.raises(ImuloopError, match="2 columns are named 'x'"):
        resolve("t x x z gx gy gz".split(), {"acceleration": ["x", "x", "z"]})
    with pytest.raises(ImuloopError, match="not a list of three"):
        resolve("t ax ay az gx gy gz".split(), {"acceleration": "ax"})
    with pytest.raises(ImuloopError, match=r"time: .* is not a column, nor two of whole seconds"):
        resolve("t u v ax ay az gx gy gz".split(), {"time": ["t", "u", "v"]})


@pytest.mark.parametrize(
    "names",
    [
        "ax ay az acc_x acc_y acc_z",
        "imu.acc.x imu.acc.y imu.acc.z raw.acc.x raw.acc.y raw.acc.z",
        "ax ay az raw_ax raw_ay raw_az",
        "acc_x_g acc_y_g acc_z_g acc_x_mps2 acc_y_mps2 acc_z_mps2",
        "ax ay az gFx gFy gFz",
        "acc[0] acc[1] acc[2] imu_acc[0] imu_acc[1] imu_acc[2]",
    ],
)
def test_two_accelerometers_must_be_distinguished(names):
    first, second = ("/".join(part) for part in (names.split()[:3], names.split()[3:]))
    every = ["t", *names.split(), "gx", "gy", "gz"]
    with pytest.raises(ImuloopError, match=rf"^{re.escape(first)} and {re.escape(second)} both lo"):
        resolve(every)
    assert resolve(every, {"acceleration": names.split()[3:]}).acceleration == (4, 5, 6)


@pytest.mark.parametrize(
    ("names", "units"),
    [
        (
            "timestamp [ns]|ax (g)|ay (g)|az (g)|gyro_x_dps|gyro_y_dps|gyro_z_dps|temp (°C)",
            {"time": "ns", "acceleration": "g", "angular_rate": "deg/s", "temperature": "degC"},
        ),
        # what is not known is passed on as it is written
        ("t|ax [furlong]|ay [furlong]|az [furlong]|gx|gy|gz", {"acceleration": "furlong"}),
        ("t|ax_cms2|ay_cms2|az_cms2|gx|gy|gz", {"acceleration": "cm/s^2"}),
        ("t [min]|ax|ay|az|gx|gy|gz", {"time": "min"}),
        ("t|ax|ay|az|gx_rpm|gy_rpm|gz_rpm", {"angular_rate": "rpm"}),
        ("t|ax|ay|az|gx|gy|gz|temp_f", {"temperature": "degF"}),
    ],
)
def test_units_in_names(names, units):
    assert resolve(names.split("|")).units == units


@pytest.mark.parametrize(
    ("gyroscope", "unit"),
    [
        ("gx deg/s|gy deg/s|gz deg/s", "deg/s"),
        ("gx_deg_s|gy_deg_s|gz_deg_s", "deg/s"),
        ("gx / dps|gy / dps|gz / dps", "deg/s"),
        ("gx (deg/s)|gy (rad/s)|gz (deg/s)", "deg/s and rad/s"),
        ("gyro_x_deg|gyro_y_deg|gyro_z_deg", "deg/s"),
        ("gyro_x_raw|gyro_y_raw|gyro_z_raw", "count"),
        ("gyro[0]|gyro[1]|gyro[2]", None),
        ("gx []|gy []|gz []", None),
    ],
)
def test_units_at_the_end_of_names(gyroscope, unit):
    names = ["t", "ax", "ay", "az", *gyroscope.split("|")]
    assert resolve(names, {"angular_rate": names[4:]}).units.get("angular_rate") == unit


@pytest.mark.parametrize(
    "names",
    ["t ax ay az gx gy gz ax", "t ax ay az gx gy gz AX", "t ax ay az gx gy gz a_x",
     "t T ax ay az gx gy gz", "t ax ay az gx gy gz temp temp"],
)  # fmt: skip
def test_what_repeats_is_not_chosen_by_its_place(names):
    with pytest.raises(ImuloopError, match=r"both look like acceleration|2 columns are named 't"):
        resolve(names.split())
