"""Which columns hold what."""

import re

import pytest

from imuloop.core.errors import ImuloopError
from imuloop.ingest.columns import resolve

SIX = "ax ay az gx gy gz"
DELTA = {"acceleration": "m/s", "angular_rate": "rad"}

# headers as loggers write them, each `time, ax ay az, gx gy gz` and some a temperature; the units
# that they say
HEADERS = {
    f"t {SIX} temp": {},
    "time acc_x acc_y acc_z gyr_x gyr_y gyr_z temperature": {},
    f"timestamp {SIX.replace('g', 'w')} temperature": {},
    "timestamp imu.acc.x imu.acc.y imu.acc.z imu.gyro.x imu.gyro.y imu.gyro.z imu.temperature": {},
    "Timestamp accelX accelY accelZ gyroX gyroY gyroZ Temp": {},
    "time_us accelerometer_x accelerometer_y accelerometer_z gyroscope_x gyroscope_y gyroscope_z"
    " temp_c": {"time": "us", "temperature": "degC"},
    "stamp linear_acceleration.x linear_acceleration.y linear_acceleration.z angular_velocity.x"
    " angular_velocity.y angular_velocity.z temperature": {},
    "time xacc yacc zacc xgyro ygyro zgyro temperature": {},
    "t dvx dvy dvz dax day daz": DELTA,
    "t imu.delta_velocity.x imu.delta_velocity.y imu.delta_velocity.z imu.delta_angle.x"
    " imu.delta_angle.y imu.delta_angle.z": DELTA,
    "t deltaVelX deltaVelY deltaVelZ deltaAngX deltaAngY deltaAngZ": DELTA,
    "t delta_velocity[0] delta_velocity[1] delta_velocity[2] dang[0] dang[1] dang[2]": DELTA,
    "timestamp [ns]|ax (g)|ay (g)|az (g)|gyro_x_dps|gyro_y_dps|gyro_z_dps|temp (°C)":
        {"time": "ns", "acceleration": "g", "angular_rate": "deg/s", "temperature": "degC"},
    # what is not known is passed on as it is written
    "t|ax [furlong]|ay [furlong]|az [furlong]|gx|gy|gz": {"acceleration": "furlong"},
    "t|ax_cms2|ay_cms2|az_cms2|gx|gy|gz": {"acceleration": "cm/s^2"},
    "t|ax [m s-2]|ay [m s-2]|az [m s-2]|gx|gy|gz": {"acceleration": "m/s^2"},
    "t [min]|ax|ay|az|gx|gy|gz": {"time": "min"},
    "t [µs]|ax|ay|az|gx|gy|gz": {"time": "us"},
    "t|ax|ay|az|gx_rpm|gy_rpm|gz_rpm": {"angular_rate": "rpm"},
    "t|ax|ay|az|gx [°/s]|gy [°/s]|gz [°/s]": {"angular_rate": "deg/s"},
    "t|ax|ay|az|gx [mrad/s]|gy [mrad/s]|gz [mrad/s]": {"angular_rate": "mrad/s"},
    "t|ax|ay|az|gx deg/s|gy deg/s|gz deg/s": {"angular_rate": "deg/s"},
    "t|ax|ay|az|gx_deg_s|gy_deg_s|gz_deg_s": {"angular_rate": "deg/s"},
    "t|ax|ay|az|gx / dps|gy / dps|gz / dps": {"angular_rate": "deg/s"},
    "t|ax|ay|az|gyro_x_deg|gyro_y_deg|gyro_z_deg": {"angular_rate": "deg/s"},
    "t|ax|ay|az|gyro_x_raw|gyro_y_raw|gyro_z_raw": {"angular_rate": "count"},
    "t|ax|ay|az|gyro[0]|gyro[1]|gyro[2]": {},
    "t|ax|ay|az|gx []|gy []|gz []": {},
    "t|ax|ay|az|gx|gy|gz|temp_f": {"temperature": "degF"},
    "t|ax|ay|az|gx|gy|gz|temp [degrees Celsius]": {"temperature": "degC"},
    # who writes deg beside a rate means deg/s, and beside an angle deg
    "t|ax|ay|az|gx [deg]|gy [deg]|gz [deg]": {"angular_rate": "deg/s"},
    "t|dvx|dvy|dvz|dax [deg]|day [deg]|daz [deg]": {"acceleration": "m/s", "angular_rate": "deg"},
}  # fmt: skip


@pytest.mark.parametrize("header", HEADERS)
def test_usual_names_and_their_units_are_known(header):
    names = header.split("|" if "|" in header else None)
    found = resolve(names)
    assert (found.time, found.acceleration, found.angular_rate) == (0, (1, 2, 3), (4, 5, 6))
    assert found.temperature == (7 if len(names) > 7 else None)
    assert found.units == HEADERS[header]
    of_increments = {"acceleration", "angular_rate"} if names[1].lower().find("d") >= 0 else set()
    assert found.increments == of_increments


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
        # the stamp of a message comes before its receipt, as rostopic echo -p prints it
        (["%time", "field.header.seq", "field.header.stamp"], 2, None),
    ],
)
def test_the_time_column_is_one_whose_unit_is_of_time(names, at, unit):
    found = resolve([*names, *SIX.split()])
    assert (found.time, found.units.get("time")) == (at, unit)


def test_what_begins_as_a_sensor_or_is_derived_from_it_is_none():
    names = [f"{stem}_{axis}" for stem in ("accuracy", "gyro", "accel_bias") for axis in "xyz"]
    found = resolve(["t", *names])
    assert found.acceleration is None and found.angular_rate == (4, 5, 6)
    assert resolve("t ax ay az".split()).angular_rate is None
    # who logs the rate too has it from there
    names = f"t {SIX} dvx dvy dvz dax day daz dt".split()
    found = resolve(names)
    assert (found.acceleration, found.angular_rate) == ((1, 2, 3), (4, 5, 6))
    assert (found.units, found.others) == ({}, {})
    chosen = resolve(names, {"acceleration": ["dvx", "dvy", "dvz"]})
    assert chosen.units == {"acceleration": "m/s"}
    assert chosen.others == {"interval.acceleration": 13, "interval.angular_rate": 13}


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
    ("names", "columns", "line"),
    [
        ("t x x z gx gy gz", {"acceleration": ["x", "x", "z"]}, "2 columns are named 'x'"),
        (f"t {SIX}", {"acceleration": "ax"}, "not a list of three"),
        (f"t u v {SIX}", {"time": ["t", "u", "v"]}, "is not a column, nor two of whole seconds"),
        # what repeats is not chosen by its place
        (f"t {SIX} ax", {}, "both look like acceleration"),
        (f"t {SIX} AX", {}, "both look like acceleration"),
        (f"t {SIX} a_x", {}, "both look like acceleration"),
        (f"t T {SIX}", {}, "2 columns are named 't"),
        (f"t {SIX} temp temp", {}, "2 columns are named 't"),
    ],
)
def test_columns_that_cannot_be_chosen_are_one_line(names, columns, line):
    with pytest.raises(ImuloopError, match=line):
        resolve(names.split(), columns)
