"""Rests and poses of simulated logs with known truth, and the properties that every log keeps."""

from functools import cache

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from loggers import lose
from segment.logs import frame, pose_log, random_turns, rests_of, rotate

SETTINGS = SegmentSettings()
DEGREE = np.pi / 180


def segment_samples(samples, kind="multi_position", settings=SETTINGS):
    segments, metadata = segment_session(samples, kind, settings)
    return rests_of(segments), metadata


@pytest.mark.parametrize("first", [60.0, 3.0])
def test_rests_are_found_within_a_window_of_the_truth(first):
    samples, truth = pose_log(random_turns(14, 1), [first] + [4.0] * 14)
    rests, metadata = segment_samples(samples)
    assert metadata["poses"] == 15
    spans = rests[["start_s", "end_s"]].to_numpy()
    assert np.all(np.abs(spans - truth) <= SETTINGS.window_s)
    # never any of the turn itself, but for its first and last few hundredths
    assert np.all(spans[1:, 0] >= truth[1:, 0] - 0.05)
    assert np.all(spans[:-1, 1] <= truth[:-1, 1] + 0.05)


def test_a_slow_turn_about_the_vertical_is_no_rest():
    """2 deg/s about gravity for 20 s: no variance, only the mean rate shows it."""
    samples, _ = pose_log([(1.0, 0, 0)], [20.0, 40.0])
    turning = (samples[TIME] > 30) & (samples[TIME] < 50)
    rate = np.outer(turning, [0, np.sin(1.0), np.cos(1.0)]) * 2 * DEGREE
    samples[list(ANGULAR_RATE)] += rate
    rests, _ = segment_samples(samples)
    inside = np.minimum(rests["end_s"], 49) - np.maximum(rests["start_s"], 31)
    assert inside.max() < 0
    # gravity is where it was, but the device is not
    assert rests["pose"].tolist() == [0, 1, 2]
    # without the tolerance only its beginning and its end show
    rests, _ = segment_samples(samples, settings=SegmentSettings(rate_tolerance=1.0))
    assert np.any((rests["start_s"] > 30) & (rests["end_s"] < 50))


@pytest.mark.parametrize("at", [0.3, 0.7])
def test_a_bias_that_jumps_ends_no_rests(at):
    """1 deg/s more from some time on, early or late: a device that turned at it would turn over."""
    samples, truth = pose_log(random_turns(14, 1), [20.0] + [5.0] * 14)
    rests, _ = segment_samples(samples)
    later = samples[TIME] > at * samples[TIME].iloc[-1]
    samples[list(ANGULAR_RATE)] += np.outer(later, [1.0, 0, 0]) * DEGREE
    later_rests, _ = segment_samples(samples)
    assert len(rests) == len(truth) and len(later_rests) >= len(rests)
    missing = set(rests["start_s"].round(1)) - set(later_rests["start_s"].round(1))
    # that in which it jumps is cut in two
    assert len(missing) <= 1


@pytest.mark.parametrize(
    ("turn", "poses"),
    [
        ((0, 0, 2 * np.pi), 2),  # a full turn
        ((0, 0, 0.5), 2),  # about the vertical
        ((0, 0, 0.01), 1),  # a nudge
        ((0.05, 0, 0), 2),  # a tilt of 3 degrees
        ((0.004, 0, 0), 1),  # a tilt of a quarter of a degree
    ],
)
def test_neighbouring_rests_are_one_pose_if_nothing_turned(turn, poses):
    samples, _ = pose_log([turn], [12.0, 12.0])
    # shaken while it turns, so that it is seen at all
    shaken = (samples[TIME] > 12) & (samples[TIME] < 14)
    samples.loc[shaken, "ax"] += 0.5 * np.random.default_rng(5).normal(size=shaken.sum())
    rests, _ = segment_samples(samples)
    assert len(rests) == 2
    assert rests["pose"].nunique() == poses


@pytest.mark.parametrize("lost", [1, 5])
def test_rests_go_on_over_a_few_lost_samples(lost):
    samples, _ = pose_log([(1.0, 0, 0), (0, 1.5, 0)], [20.0, 3.0, 3.0])
    whole, _ = segment_samples(samples)
    thinned = lose(samples, 0.03, np.random.default_rng(lost), [lost])
    segments, _ = segment_session(thinned, "multi_position", SETTINGS)
    assert not (segments["kind"] == "gap").any()
    rests = rests_of(segments)
    assert rests["pose"].tolist() == whole["pose"].tolist()
    for edge in ("start_s", "end_s"):
        np.testing.assert_allclose(rests[edge], whole[edge], atol=0.3)


@pytest.mark.parametrize("kind", ["multi_position", "static"])
def test_a_gap_is_a_row_and_never_bridged(kind):
    samples, _ = pose_log([(1.0, 0, 0)], [20.0, 20.0])
    t = samples[TIME]
    samples = samples[~((t >= 30) & (t < 30.5))].reset_index(drop=True)
    segments, _ = segment_session(samples, kind, SETTINGS)
    gap = segments[segments["kind"] == "gap"]
    np.testing.assert_allclose(gap[["start_s", "end_s"]].to_numpy(), [[30.0, 30.5]])
    assert gap["n"].tolist() == [0]
    if kind == "multi_position":
        assert rests_of(segments)["pose"].tolist() == [0, 1, 2]


def test_quantised_and_constant_channels_still_rest():
    samples, _ = pose_log(random_turns(8, 7), [20.0] + [4.0] * 8)
    f = np.round(samples[list(ACCELERATION)].to_numpy() / 0.05) * 0.05
    w = np.round(samples[list(ANGULAR_RATE)].to_numpy() / 0.01) * 0.01
    for rate in (w, np.zeros_like(w)):
        assert len(segment_samples(frame(samples[TIME].to_numpy(), f, rate))[0]) == 9


@pytest.mark.parametrize("kind", ["static", "multi_position"])
@pytest.mark.parametrize("n", [0, 1, 50])
def test_a_log_too_short_to_judge_is_still_covered(kind, n):
    samples = pose_log([], [1.0])[0][:n]
    segments, _ = segment_session(samples, kind, SETTINGS)
    assert segments["n"].sum() == n


LOG, _ = pose_log(random_turns(6, 8), [12.0] + [3.0] * 6)
LOG = pd.concat([LOG[:2000], LOG[2100:]], ignore_index=True)


@cache
def plain_segments(kind):
    return segment_session(LOG, kind, SETTINGS)[0]


@settings(max_examples=8, deadline=None)
@given(shift=st.floats(-1e6, 1e6), turn=st.tuples(*[st.floats(-3, 3)] * 3))
def test_a_time_shift_or_another_sensor_frame_moves_nothing(shift, turn):
    other = rotate(LOG, Rotation.from_rotvec(turn))
    other[TIME] += shift
    for kind in ("multi_position", "static"):
        moved, _ = segment_session(other, kind, SETTINGS)
        assert moved[["kind", "pose", "n"]].equals(plain_segments(kind)[["kind", "pose", "n"]])
        np.testing.assert_allclose(
            moved["start_s"] - shift, plain_segments(kind)["start_s"], atol=1e-6
        )


@settings(max_examples=15, deadline=None)
@given(
    rests=st.lists(st.floats(0.2, 6), min_size=2, max_size=6),
    gaps=st.lists(st.integers(0, 1500), max_size=4),
    seed=st.integers(0, 1000),
    kind=st.sampled_from(["static", "multi_position"]),
)
def test_every_instant_belongs_to_one_row(rests, gaps, seed, kind):
    samples, _ = pose_log(random_turns(len(rests) - 1, seed), rests, seed)
    keep = np.ones(len(samples), dtype=bool)
    for at in gaps:
        keep[at : at + 7] = False
    if keep.sum() < 2:
        return
    samples = samples[keep].reset_index(drop=True)
    segments, _ = segment_session(samples, kind, SETTINGS)
    t = samples[TIME].to_numpy()
    start, end = segments["start_s"].to_numpy(), segments["end_s"].to_numpy()
    assert start[0] == t[0]
    assert np.array_equal(start[1:], end[:-1])
    assert np.all(end > start)
    assert end[-1] == pytest.approx(t[-1] + 0.01)
    assert segments["n"].sum() == len(t)
    assert np.all(segments.loc[segments["kind"] == "gap", "n"] == 0)
    assert np.all((segments["pose"] >= 0) == (segments["kind"] == "static"))
