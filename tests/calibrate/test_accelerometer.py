"""Multi-position accelerometer: derivative, exact data, what poses cannot determine."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import ACCELERATION_UNIT, known_noise
from imuloop.calibrate.accelerometer import (
    AccelerometerModel,
    fit_accelerometer,
    lost_accelerometer,
    untestable_accelerometer,
)
from imuloop.calibrate.calibrate import calibrate_accelerometer
from imuloop.calibrate.least_squares import SINGULAR
from imuloop.calibrate.pose_fits import direction_unknown
from imuloop.calibrate.poses import Poses
from imuloop.calibrate.recording import Recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.simulate.truth import example_truth

G = 9.80665
TRUTH = np.array([0.01, -0.02, 0.015, 1.01, 0.98, 1.003, 0.1, -0.2, 0.3])


def poses_at(directions):
    """Return poses of a device of known errors at given upward directions."""
    u = np.asarray(directions, dtype=float)
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    T = np.eye(3)
    T[(0, 0, 1), (1, 2, 2)] = TRUTH[:3]
    f = np.linalg.solve(T, G * u.T).T / TRUTH[3:6] + TRUTH[6:]
    n = len(f)
    start = np.arange(n) * 10.0
    return Poses(
        np.zeros(n, int), np.zeros(n, int), start, start + 5, np.full(n, 5.0), np.full(n, 500), f,
        np.zeros((n, 3)), np.full((n, 6), 1e-6), None,
    )  # fmt: skip


def spread(n=30, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 3))


def white(n):
    return np.broadcast_to(np.eye(n) * 1e-8, (3, n, n))


def test_exact_poses_give_the_truth_exactly():
    fit, _ = fit_accelerometer(Recording(poses_at(spread())), white(30), G)
    np.testing.assert_allclose(fit.x, TRUTH, atol=1e-10)


def test_ideal_poses_give_identity():
    u = spread()
    u *= G / np.linalg.norm(u, axis=1, keepdims=True)
    fit, _ = fit_accelerometer(Recording(replace(poses_at(u), f=u)), white(30), G)
    np.testing.assert_allclose(fit.x, [0, 0, 0, 1, 1, 1, 0, 0, 0], atol=1e-10)


def test_poses_weighted_beyond_rounding_are_a_reason_and_no_failure(monkeypatch):
    """Three poses of a deaf channel and 13 others; measured of 14 poses of a fuzzed log."""
    variance = np.where(np.arange(16) < 3, 1e-34, 1e-6)
    covariance = np.broadcast_to(np.diag(variance), (6, 16, 16))
    monkeypatch.setattr(Poses, "mean_covariance", lambda self, noise: covariance)
    monkeypatch.setattr(Poses, "unknown_noise", lambda self, noise, channels: None)
    poses = poses_at(spread(16))
    poses = replace(poses, f=poses.f + np.random.default_rng(1).normal(0, 0.3, poses.f.shape))
    made = calibrate_accelerometer(poses, None, G, ACCELERATION_UNIT, CalibrateSettings())
    assert made.method == "nominal"
    assert made.not_testable == SINGULAR


def test_the_derivative_is_that_of_differences():
    rng = np.random.default_rng(3)
    model = AccelerometerModel(poses_at(spread(12)).f, rng.normal(size=(12, 3, 2)) * 1e-2, G)
    x = np.concatenate([TRUTH, [0.3, -0.2]])
    numeric = [
        (model.residuals(x + h)[0] - model.residuals(x - h)[0]) / 2e-6
        for h in np.eye(len(x)) * 1e-6
    ]
    # the effect's own dependence on K and b is left out: its design is given
    np.testing.assert_allclose(model.residuals(x)[1], np.transpose(numeric), atol=2e-3)
    base = AccelerometerModel(model.y, np.zeros((12, 3, 0)), G)
    numeric = [
        (base.residuals(x[:9] + h)[0] - base.residuals(x[:9] - h)[0]) / 2e-6
        for h in np.eye(9) * 1e-6
    ]
    np.testing.assert_allclose(base.residuals(x[:9])[1], np.transpose(numeric), atol=1e-7)


def test_the_covariance_of_residuals_is_that_of_simulated_means():
    poses = poses_at(spread(12))
    rng = np.random.default_rng(5)
    root = rng.normal(size=(3, 12, 12)) * 1e-3
    means = root @ np.swapaxes(root, 1, 2)
    model = AccelerometerModel(poses.f, np.zeros((12, 3, 0)), G)
    drawn = np.einsum("aij,daj->dia", root, rng.normal(size=(20000, 3, 12)))
    noisy = [AccelerometerModel(poses.f + d, model.design, G).residuals(TRUTH)[0] for d in drawn]
    predicted = model.covariance(TRUTH, means)
    np.testing.assert_allclose(np.cov(np.transpose(noisy)), predicted, atol=0.05 * predicted.max())


def test_permuted_axes_permute_scale_factor_and_bias():
    # T is triangular in the order of the axes, so only a device without misalignment can permute
    poses = poses_at(spread())
    u = spread()
    u *= G / np.linalg.norm(u, axis=1, keepdims=True)
    order = [2, 0, 1]
    f = u / TRUTH[3:6] + TRUTH[6:]
    base = fit_accelerometer(Recording(replace(poses, f=f)), white(30), G)[0].x
    permuted = fit_accelerometer(Recording(replace(poses, f=f[:, order])), white(30), G)[0].x
    np.testing.assert_allclose(permuted[3:6], base[3:6][order], atol=1e-9)
    np.testing.assert_allclose(permuted[6:9], base[6:9][order], atol=1e-9)


@pytest.mark.parametrize(
    ("directions", "reason"),
    [
        (spread(9), "9 poses found, at least 10 needed"),
        (spread(40) * [1, 1, 0.01], "do not determine 9 parameters: condition number"),
        (np.tile([[0, 0, 1], [0, 0, -1]], (10, 1)), "do not determine 9 parameters"),
        (np.abs(spread(40)) * [0.05, 0.05, 1], "do not determine 9 parameters"),
        (spread(40) * [1, 1, 0], "condition number beyond 1e9, at most 100 allowed"),
    ],
)
def test_poses_that_determine_too_little_are_refused_with_the_reason(directions, reason):
    assert reason in untestable_accelerometer(poses_at(directions), G, 100.0)


def test_well_spread_poses_are_accepted():
    assert untestable_accelerometer(poses_at(spread(12)), G, 100.0) is None


def test_poses_that_lie_on_no_ellipsoid_are_refused():
    poses = poses_at(spread())
    changed = replace(poses, f=poses.f + 5.0 * (np.arange(30) > 15)[:, None])
    for made, reason in ((poses, None), (changed, "lies on no ellipsoid")):
        fit, _ = fit_accelerometer(Recording(made), white(30), G)
        found = lost_accelerometer(fit, G, 100.0)
        assert (reason is None and found is None) or reason in found
        # in another unit the same
        other, _ = fit_accelerometer(Recording(replace(made, f=made.f / 9.8)), white(30) / 96, G)
        assert (lost_accelerometer(other, G, 100.0) is None) == (reason is None)


def test_contradicting_poses_calibrate_nothing():
    noise = known_noise(example_truth())
    poses = poses_at(spread())
    poses = replace(poses, f=poses.f + 5.0 * (np.arange(30) > 15)[:, None])
    found = calibrate_accelerometer(poses, noise, G, ACCELERATION_UNIT, CalibrateSettings())
    assert found.method == "nominal" and "lies on no ellipsoid" in found.not_testable
    # their direction of gravity is no better, nor that of poses that are too few
    few = poses.select(np.arange(30) < 4)
    unknown = calibrate_accelerometer(few, noise, G, ACCELERATION_UNIT, CalibrateSettings())
    for each in (found, unknown):
        assert each.not_testable in direction_unknown(each)
    known = calibrate_accelerometer(
        poses_at(spread()), noise, G, ACCELERATION_UNIT, CalibrateSettings()
    )
    assert direction_unknown(known) is None
