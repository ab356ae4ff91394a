"""The folder of exports: what is in it, what is not and why, written in one step."""

import stat

import pytest

from export.devices import HOSTILE, device, unknown
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json, write_json
from imuloop.export.export import (
    FORMATS,
    README,
    export_files,
    listed,
    read_exported,
    write_exports,
)


def test_a_device_of_which_all_is_known_has_all_files():
    files = export_files(device())
    assert set(files) == {each.FILE for each in FORMATS} | {README}
    assert len({each.FILE for each in FORMATS}) == len(FORMATS)
    assert "Not written" not in files[README]
    assert "ax: a note" in files[README]


def test_a_device_of_which_nothing_is_known_has_the_reasons():
    files = export_files(unknown())
    assert set(files) == {README}
    lines = files[README].splitlines()
    assert "none" in lines
    for each in FORMATS:
        line = next(x for x in lines if x.startswith(f"{each.FILE} ({each.TITLE}): "))
        assert line.partition("): ")[2]
    assert "accelerometer: nominal (no session could be used)" in lines


@pytest.mark.parametrize("each", FORMATS, ids=lambda each: each.FILE)
def test_a_label_stays_on_its_line(each):
    plain, hostile = (each.text(device(label)).splitlines() for label in ("Board A", HOSTILE))
    assert len(plain) == len(hostile)
    assert "\n".join(hostile).encode()
    changed = [line for line, other in zip(plain, hostile, strict=True) if line != other]
    assert all("Board A" in line for line in changed)


@pytest.mark.parametrize("each", FORMATS, ids=lambda each: each.FILE)
def test_the_same_bytes_again(each):
    assert each.text(device()) == each.text(device())


def test_the_folder_takes_the_place_of_the_old_one(tmp_path):
    folder = tmp_path / "board/exports"
    write_exports(folder, {"old.yaml": "a"})
    write_exports(folder, {"new.yaml": "b\u00b2\n"})
    assert [path.name for path in folder.iterdir()] == ["new.yaml"]
    assert (folder / "new.yaml").read_bytes() == "b²\n".encode()
    assert {path.name for path in folder.parent.iterdir()} == {"exports", "exports.json"}
    assert list(read_json(folder.with_suffix(".json"))["sha256"]) == ["new.yaml"]
    assert stat.S_IMODE(folder.stat().st_mode) & stat.S_IXUSR


def test_a_write_that_fails_leaves_the_old_folder(tmp_path):
    folder = tmp_path / "exports"
    write_exports(folder, {"old.yaml": "a"})
    with pytest.raises(OSError, match="name too long"):
        write_exports(folder, {"new.yaml": "b", "x" * 300: "c"})
    assert [path.name for path in folder.iterdir()] == ["old.yaml"]
    assert list(read_json(folder.with_suffix(".json"))["sha256"]) == ["old.yaml"]
    assert {path.name for path in tmp_path.iterdir()} == {"exports", "exports.json"}


def test_what_a_killed_run_left_is_removed(tmp_path):
    (tmp_path / ".exports.abc").mkdir()
    write_exports(tmp_path / "exports", {"a": "b"})
    assert {path.name for path in tmp_path.iterdir()} == {"exports", "exports.json"}


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
    assert found.rate_hz == expected
    assert found.notes == ("short",)
    assert found.temperature_range == (20.0, 31.0)
    assert found.density("gz", "K") == board.density("gz", "K")
    assert export_files(found).keys() == export_files(board).keys()


def test_a_device_without_a_session_is_read(tmp_path):
    results = _results(tmp_path, unknown(), None)
    assert read_exported("board", "Board", *results[:2], results[2][2:]).rate_hz is None


def test_a_calibration_of_another_version_is_told(tmp_path):
    results = _results(tmp_path, device(), None)
    write_json(results[0], {"format": 99})
    with pytest.raises(ImuloopError, match="format 99"):
        read_exported("board", "Board", *results)


def test_the_report_links_what_is_there(tmp_path):
    write_exports(tmp_path / "exports", {})
    assert listed(tmp_path / "exports.json") == []
    write_exports(tmp_path / "exports", export_files(device()))
    assert listed(tmp_path / "exports.json") == [(each.FILE, each.TITLE) for each in FORMATS]


def test_the_docs_have_a_row_for_each_format(repository):
    text = (repository / "docs/exports.md").read_text(encoding="utf-8")
    assert not [each.FILE for each in FORMATS if f"| `{each.FILE}` |" not in text]
