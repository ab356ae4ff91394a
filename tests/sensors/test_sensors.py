"""The table of sensors: against its schema, against drivers of others, and as a prior."""

from math import radians

import pytest
import yaml

from imuloop.core.errors import ImuloopError
from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from imuloop.sensors import GENERIC, PARTS, Tolerance, find_sensor, sensor_names
from result_files import validator

UG, UDPS = STANDARD_GRAVITY * 1e-6, DEGREE * 1e-6
NAMES = sensor_names()
QUANTITIES = {sensor: quantity for quantity, sensor in PARTS.items()}
SENSORS = ("accelerometer", "gyroscope")


@pytest.fixture(scope="module")
def table(repository):
    path = repository / "workflow/lib/imuloop/sensors/sensors.yaml"
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_the_table_has_common_sensors_and_fits_its_schema(table):
    assert len(table) >= 25
    faults = [
        f"{error.json_path}: {error.message}"
        for error in validator("sensors.schema.yaml").iter_errors(table)
    ]
    assert faults == []


@pytest.mark.parametrize("name", NAMES)
def test_scale_times_counts_is_the_full_scale(table, name):
    sheet = find_sensor(name)
    for sensor in SENSORS:
        sheet_part, part = getattr(sheet, sensor), table[name].get(sensor)
        assert (sheet_part is None) == (part is None)
        if sheet_part is None:
            continue
        counts = part.get("full_count", [2 ** (part["count_bits"] - 1)] * len(sheet_part.ranges))
        largest = [span.scale * n for span, n in zip(sheet_part.ranges, counts, strict=True)]
        full_scales = [span.full_scale for span in sheet_part.ranges]
        assert largest == pytest.approx(full_scales, rel=1e-3)
        assert full_scales == sorted(set(full_scales))
        assert max(counts) <= 2 ** (part["count_bits"] - 1)


ST = "lsm6ds3 lsm6ds3trc lsm6dsl lsm6dsm lsm6dso lsm6dsox ism330dlc ism330dhcx"
INVENSENSE = "mpu6050 mpu6500 mpu9150 mpu9250 icm20602 icm20689"
GRADED = "adis16465 adis16467 adis16475 adis16477 adis16505 adis16507"


@pytest.mark.parametrize(
    ("names", "sensor", "scales", "unit"),
    [
        # Linux st_lsm6dsx_core.c: 70 mdps at 2000 deg/s, 0.732 mg at 16 g of the LSM9DS1
        (ST, "accelerometer", {"2 g": 61, "4 g": 122, "8 g": 244, "16 g": 488}, UG),
        (ST, "gyroscope", {"250 deg/s": 8750, "500 deg/s": 17500}, UDPS),
        (ST, "gyroscope", {"1000 deg/s": 35000, "2000 deg/s": 70000}, UDPS),
        ("lsm9ds1", "accelerometer", {"2 g": 61, "4 g": 122, "8 g": 244, "16 g": 732}, UG),
        ("lsm9ds1", "gyroscope", {"245 deg/s": 8750, "500 deg/s": 17500}, UDPS),
        ("lsm9ds1 lsm9ds0 l3gd20h", "gyroscope", {"2000 deg/s": 70000}, UDPS),
        # the vendor's st_lsm6dsvx.h and st_asm330lhh.h
        ("lsm6dsv16x ism330dhcx", "gyroscope", {"125 deg/s": 4375, "4000 deg/s": 140000}, UDPS),
        # Adafruit_LSM9DS0.h
        ("lsm9ds0", "accelerometer", {"6 g": 183, "16 g": 732}, UG),
        # Linux inv_mpu_core.c
        (INVENSENSE, "accelerometer", {"2 g": 598, "4 g": 1196, "8 g": 2392, "16 g": 4785}, 1e-6),
        (INVENSENSE, "gyroscope", {"250 deg/s": 133090, "500 deg/s": 266181}, 1e-9),
        (INVENSENSE, "gyroscope", {"1000 deg/s": 532362, "2000 deg/s": 1064724}, 1e-9),
        # Linux inv_icm42600_gyro.c, inv_icm45600_gyro.c: not the rounded 16.4 counts per deg/s
        (
            "icm42605 icm42688p icm45686",
            "gyroscope",
            {"15.625 deg/s": 8322, "125 deg/s": 66579, "2000 deg/s": 1065264},
            1e-9,
        ),
        ("icm45686", "gyroscope", {"4000 deg/s": 2130529}, 1e-9),
        # PX4 icm20649: 1024 counts per g at 30 g
        ("icm20649", "accelerometer", {"30 g": 1 / 1024}, STANDARD_GRAVITY),
        # Linux bmi160_core.c, bmi270_core.c, bmi323_core.c
        ("bmi160 bmi270 bmi323", "accelerometer", {"2 g": 598, "16 g": 4788}, 1e-6),
        ("bmi160 bmi270 bmi323", "gyroscope", {"1000 deg/s": 532, "2000 deg/s": 1065}, 1e-6),
        # the conversion of the BMI088 data sheet
        ("bmi088", "accelerometer", {"3 g": 1.5 * 2 / 32768, "24 g": 24 / 32768}, STANDARD_GRAVITY),
        # bno055.h of the manufacturer, units after power-on
        ("bno055", "accelerometer", {"4 g": 1 / 100}, 1.0),
        ("bno055", "gyroscope", {"2000 deg/s": 1 / 16}, DEGREE),
        # Linux fxos8700_core.c, 14 bits; fxas21002c_core.c
        ("fxos8700", "accelerometer", {"2 g": 244, "4 g": 488, "8 g": 976}, UG),
        ("fxas21002c", "gyroscope", {"2000 deg/s": 2000 / 32000}, DEGREE),
        # Linux adis16400.c, adis16475.c; Analog Devices iio_adis16505.c for counts of 32 bits
        ("adis16448", "accelerometer", {"18 g": 833}, UG),
        ("adis16448", "gyroscope", {"1000 deg/s": 40000}, UDPS),
        (
            GRADED,
            "gyroscope",
            {"125 deg/s": 1 / 160, "500 deg/s": 1 / 40, "2000 deg/s": 1 / 10},
            DEGREE,
        ),
        ("adis16465 adis16475", "accelerometer", {"8 g": 1 / 4000}, STANDARD_GRAVITY),
        ("adis16467 adis16470 adis16477", "accelerometer", {"40 g": 1 / 800}, STANDARD_GRAVITY),
        ("adis16505", "accelerometer", {"78.4 m/s^2": 65536 / 26756268}, 1.0),
        ("adis16500 adis16507", "accelerometer", {"392 m/s^2": 392 / 32000}, 1.0),
        # ArduPilot and AeroQuad
        ("itg3200", "gyroscope", {"2000 deg/s": 1 / 14.375}, DEGREE),
    ],
)
def test_scales_are_those_of_drivers(names, sensor, scales, unit):
    for name in names.split():
        for full_scale, scale in scales.items():
            stated = find_sensor(name).choose_range(QUANTITIES[sensor], full_scale).scale
            assert stated == pytest.approx(scale * unit, rel=1.5e-3), (name, full_scale)


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("icm42688p", "ICM-42688-P"),
        ("ICM-42688-P", "ICM-42688-P"),
        ("icm 42688_p", "ICM-42688-P"),
        ("MPU9255", "MPU-9250"),
        ("adis16475-2", "ADIS16475"),
    ],
)
def test_case_and_punctuation_of_a_name_do_not_matter(name, label):
    assert find_sensor(name).label == label


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("icm42688q", "did you mean 'icm42688p'?"),
        ("LSM6DS0X", "did you mean 'lsm6dsox'?"),
        ("gyrometer", "; imuloop sensors lists them"),
        ("", "; imuloop sensors lists them"),
    ],
)
def test_an_unknown_name_is_refused_with_the_nearest(name, wanted):
    with pytest.raises(ImuloopError, match="is not a sensor of the table") as error:
        find_sensor(name)
    assert wanted in str(error.value)


@pytest.mark.parametrize("wanted", ["16 g", "16g", "±16 g", "16000 mg", 156.9, "156.9 m/s^2"])
def test_a_range_is_chosen_by_its_full_scale(wanted):
    chosen = find_sensor("icm42688p").choose_range("acceleration", wanted)
    assert chosen.name == "16 g"
    assert chosen.full_scale == pytest.approx(16 * STANDARD_GRAVITY)
    assert chosen.scale == pytest.approx(STANDARD_GRAVITY / 2048)
    assert chosen.noise_density == pytest.approx(65 * UG)


@pytest.mark.parametrize("wanted", [None, "10 g", "16", 16, "16 parsec", "", "4500 deg/s"])
def test_an_unknown_range_is_refused_with_the_known_ones(wanted):
    with pytest.raises(ImuloopError, match="use one of 2 g, 4 g, 8 g, 16 g"):
        find_sensor("icm42688p").choose_range("acceleration", wanted)


@pytest.mark.parametrize(
    ("name", "sensor", "tolerance"),
    [
        # typical: 3 %, 2 %, 80 mg; 20 deg/s
        ("mpu6050", "accelerometer", (0.02, 0.03, 0.08 * STANDARD_GRAVITY)),
        ("mpu6050", "gyroscope", (0.02, 0.03, radians(20))),
        # typical 1 % and 40 mg, maximum 10.2 % and 250 mg
        ("adxl345", "accelerometer", (0.01, 0.102 / 3**0.5, 0.25 * STANDARD_GRAVITY / 3**0.5)),
        # maximum 3 %, no cross-axis sensitivity
        ("ism330dlc", "accelerometer", (0.02, 0.03 / 3**0.5, 0.5)),
        # typical 0.2 %, 0.2 % and 10 mg, 0.3 deg/s: below the lower limits
        ("icm45686", "accelerometer", (0.01, 0.01, 0.5)),
        ("icm45686", "gyroscope", (0.02, 0.01, 0.2)),
        # one standard deviation of 0.5 deg/s
        ("adis16448", "gyroscope", (0.02, 0.01, 0.2)),
        # a driver gives no tolerance
        ("bmi160", "accelerometer", (0.02, 0.03, 0.5)),
        ("bmi160", "gyroscope", (0.02, 0.03, 0.2)),
    ],
)
def test_a_tolerance_becomes_a_standard_deviation(name, sensor, tolerance):
    stated = getattr(find_sensor(name), sensor).tolerance
    wanted = Tolerance(*tolerance)
    for parameter in ("misalignment", "scale_factor", "bias"):
        assert getattr(stated, parameter) == pytest.approx(getattr(wanted, parameter)), parameter


def test_no_sheet_makes_a_narrower_bias_than_a_sensor_without_a_name():
    assert GENERIC["accelerometer"] == Tolerance(0.02, 0.03, 0.5)
    assert GENERIC["gyroscope"] == Tolerance(0.02, 0.03, 0.2)
    for sensor, generic in GENERIC.items():
        sheets = [getattr(find_sensor(name), sensor) for name in NAMES]
        tolerances = [sheet.tolerance for sheet in sheets if sheet]
        assert min(sheet.bias for sheet in tolerances) == generic.bias
        assert min(sheet.scale_factor for sheet in tolerances) == 0.01
        assert min(sheet.misalignment for sheet in tolerances) >= 0.01
