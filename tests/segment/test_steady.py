"""Rests in the hand and slow turns about the vertical among true rests, with known truth."""

import numpy as np
import pytest
from scipy.signal import butter, sosfilt
from scipy.spatial.transform import Rotation

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from segment.logs import G, pose_log, random_turns, rests_of

SETTINGS = SegmentSettings()
DEGREE = np.pi / 180
# every fourth of 21 poses is spoilt, never the first
SPOILT = np.arange(1, 21, 4)


def g_sensitive_log(seed):
    """Return a log of 21 poses, a gyroscope of 0.3 deg/s per g on every axis, and the rests."""
    samples, truth = pose_log(random_turns(20, seed), [20.0] + [4.0] * 20, seed)
    direction = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    f = samples[list(ACCELERATION)].to_numpy() / G
    samples[list(ANGULAR_RATE)] += f @ direction * 0.3 * DEGREE
    return samples, truth


def tremor(n, rng, low=8.0, high=12.0):
    """Return band-limited angular rate of 0.5 deg/s root mean square on each axis, at 100 Hz."""
    sections = butter(2, [low, high], "bandpass", fs=100.0, output="sos")
    x = sosfilt(sections, rng.normal(size=(n + 200, 3)), axis=0)[200:]
    return 0.5 * DEGREE * x / x.std(axis=0)


def hand(n, rng):
    """Return a hand as the MPU-9150 logs show it: nearly flat up to 12 Hz."""
    return tremor(n, rng, 0.3, 12.0)


def slow_turn(n, rng):
    """Return one turn and back about an axis: 0.25 deg/s at most, over all of the rest."""
    axis = rng.normal(size=3)
    return np.outer(np.sin(2 * np.pi * np.arange(n) / n), axis / np.linalg.norm(axis)) / 4 * DEGREE


def spoil_rests(samples, rests, motion, seed):
    """Add a motion to rests; the slow turn about gravity, seen by nothing else."""
    samples, rng = samples.copy(), np.random.default_rng(seed)
    for start, end in rests:
        inside = np.flatnonzero((samples[TIME] >= start - 0.1) & (samples[TIME] < end + 0.1))
        samples.loc[inside, list(ANGULAR_RATE)] += motion(len(inside), rng)
    return samples


def rest_seconds(segments, truth):
    """Return the seconds of each true rest that are rest in the segments."""
    rests = rests_of(segments)
    start, end = rests["start_s"].to_numpy(), rests["end_s"].to_numpy()
    overlap = np.minimum(end, truth[:, 1:]) - np.maximum(start, truth[:, :1])
    return np.maximum(overlap, 0).sum(axis=1)


@pytest.mark.parametrize("motion", [tremor, hand, slow_turn])
def test_rests_in_the_hand_are_told_from_true_rests(motion):
    samples, truth = g_sensitive_log(0)
    plain = segment_session(samples, "multi_position", SETTINGS)[0]
    disturbed = spoil_rests(samples, truth[SPOILT], motion, 0)
    segments, metadata = segment_session(disturbed, "multi_position", SETTINGS)
    seconds = rest_seconds(segments, truth)
    true = np.setdiff1d(np.arange(21), SPOILT)
    # within a quarter of a second, as other multiples may be chosen
    assert np.all(seconds[true] > rest_seconds(plain, truth)[true] - 0.25)
    assert metadata["hand_held"] and metadata["poses"] == 21
    rests = rests_of(segments)
    in_hand = np.isin(np.arange(21), SPOILT)
    assert np.array_equal(rests["tilt_rad"] > 0, in_hand)
    # the turn within a rest is above the error that it makes in the rate
    names = [f"{channel}_mean" for channel in ANGULAR_RATE]
    error = (rests[names].to_numpy() - rests_of(plain)[names].to_numpy())[SPOILT]
    allowed = np.sqrt(12) * rests["tilt_rad"] / (rests["end_s"] - rests["start_s"])
    assert np.all(np.linalg.norm(error, axis=1) < 2 * allowed.to_numpy()[SPOILT])


def test_a_slow_turn_at_the_end_of_a_rest_is_cut_and_the_rest_stays():
    samples, truth = g_sensitive_log(7)
    at = (samples[TIME] >= truth[5, 1] - 1.2) & (samples[TIME] < truth[5, 1])
    f = samples.loc[at, list(ACCELERATION)].mean().to_numpy()
    samples.loc[at, list(ANGULAR_RATE)] += 0.25 * DEGREE * f / np.linalg.norm(f)
    segments, metadata = segment_session(samples, "multi_position", SETTINGS)
    assert metadata["poses"] == 21
    assert 2.0 < rest_seconds(segments, truth)[5] < 3.2
    assert segments[segments["pose"] == 5]["end_s"].item() < truth[5, 1] - 0.9


def test_a_session_that_needs_its_unsteady_rests_keeps_them():
    """Eleven rests, four of them in the hand: the other seven do not determine nine parameters."""
    samples, truth = pose_log(random_turns(10, 5), [8.0] * 11)
    spoiled = spoil_rests(samples, truth[2:10:2], tremor, 1)
    segments, metadata = segment_session(spoiled, "multi_position", SETTINGS)
    assert metadata["poses"] == 11
    assert rest_seconds(segments, truth)[2:10:2].min() > 5
