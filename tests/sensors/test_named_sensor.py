"""A sensor by its name: in a config, on the command line and in Python."""

import json

import numpy as np
import pytest
import yaml

import imuloop
from calibrate.devices import plan_session
from imuloop.__main__ import main
from imuloop.config import resolve
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from imuloop.sensors import GENERIC, find_sensor
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from quick import hurry

COUNTS = {"acceleration": "count", "angular_rate": "count"}
RANGES = {"acceleration": "16 g", "angular_rate": "2000 deg/s"}
NAMED = {"sensor": "icm42688p", "range": RANGES}
SCALES = {"acceleration": STANDARD_GRAVITY / 2048, "angular_rate": DEGREE / 16.384}
OPTIONS = [f"--units.{quantity}=count" for quantity in COUNTS]
CHOSEN = [f"--range.{quantity}={name}" for quantity, name in RANGES.items()]
QUICK = {"diagnose": {"folds": 3}}
SHEET = find_sensor("icm42688p")


@pytest.fixture(scope="module")
def log():
    truth = plan_session(example_truth(rate=50.0), poses=6, initial_rest_s=12.0)
    return simulate_session(truth, "multi_position", 1)


@pytest.fixture(scope="module")
def counts(log, tmp_path_factory):
    """Return the path of the log in counts of the ranges."""
    table = log.copy()
    for names, scale in zip((ACCELERATION, ANGULAR_RATE), SCALES.values(), strict=True):
        table[list(names)] = np.round(table[list(names)] / scale)
    path = tmp_path_factory.mktemp("counts") / "counts.csv"
    table.to_csv(path, index=False)
    return path


def resolve_device(text):
    sessions = "sessions: {a: {kind: static, file: a.csv}}"
    return resolve(yaml.safe_load(f"devices: {{imu: {{{text}, {sessions}}}}}"))["imu"]


# keys of a device; scale and full scale of its acceleration, tolerance and noise of its
# accelerometer: None for the data sheet's
FULL, WHITE = 16 * STANDARD_GRAVITY, 65e-6 * STANDARD_GRAVITY
BOTH = "sensor: ICM-42688-P, range: {acceleration: 16 g}"
TABLE = [
    (BOTH, SCALES["acceleration"], FULL, {}, WHITE),
    (f"{BOTH}, full_scale: {{acceleration: 50}}", SCALES["acceleration"], 50, {}, WHITE),
    (f"{BOTH}, nominal: {{acceleration: {{scale: 0.5}}}}", 0.5, FULL, {}, WHITE),
    (
        f"{BOTH}, nominal: {{acceleration: {{tolerance: {{bias: 0.2}}}}}}",
        *(SCALES["acceleration"], FULL, {"bias": 0.2}, WHITE),
    ),
    # a log in SI needs no range
    ("sensor: icm42688p", None, None, {}, WHITE),
]


@pytest.mark.parametrize(("keys", "scale", "full_scale", "stated", "noise"), TABLE)
def test_a_name_in_a_config_gives_what_is_not_stated(keys, scale, full_scale, stated, noise):
    device = resolve_device(keys)
    tolerance = vars(SHEET.accelerometer.tolerance) | stated
    assert device["nominal"]["acceleration"].get("scale") == pytest.approx(scale)
    assert device["full_scale"].get("acceleration") == pytest.approx(full_scale)
    assert device["tolerances"]["accelerometer"] == pytest.approx(tolerance)
    assert device["data_sheet"]["sensor"] == "ICM-42688-P"
    assert device["data_sheet"]["noise"]["accelerometer"] == pytest.approx(noise)


def test_what_no_data_sheet_gives_is_that_of_a_mems_sensor():
    device = resolve_device("nominal: {angular_rate: {tolerance: {bias: 0.1}}}")
    expected = vars(GENERIC["gyroscope"]) | {"bias": 0.1}
    assert device["tolerances"] == {"gyroscope": expected}
    assert not (device["nominal"] or device["full_scale"] or device["data_sheet"])
    single = resolve_device("sensor: adis16460")
    assert {*single["nominal"]} == {*single["full_scale"]} == {*COUNTS}
    # a part without a gyroscope says nothing of one
    assert {*resolve_device("sensor: fxos8700")["tolerances"]} == {"accelerometer"}


def test_counts_without_a_range_are_refused_in_python(counts):
    with pytest.raises(ImuloopError, match=r"range=\{'acceleration': …\}, one of 2 g, 4 g"):
        imuloop.read(counts, units=COUNTS, sensor="icm42688p")


@pytest.mark.parametrize(
    ("options", "remedy"),
    [
        (["--sensor=icm42688p", *CHOSEN], "--units.acceleration count; see"),
        ([], "--units.acceleration count, and --nominal.acceleration.scale; see"),
    ],
    ids=["sensor", "none"],
)
def test_counts_that_are_not_declared_are_asked_for(counts, options, remedy, capsys):
    assert main(["info", str(counts), *options]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert f"whole numbers that look like counts; declare {remedy}" in said


def test_an_earlier_calibration_is_kept_where_the_log_shows_no_more(log, tmp_path):
    with hurry("device"):
        first = imuloop.calibrate(
            *(log["t"], log[[*ACCELERATION]], log[[*ANGULAR_RATE]]),
            **{"folder": tmp_path / "first", "settings": QUICK, "progress": False},
        )
        rest = log[log["t"] < 12]
        later = imuloop.calibrate(
            *([], None, None),
            static=(rest["t"], rest[[*ACCELERATION]], rest[[*ANGULAR_RATE]]),
            **{"prior": tmp_path / "first/calibration.json", "progress": False},
        )
    for sensor in ("accelerometer", "gyroscope"):
        before, after = (getattr(r.calibration, sensor) for r in (first, later))
        for matrix in "TK" if sensor == "gyroscope" else "TKb":
            assert getattr(after, matrix) == pytest.approx(getattr(before, matrix))


def test_noise_stands_beside_the_figure_of_the_data_sheet(counts, capsys):
    assert main(["noise", str(counts), *OPTIONS, "--sensor=icm42688p", *CHOSEN]) == 0
    printed = capsys.readouterr().out
    assert "(velocity random walk); data sheet 65 (typical)" in printed
    # 2.8 mdps/√Hz
    assert "(angle random walk); data sheet 0.17 (typical)" in printed


def test_the_prior_and_the_report_are_those_of_the_data_sheet(log, tmp_path, blank_figures):
    stated = {"angular_rate": {"tolerance": {"misalignment": 0.05}}}
    with hurry("device"):
        result = imuloop.calibrate(
            *(log["t"], log[[*ACCELERATION]], log[[*ANGULAR_RATE]]),
            **(NAMED | {"nominal": stated, "folder": tmp_path, "settings": QUICK}),
            progress=False,
        )
    assert "sensor ICM-42688-P" in str(result)
    content = json.loads((tmp_path / "calibration.json").read_text())
    for sensor, misalignment in (("accelerometer", 0.01), ("gyroscope", 0.05)):
        prior, sheet = content[sensor]["prior"], getattr(SHEET, sensor).tolerance
        assert prior["source"] == "data sheet"
        expected = {"T": misalignment, "K": sheet.scale_factor, "b": sheet.bias}
        for name, std in prior["std"].items():
            assert std == pytest.approx(expected[name[0]])
    page = result.report(tmp_path / "report.html").read_text("utf-8")
    assert "Sensor: ICM-42688-P." in page and "data sheet 65 (typical)" in page


def test_the_table_is_printed_and_a_sensor_of_it(capsys):
    assert main(["sensors"]) == 0
    assert "icm42688p   TDK InvenSense      data sheet  2/4/8/16 g, " in capsys.readouterr().out
    assert main(["sensors", "ICM-42688-P"]) == 0
    assert "  16 g   0.0047884        65.0\n" in capsys.readouterr().out
    assert main(["sensors", "gyrometer"]) == 1
    assert "'gyrometer' is not a sensor of the table" in capsys.readouterr().err
