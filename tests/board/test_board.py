"""Which devices and sessions are compared, why others are not, and what the report says."""

import json
from dataclasses import replace

import numpy as np
import pytest

from bench.result_files import fault
from board.boards import ARMS, NAMES, SESSION, calibrated
from imuloop import chain
from imuloop.board.board import relate
from imuloop.core.samples import TIME
from imuloop.report.tables.board import board_part


@pytest.fixture
def made(board):
    return board(2)[0]


@pytest.fixture
def devices(board):
    return board(2)[1]


def written(folder, devices):
    """Return board.json as the stage writes it, its schema held to."""
    board = chain.Device("wing", folder / "boards/wing", {})
    assert chain.board(board, devices) == []
    path = board.file("board.json")
    assert fault(path) is None
    return json.loads(path.read_text())


def test_the_stage_writes_what_its_schema_says_and_the_report_what_it_holds(tmp_path, devices):
    content = written(tmp_path, devices)
    assert content["status"] == "ok" and [*content["devices"]] == [*NAMES]
    assert content["sessions"] == {"poses": {"why": None, "rests": 41, "moves": 40}}
    part = board_part(content, dict.fromkeys(NAMES, "Chip") | {"second": "The second"})
    assert [row[0] for row in part["table"].rows] == ["Chip", "The second", "Chip"]
    place = part["table"].rows[1][1].split("\n")
    assert float(place[0].partition("\u202f")[0]) == pytest.approx(20, abs=0.3)
    assert "consistent" in part["table"].rows[1][3]
    assert sum("no error in common" in text for text in part["texts"]) == 2
    # one alone is no board
    content = written(tmp_path, devices[:1])
    assert content["status"] == "not_testable" and "two needed" in content["why"]


def dated(log, start):
    return log.assign(**{TIME: np.datetime64(start) + (log[TIME] * 1e9).astype("timedelta64[ns]")})


@pytest.mark.parametrize("dates", [None, ("2026-01-01T00:00:00", "2026-01-01T00:00:03.004")])
def test_logs_of_other_begin_and_rate_with_lost_samples_still_compare(
    tmp_path, made, devices, dates
):
    lost = made[0].drop(index=[*range(3500, 3520), *range(50, 14000, 97)])
    late = made[1].iloc[150:-50:2].assign(**{TIME: lambda log: log[TIME] - 2.9963})
    logs = (
        [dated(*pair) for pair in zip((lost, late), dates, strict=True)] if dates else [lost, late]
    )
    content = relate("wing", calibrated(tmp_path, logs, devices))
    assert content["status"] == "ok" and content["sessions"]["poses"]["moves"] in (39, 40)
    second = content["devices"]["second"]
    assert np.all(np.abs(second["arm"] - ARMS[1]) < 4 * second["arm_std"])
    assert second["turn"]["verdict"] == "consistent"


def test_dates_say_which_logs_do_not_overlap(tmp_path, made, devices):
    found = [dated(log, f"2026-01-01T0{k}:00:00") for k, log in enumerate(made[:2])]
    content = relate("wing", calibrated(tmp_path, found, devices))
    assert "not recorded at the same time" in content["sessions"]["poses"]["why"]


def test_other_motions_are_not_compared(tmp_path, made, devices, board):
    other = [made[0], board(1)[0][1]]
    content = written(tmp_path, calibrated(tmp_path, other, devices))
    assert content["status"] == "not_testable"
    assert "do not turn alike" in content["sessions"]["poses"]["why"]


def test_a_session_that_one_device_lacks_is_named(tmp_path, devices):
    renamed = replace(devices[1], kinds={"elsewhere": SESSION})
    folder = devices[1].folder
    (folder / "elsewhere").symlink_to(folder / "poses")
    content = written(tmp_path, [devices[0], renamed])
    assert content["sessions"]["poses"]["why"] == "second has no session of this name"
    assert content["why"] == "no session that its devices share"


def test_a_device_without_a_log_is_left_out(tmp_path, made, devices):
    broken = calibrated(tmp_path, [made[0].iloc[:20]])[0]
    content = written(tmp_path, [replace(broken, name="broken"), *devices[1:]])
    assert content["devices"]["broken"] == {"why": "all its sessions were rejected"}
    assert content["status"] == "ok" and content["reference"] == "second"


def test_too_little_motion_is_a_reason(tmp_path, made, devices):
    still = [log.iloc[:4000] for log in made[:2]]
    content = written(tmp_path, calibrated(tmp_path, still, devices))
    assert content["status"] == "not_testable" and content["why"].startswith("motion of")


def test_what_goes_wrong_is_written_with_the_reason(tmp_path, devices, monkeypatch):
    monkeypatch.setattr("imuloop.board.board.poses", lambda *_: 1 / 0)
    board = chain.Device("wing", tmp_path, {}, log="board.log")
    (failure,) = chain.board(board, devices)
    assert failure.stage == "board" and fault(board.file("board.json")) is None
    assert "division by zero" in json.loads(board.file("board.json").read_text())["why"]
