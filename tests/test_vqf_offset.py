"""bench/vqf_offset: an offset that is known lowers the filter's error, and only with its sign."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, RotationSpline

pytest.importorskip("vqf", reason="the package vqf is not installed")
from bench.vqf_offset import before_and_after

RATE, LATE = 200.0, 0.006


@pytest.fixture(scope="module")
def trial():
    """A sensor turned for a minute, its stamps `LATE`, the reference not seen for half a second."""
    t = np.arange(0, 60, 1 / RATE)
    knots = np.arange(-1, 62, 0.5)
    angles = np.random.default_rng(5).normal(0, 0.6, (len(knots), 3))
    true = RotationSpline(knots, Rotation.from_rotvec(angles))
    at = true(t - LATE)
    quaternions = true(t).as_quat(scalar_first=True)
    quaternions[4000:4100] = np.nan
    return {
        "sampling_rate": np.array([[RATE]]),
        "imu_gyr": true(t - LATE, 1),
        "imu_acc": at.inv().apply([0, 0, 9.81]),
        "imu_mag": at.inv().apply([0, 20.0, -45.0]),
        "opt_quat": quaternions,
        "movement": (t > 5).astype(np.uint8)[:, None],
    }


def test_a_known_offset_lowers_the_error(trial):
    before, offset_alone, both, opposite = before_and_after(trial, -LATE)
    assert both < offset_alone < before < opposite
    # the remaining error is the filter's
    assert both < 0.2 * before
