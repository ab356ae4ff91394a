"""Rests that are too short: what other settings would bring is tried, not guessed."""

from dataclasses import replace

import pytest

from calibrate.devices import planned
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth

SETTINGS = SegmentSettings()


def short_rests(rest_s, poses=60):
    truth = planned(example_truth(), poses=poses, initial_rest_s=20.0, rest_s=rest_s)
    return simulate_session(truth, "multi_position", 4)


@pytest.mark.parametrize("rest_s", [(0.7, 0.7), (1.5, 2.0)])
def test_what_shorter_settings_bring_is_what_they_find(rest_s):
    log = short_rests(rest_s)
    _, metadata = segment_session(log, "multi_position", SETTINGS)
    found = metadata["shorter"]
    # they are taken where those asked for do not find the ten that a calibration needs
    assert found["taken"] == (found["now"] < 10) == (rest_s[0] < 1)
    assert found["now"] < 30
    assert metadata["poses"] == (found["attitudes"] if found["taken"] else found["now"])
    other = replace(SETTINGS, **{key: found[key] for key in ("window_s", "shortest_rest_s")})
    _, better = segment_session(log, "multi_position", other)
    assert better["poses"] == pytest.approx(found["attitudes"], abs=1)
    assert found["attitudes"] >= 58
    assert better["shorter"] is None


def test_a_session_of_long_rests_needs_none():
    log = short_rests((3.0, 6.0), poses=12)
    assert segment_session(log, "multi_position", SETTINGS)[1]["shorter"] is None
