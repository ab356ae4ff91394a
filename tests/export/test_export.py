"""The folder of exports: what is in it, what is not and why; the numbers and words of all files."""

from dataclasses import replace

import pytest

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
from imuloop.chain import Device
from imuloop.core.files import read_json, write_json
from imuloop.export.export import (
    FORMATS,
    README,
    export_files,
    listed,
    read_exported,
    write_exports,
)
from imuloop.model.sensor_calibration import SensorCalibration


def test_a_device_of_which_all_is_known_has_all_files(tmp_path):
    files = export_files(device())
    write_exports(tmp_path / "exports", files)
    assert listed(tmp_path / "exports.json") == [(form.file, form.title) for form in FORMATS]
    assert set(files) == {form.file for form in FORMATS} | {README}
    assert len({form.file for form in FORMATS}) == len(FORMATS)
    assert "Not written" not in files[README] and "ax: a note" in files[README]
    assert files == export_files(device())


def test_a_device_of_which_nothing_is_known_has_the_reasons():
    files = export_files(unknown())
    assert set(files) == {README}
    lines = files[README].splitlines()
    assert "none" in lines and "accelerometer: nominal (no session could be used)" in lines
    for form in FORMATS:
        line = next(x for x in lines if x.startswith(f"{form.file} ({form.title}): "))
        assert line.partition("): ")[2]


def test_without_a_calibration_there_are_files_of_noise_alone():
    """Protects exports from the data sheet's numbers as if they had been measured."""
    nothing, board = unknown(), device()
    files = export_files(replace(nothing, noise=board.noise, rate_hz=board.rate_hz))
    noise = {KALIBR, VINS_FUSION, ORB_SLAM3, ALLAN_VARIANCE_ROS, ROS}
    assert set(files) == {form.file for form in noise} | {README}
    for form in noise:
        assert "No calibration: the noise is for samples as logged" in files[form.file]
        assert "apply calibration.json" not in files[form.file]
    for form in {*FORMATS} - noise:
        (line,) = [x for x in files[README].splitlines() if x.startswith(f"{form.file} (")]
        assert "no calibration" in line and "no session could be used" in line


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.file)
def test_every_file_says_what_the_calibration_of_a_sensor_lacks(form):
    """Protects the line on a verdict `unexplained`, and on a sensor that was not calibrated."""
    board, names = device(effects=()), ["accelerometer", "gyroscope"]
    of = [name for name in names if name in form.title] or names
    doubted = board
    for name in names:
        doubted = with_sensor(doubted, name, verdict="unexplained")
    for name in of:
        assert f"{name}: unexplained (its errors are larger" in form.text(doubted)
        assert f"{name}: unexplained (its errors are larger" in export_files(doubted)[README]
    assert "unexplained" not in form.text(board)
    if of == names:
        nominal = SensorCalibration.nominal(board.sensor("gyroscope").raw_unit, "no turns")
        calibration = replace(board.calibration, gyroscope=nominal)
        assert form.text(replace(board, calibration=calibration)).count("no turns") == 1


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.file)
def test_a_label_stays_on_its_line(form):
    plain, hostile = (form.text(device(label)).splitlines() for label in ("Board A", HOSTILE))
    assert "\n".join(hostile).encode()
    changed = [line for line, other in zip(plain, hostile, strict=True) if line != other]
    assert all("Board A" in line for line in changed)


def _results(folder, board, rate_hz):
    board.calibration.to_json(folder / "calibration.json")
    noise = board.noise.to_dict() | {"rate_hz": rate_hz, "notes": ["short"]}
    write_json(folder / "noise.json", noise)
    for name, status, rows, rate, span in (
        ("a", "ok", 10, 50.0, [20.0, 31.0]),
        ("b", "ok", 20, 100.0, None),
        ("c", "rejected", 99, None, [-40.0, 85.0]),
    ):
        quality = {"status": status, "rows": rows, "rate_hz": rate, "temperature_range": span}
        (folder / name).mkdir()
        write_json(folder / name / "quality.json", quality)
    write_json(folder / "diagnosis.json", {"sensors": {}})
    return Device("board", folder, dict.fromkeys("abc"))


@pytest.mark.parametrize(("of_noise", "expected"), [(200.0, 200.0), (None, 100.0)])
def test_results_are_read_back(tmp_path, of_noise, expected):
    board = device()
    exported = read_exported(_results(tmp_path, board, of_noise))
    assert exported.device == exported.label == "board"
    assert (exported.rate_hz, exported.temperature_range) == (expected, (20.0, 31.0))
    assert exported.noise.axes["gz"].K == board.noise.axes["gz"].K and exported.notes == ("short",)


@pytest.mark.parametrize("apart", [False, True])
def test_offset_of_a_clock_that_began_apart_is_not_exported(tmp_path, apart):
    board = _results(tmp_path, device(), None)
    path = board.sessions["a"]["quality"]
    clock = {"offset_s": 0.0, "own": apart}
    write_json(path, read_json(path) | {"reference": {"clock": clock}})
    effect_values = {"time_offset": {"dt": 0.01}, "clock_drift": {"d": 1e-5}}
    effects = [{"name": name, "parameters": values} for name, values in effect_values.items()]
    diagnosis = {"sensors": {"gyroscope": {"reference": {"effects": effects}}}}
    write_json(tmp_path / "diagnosis.json", diagnosis)
    exported = read_exported(board)
    assert (("gyroscope", "time_offset") in exported.reference) is not apart
    assert ("gyroscope", "clock_drift") in exported.reference


def test_the_docs_have_a_row_for_each_format(repository):
    text = (repository / "docs/exports.md").read_text(encoding="utf-8")
    assert not [form.file for form in FORMATS if f"| `{form.file}` |" not in text]
