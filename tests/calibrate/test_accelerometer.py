"""Multi-position accelerometer: derivative, exact data, what poses cannot determine."""

from dataclasses import replace

import numpy as np
import pytest
from imuloop.calibrate.pose_fits import AccelerometerPoses, direction_unknown

from calibrate.devices import ACCELERATION_UNIT, IndependentMeans, known_noise, poses_of, slopes
from imuloop.calibrate.accelerometer import AccelerometerModel
from imuloop.calibrate.calibrate import calibrate_accelerometer
from imuloop.calibrate.least_squares import SINGULAR
from imuloop.calibrate.recording import Recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.simulate.truth import example_truth

G = 9.80665
TRUTH = np.array([0.01, -0.02, 0.015, 1.01, 0.98, 1.003, 0.1, -0.2, 0.3])
SENSOR = AccelerometerPoses(IndependentMeans(1e-8), G, ACCELERATION_UNIT, CalibrateSettings())


def poses_at(directions, truth=TRUTH):
    """Return poses of a device of known errors at given upward directions."""
    u = np.asarray(directions, dtype=float)
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    T = np.eye(3)
    T[(0, 0, 1), (1, 2, 2)] = truth[:3]
    return poses_of(np.linalg.solve(T, G * u.T).T / truth[3:6] + truth[6:])


def spread(n=30, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 3))


def calibrated(poses, noise):
    return calibrate_accelerometer(poses, noise, G, ACCELERATION_UNIT, CalibrateSettings())


@pytest.mark.parametrize("truth", [TRUTH, np.repeat([0.0, 1.0, 0.0], 3)])
def test_exact_poses_give_the_truth_exactly(truth):
    found = SENSOR.fit(Recording(poses_at(spread(), truth)))
    np.testing.assert_allclose(found.fit.x, truth, atol=1e-10)


def test_poses_weighted_beyond_rounding_are_a_reason_and_no_failure():
    """Three poses of a deaf channel and 13 others; measured of 14 poses of a fuzzed log."""
    poses = poses_at(spread(16))
    poses = replace(poses, f=poses.f + np.random.default_rng(1).normal(0, 0.3, poses.f.shape))
    made = calibrated(poses, IndependentMeans(np.where(np.arange(16) < 3, 1e-34, 1e-6)))
    assert made.method == "nominal"
    assert made.not_testable == SINGULAR


def test_the_derivative_is_that_of_differences():
    rng = np.random.default_rng(3)
    for columns, tolerance in ((0, 1e-7), (2, 2e-3)):
        # an effect's own dependence on K and b is left out: its design is given
        design = rng.normal(size=(12, 3, columns)) * 1e-2
        model = AccelerometerModel(poses_at(spread(12)).f, design, G)
        x = np.concatenate([TRUTH, [0.3, -0.2][:columns]])
        numeric = slopes(lambda x, model=model: model.residuals(x)[0], x)
        np.testing.assert_allclose(model.residuals(x)[1], numeric, atol=tolerance)


def test_the_covariance_of_residuals_is_that_of_simulated_means():
    poses = poses_at(spread(12))
    rng = np.random.default_rng(5)
    root = rng.normal(size=(3, 12, 12)) * 1e-3
    model = AccelerometerModel(poses.f, np.zeros((12, 3, 0)), G)
    drawn = np.einsum("aij,daj->dia", root, rng.normal(size=(20000, 3, 12)))
    noisy = [AccelerometerModel(poses.f + d, model.design, G).residuals(TRUTH)[0] for d in drawn]
    predicted = model.covariance(TRUTH, root @ np.swapaxes(root, 1, 2))
    np.testing.assert_allclose(np.cov(np.transpose(noisy)), predicted, atol=0.05 * predicted.max())


@pytest.mark.parametrize(
    ("directions", "reason"),
    [
        (spread(9), "9 poses found, at least 10 needed"),
        (spread(9)[:1], "1 pose found, at least 10 needed"),
        (spread(40) * [1, 1, 0.01], "do not determine 9 parameters: condition number"),
        (np.tile([[0, 0, 1], [0, 0, -1]], (10, 1)), "do not determine 9 parameters"),
        (spread(40) * [1, 1, 0], "condition number beyond 1e9, at most 100 allowed"),
    ],
)
def test_poses_that_determine_too_little_are_refused_with_the_reason(directions, reason):
    noise = known_noise(example_truth())
    found = calibrated(poses_at(directions), noise)
    assert found.method == "nominal" and reason in found.not_testable
    # their direction of gravity is no better
    assert found.not_testable in direction_unknown(found)
    known = calibrated(poses_at(spread(12)), noise)
    assert known.not_testable is None and direction_unknown(known) is None


@pytest.mark.parametrize("unit", [1.0, 9.8])
def test_poses_that_lie_on_no_ellipsoid_are_refused(unit):
    poses = poses_at(spread())
    changed = replace(poses, f=poses.f + 5.0 * (np.arange(30) > 15)[:, None])
    noise = IndependentMeans(1e-8 / unit**2)
    for made, reason in ((poses, ""), (changed, "lies on no ellipsoid")):
        found = calibrated(replace(made, f=made.f / unit), noise)
        assert reason in (found.not_testable or "")
        assert found.method == ("nominal" if reason else "multi_position")
