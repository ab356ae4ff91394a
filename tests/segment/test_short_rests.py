"""Rests that are too short: what other settings would bring is tried, not guessed."""

from dataclasses import replace

from calibrate.devices import plan_session
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth

SETTINGS = SegmentSettings()


def short_rests(rest_s, poses=60):
    truth = plan_session(example_truth(), poses=poses, initial_rest_s=20.0, rest_s=rest_s)
    return simulate_session(truth, "multi_position", 4)


def test_rests_that_are_too_short_are_found_if_a_calibration_needs_them():
    log = short_rests((0.7, 0.7))
    _, metadata = segment_session(log, "multi_position", SETTINGS)
    assert metadata["poses"] >= 58 and metadata["short_rests"] >= 5
    other = replace(SETTINGS, **metadata["shorter"])
    _, better = segment_session(log, "multi_position", other)
    assert better["poses"] == metadata["poses"] and better["shorter"] is None


def test_a_session_of_enough_long_rests_needs_none():
    metadata = segment_session(short_rests((1.5, 2.0)), "multi_position", SETTINGS)[1]
    assert metadata["shorter"] is None and metadata["poses"] >= 12
