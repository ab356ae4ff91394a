"""Measured logs whose short rests drift as a walk would, which such rests cannot tell."""

import numpy as np
import pytest

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.noise.axis import estimate_axis
from imuloop.noise.modes import modes
from imuloop.noise.records import RecordedSession, record_of
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from segment.logs import carlsson_array, xsens


def assert_no_walk_by_another_name(samples, axis):
    """Assert that no process lasts longer than rests show, and that all intervals hold values."""
    segments, _ = segment_session(samples, "multi_position", SegmentSettings())
    record = record_of(RecordedSession("poses", "multi_position", samples, segments))
    basis = modes(record.cycles)
    noise = estimate_axis(basis, record.signals(axis), NoiseSettings()).noise
    assert noise.N.identifiable and noise.N.ci95[0] < noise.N.value < noise.N.ci95[1]
    for process in noise.gauss_markov:
        assert process.tc.value < basis.level / 5
        for c in (process.q, process.tc):
            assert 0 <= c.ci95[0] <= c.value <= c.ci95[1] < np.inf


# each with the axis whose rests drift most
@pytest.mark.parametrize(
    ("experiment", "chip", "axis"), [(1, 1, "ay"), (1, 6, "ax"), (1, 7, "ay"), (5, 6, "ax")]
)
def test_rests_of_the_array_that_drift(recordings, experiment, chip, axis):
    assert_no_walk_by_another_name(carlsson_array(recordings, experiment, chip), axis)


@pytest.mark.parametrize("seed", [0, 5, 8])
def test_half_a_count_of_dither(recordings, seed):
    samples, rng = xsens(recordings), np.random.default_rng(seed)
    for axes, counts in ((ACCELERATION, 415), (ANGULAR_RATE, 4768)):
        x = np.rint(samples[list(axes)].to_numpy() * counts)
        samples[list(axes)] = np.rint(x + rng.choice([-0.5, 0.5], x.shape)) / counts
    assert_no_walk_by_another_name(samples, "az")
