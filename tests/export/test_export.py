"""The folder of exports: what is in it, what is not and why; the numbers and words of all files."""

import math
from dataclasses import replace

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from export.devices import (
    ALLAN_VARIANCE_ROS,
    HOSTILE,
    KALIBR,
    ORB_SLAM3,
    ROS,
    VINS_FUSION,
    device,
    unknown,
    with_sensor,
)
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json, write_json
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.export.densities import for_filter
from imuloop.export.export import (
    FORMATS,
    README,
    export_files,
    listed,
    read_exported,
    write_exports,
)
from imuloop.export.text import number, numbers, written
from imuloop.export.values import values


def test_a_device_of_which_all_is_known_has_all_files():
    files = export_files(device())
    assert set(files) == {each.file for each in FORMATS} | {README}
    assert len({each.file for each in FORMATS}) == len(FORMATS)
    assert "Not written" not in files[README] and "ax: a note" in files[README]
    assert files == export_files(device())


def test_a_device_of_which_nothing_is_known_has_the_reasons():
    files = export_files(unknown())
    assert set(files) == {README}
    lines = files[README].splitlines()
    assert "none" in lines and "accelerometer: nominal (no session could be used)" in lines
    for each in FORMATS:
        line = next(x for x in lines if x.startswith(f"{each.file} ({each.title}): "))
        assert line.partition("): ")[2]


def test_without_a_calibration_there_are_files_of_noise_alone():
    """Protects exports from the data sheet's numbers as if they had been measured."""
    nothing, board = unknown(), device()
    files = export_files(replace(nothing, noise=board.noise, rate_hz=board.rate_hz))
    noise = {KALIBR, VINS_FUSION, ORB_SLAM3, ALLAN_VARIANCE_ROS, ROS}
    assert set(files) == {each.file for each in noise} | {README}
    for each in noise:
        assert "No calibration: the noise is that of samples as logged" in files[each.file]
        assert "apply calibration.json" not in files[each.file]
    for each in {*FORMATS} - noise:
        (line,) = [x for x in files[README].splitlines() if x.startswith(f"{each.file} (")]
        assert "no calibration" in line and "no session could be used" in line


@pytest.mark.parametrize("each", FORMATS, ids=lambda each: each.file)
def test_every_file_says_what_the_calibration_of_a_sensor_lacks(each):
    """Protects the line on a verdict `unexplained`, and on a sensor that was not calibrated."""
    board, names = device(effects=()), ["accelerometer", "gyroscope"]
    of = [name for name in names if name in each.title] or names
    doubted = board
    for name in names:
        doubted = with_sensor(doubted, name, verdict="unexplained")
    for name in of:
        assert f"{name}: unexplained (its errors are larger" in each.text(doubted)
        assert f"{name}: unexplained (its errors are larger" in export_files(doubted)[README]
    assert "unexplained" not in each.text(board)
    if of == names:
        nominal = SensorCalibration.nominal(board.sensor("gyroscope").raw_unit, "no turns")
        calibration = replace(board.calibration, gyroscope=nominal)
        assert each.text(replace(board, calibration=calibration)).count("no turns") == 1


@pytest.mark.parametrize("each", FORMATS, ids=lambda each: each.file)
def test_a_label_stays_on_its_line(each):
    plain, hostile = (each.text(device(label)).splitlines() for label in ("Board A", HOSTILE))
    assert "\n".join(hostile).encode()
    changed = [line for line, other in zip(plain, hostile, strict=True) if line != other]
    assert all("Board A" in line for line in changed)


def test_the_folder_takes_the_place_of_the_old_one(tmp_path):
    folder = tmp_path / "board/exports"
    write_exports(folder, {"old.yaml": "a"})
    write_exports(folder, {"new.yaml": "b\u00b2\n"})
    assert [path.name for path in folder.iterdir()] == ["new.yaml"]
    assert (folder / "new.yaml").read_bytes() == "b²\n".encode()
    assert {path.name for path in folder.parent.iterdir()} == {"exports", "exports.json"}
    assert list(read_json(folder.with_suffix(".json"))["sha256"]) == ["new.yaml"]


def _results(folder, board, rate_hz):
    board.calibration.to_json(folder / "calibration.json")
    noise = board.noise.to_dict() | {"rate_hz": rate_hz, "notes": ["short"], "uncut": None}
    write_json(folder / "noise.json", noise)
    for name, status, rows, rate, span in (
        ("a", "ok", 10, 50.0, [20.0, 31.0]),
        ("b", "ok", 20, 100.0, None),
        ("c", "rejected", 99, None, [-40.0, 85.0]),
    ):
        quality = {"status": status, "rows": rows, "rate_hz": rate, "temperature_range": span}
        write_json(folder / f"{name}.json", quality)
    return folder / "calibration.json", folder / "noise.json", [folder / f"{n}.json" for n in "abc"]


@pytest.mark.parametrize(("of_noise", "expected"), [(200.0, 200.0), (None, 100.0)])
def test_results_are_read_back(tmp_path, of_noise, expected):
    board = device()
    found = read_exported("board", "Board A", *_results(tmp_path, board, of_noise))
    assert (found.rate_hz, found.notes, found.temperature_range) == (
        expected,
        ("short",),
        (20.0, 31.0),
    )
    assert found.noise.axes["gz"].K == board.noise.axes["gz"].K
    assert export_files(found).keys() == export_files(board).keys()


@pytest.mark.parametrize("own", [False, True])
def test_offset_of_a_clock_that_began_apart_is_not_exported(tmp_path, own):
    *results, qualities = _results(tmp_path, device(), None)
    quality = read_json(qualities[0])
    write_json(qualities[0], quality | {"reference": {"clock": {"offset_s": 0.0, "own": own}}})
    effects = [
        {"name": "time_offset", "parameters": {"dt": 0.01}},
        {"name": "clock_drift", "parameters": {"d": 1e-5}},
    ]
    diagnosis = {"sensors": {"gyroscope": {"reference": {"effects": effects}}}}
    write_json(tmp_path / "diagnosis.json", diagnosis)
    found = read_exported("board", "B", *results, qualities, tmp_path / "diagnosis.json")
    assert (("gyroscope", "time_offset") in found.beside) is not own
    assert ("gyroscope", "clock_drift") in found.beside


def test_the_report_links_what_is_there(tmp_path):
    write_exports(tmp_path / "exports", {})
    assert listed(tmp_path / "exports.json") == []
    write_exports(tmp_path / "exports", export_files(device()))
    assert listed(tmp_path / "exports.json") == [(each.file, each.title) for each in FORMATS]


def test_the_docs_have_a_row_for_each_format(repository):
    text = (repository / "docs/exports.md").read_text(encoding="utf-8")
    assert not [each.file for each in FORMATS if f"| `{each.file}` |" not in text]


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_reads_back_as_the_same_float_in_yaml_and_in_c(value):
    text = number(value)
    assert "." in text and yaml.safe_load(text) == float(text) == value
    assert math.copysign(1, float(text)) == math.copysign(1, value)
    assert numbers([[1, 2], [3, 4e-9]]) == "1.0, 2.0, 3.0, 4.0e-09"


@given(st.text())
def test_a_text_that_a_template_writes_stays_a_comment(text):
    line = f"# {written(text)}\n"
    assert line.count("\n") == 1 and yaml.safe_load(f"{line}a: 1\n") == {"a": 1}


def test_the_worst_axis_is_that_of_the_largest_raised_value():
    # more white noise on gy, more flicker on gx
    board = device()
    axes = board.noise.axes
    axes["gx"] = replace(axes["gx"], B=replace(axes["gx"].B, value=3e-4))
    gyroscope = values(board)["gyroscope"]
    worst, estimated = gyroscope["worst"]["N"], gyroscope["calibrated"]["N"]
    assert (worst.axis, worst.raised_from) == ("gx", estimated[0].value)
    assert worst.value > estimated[1].value


def test_a_limit_that_was_raised_is_said_to_be_both():
    limited = Coefficient(upper95=2e-9)
    seen = Coefficient(8e-5, (7e-5, 9e-5), 9e-5, True)
    walk = for_filter(AxisNoise(N=seen, B=seen, K=limited), "gz", "K")
    assert (walk.limit, walk.raised_from) == (True, 2e-9)
    assert walk.words == (
        "gz, not seen: its 95 % upper limit; raised from 2e-09 so that N and K bound its Allan "
        "curve from 0.1 s to 1000 s"
    )
    assert walk.times(10.0).value == 10 * walk.value
    assert walk.times(10.0).raised_from == pytest.approx(2e-8)


def test_a_calibration_of_another_version_is_an_error(tmp_path):
    results = _results(tmp_path, device(), None)
    write_json(results[0], {"format": 99})
    with pytest.raises(ImuloopError, match="format 99"):
        read_exported("board", "Board", *results)
