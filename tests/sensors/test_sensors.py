"""The table of sensors: against its schema, against drivers of others, and as a prior."""

from math import radians
from pathlib import Path

import pytest
import yaml

from imuloop.core.errors import ImuloopError
from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from imuloop.sensors import GENERIC, Tolerance, find_sensor, sensor_names
from result_files import validator

NAMES = sensor_names()
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


DRIVERS = yaml.safe_load(Path(__file__).with_name("drivers.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("driver", DRIVERS, ids=lambda driver: driver["source"])
def test_scales_are_those_of_drivers(driver):
    unit = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "rad/s": 1.0, "deg/s": DEGREE}[driver["unit"]]
    for name in driver["names"].split():
        for full_scale, scale in driver["scales"].items():
            stated = find_sensor(name).choose_range(driver["quantity"], full_scale).scale
            assert stated == pytest.approx(scale * unit, rel=1.5e-3), (name, full_scale)


@pytest.mark.parametrize("name", ["icm42688p", "ICM-42688-P", "icm 42688_p"])
def test_case_and_punctuation_of_a_name_do_not_matter(name):
    assert find_sensor(name).label == "ICM-42688-P"
    # other names of a chip
    assert find_sensor("MPU9255").label == "MPU-9250"
    assert find_sensor("adis16475-2").label == "ADIS16475"


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
    assert chosen.noise_density == pytest.approx(65e-6 * STANDARD_GRAVITY)


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
