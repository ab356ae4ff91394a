"""Why there is no pose: no such session, a rejected one, or one without a rest."""

import pandas as pd
import pytest

from imuloop.calibrate.calibrate import told, without_pose
from imuloop.core.samples import CHANNELS
from imuloop.core.segments import segment_table, write_segments


@pytest.fixture
def sessions(tmp_path):
    empty = pd.DataFrame({"t": [], **{c: [] for c in CHANNELS}})
    moving = pd.DataFrame({"t": [0.0, 1.0], **{c: [0.0, 1.0] for c in CHANNELS}})
    tables = {
        "turns": segment_table(empty, [], [], [], []),
        "swing": segment_table(moving, [0.0], [2.0], ["motion"], [-1]),
    }
    for name, table in tables.items():
        write_segments(tmp_path / name, table, {})
    return {n: {"kind": "multi_position", "segments": tmp_path / n} for n in tables}


def test_sessions_are_told_by_what_became_of_them(sessions):
    reason = "no multi_position session with a pose"
    assert without_pose({}, "multi_position") == reason
    assert without_pose(sessions, "six_position") == "no six_position session with a pose"
    assert without_pose(sessions, "multi_position") == (
        f"{reason}: turns was rejected, swing has no rest that is a pose"
    )
    assert told(f"{reason}; bias only", sessions) == (
        f"{reason}: turns was rejected, swing has no rest that is a pose; bias only"
    )


def test_other_reasons_stay_as_they_are(sessions):
    assert told("9 poses found", sessions) == "9 poses found"
    assert told(None, sessions) is None
