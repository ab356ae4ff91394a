"""A planned session is the recording that a device would log of it."""

import numpy as np
import pytest

from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.core.rotation import exponential, matrix
from imuloop.plan.session import (
    FULL_TURN_S,
    Plan,
    full_turns,
    holes,
    planned_recording,
    turns_between,
)
from imuloop.simulate.truth import example_truth

TRUTH = example_truth()
NONE = np.zeros((0, 3))


def calibration():
    sensors = (TRUTH.accelerometer, ACCELERATION_UNIT), (TRUTH.gyroscope, RATE_UNIT)
    made = (SensorCalibration(unit, np.asarray(s.T), s.K, s.b) for s, unit in sensors)
    return Calibration("example", TRUTH.gravity, *made)


def planned(plan, aliased=0.0):
    return planned_recording(plan, calibration(), np.full(6, 1e-6), 100.0, aliased)


def test_holes_lie_opposite_to_poses_and_spread_over_the_sphere():
    np.testing.assert_allclose(holes([[0, 0, 1.0]], 1), [[0, 0, -1]], atol=0.1)
    up = holes(NONE, 12)
    nearest = np.sort(up @ up.T, axis=1)[:, -2]
    # twelve directions could be 63 degrees apart, chosen one by one more than half of that
    assert np.degrees(np.arccos(nearest.max())) > 35


@pytest.mark.parametrize("up", [[[0, 0, 1.0], [0, 0, -1.0]], holes([[1.0, 0, 0]], 8)])
def test_turns_bring_one_direction_after_the_other_up(up):
    for turn, before, after in zip(turns_between(up), up, up[1:], strict=False):
        np.testing.assert_allclose(matrix(exponential(turn)).T @ before, after, atol=1e-12)


def test_a_plan_has_its_poses_rotations_and_temperature():
    up = holes(NONE, 20)
    course = ((0.0, 20.0), (0.5, 40.0), (1.0, 20.0))
    plan = Plan(up[0], turns_between(up), 50.0, 4.0, 2.0, course)
    poses = planned(plan).poses
    assert len(poses) == 20 and len(planned(plan).rotations) == 19
    np.testing.assert_allclose(poses.duration_s, [50.0] + [4.0] * 19)
    np.testing.assert_allclose(poses.n, [5000] + [400] * 19)
    np.testing.assert_allclose(poses.variance, 1e-6)
    force = calibration().accelerometer.apply(poses.f)
    np.testing.assert_allclose(force, TRUTH.gravity * up, atol=1e-9)
    assert poses.end_s[-1] == pytest.approx(plan.duration_s)
    assert 38 < poses.temperature.max() <= 40 and poses.temperature[-1] < 22


def test_a_full_turn_turns_by_360_degrees_about_its_level_axis():
    plan = full_turns(2, 2, holes(NONE, 5))
    made = planned(plan)
    assert plan.duration_s == made.poses.end_s[-1] == 50 + 7 * 4 + 5 * 2 + 2 * FULL_TURN_S
    rates = calibration().gyroscope.apply(made.rotations.w.reshape(-1, 3))
    rates = rates.reshape(made.rotations.w.shape)
    angle = np.einsum("mki,mk->mi", (rates[:, 1:] + rates[:, :-1]) / 2, made.rotations.steps)
    np.testing.assert_allclose(angle[5:], [[0, 0, 2 * np.pi], [0, 0, -2 * np.pi]], atol=1e-3)
    force = calibration().accelerometer.apply(made.poses.f[5:])
    np.testing.assert_allclose(force, [force[0]] * 3, atol=1e-9)
    np.testing.assert_allclose(force[:, 2], 0, atol=1e-9)
