"""Multi-position gyroscope: derivative, exact recovery, predicted covariance."""

from dataclasses import replace

import numpy as np
import pytest
from imuloop.calibrate.force import calibrated_force

from calibrate.devices import RATE_UNIT, known_noise, noiseless, recording, slopes
from imuloop.calibrate import accelerometer
from imuloop.calibrate.calibrate import calibrate_gyroscope
from imuloop.calibrate.gyroscope import gyroscope_model
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import find_effect
from imuloop.core.model import SensorCalibration
from imuloop.core.units import RawUnit
from imuloop.simulate.truth import example_truth

TRUTH = example_truth()
SEEDS = 5


def true_accelerometer(truth):
    a = truth.accelerometer
    known = {"names": accelerometer.NAMES, "covariance": np.zeros((9, 9))}
    return SensorCalibration(RawUnit("m/s^2", 1.0), a.T, a.K, a.b, **known)


def model_of(truth, seed, effects=()):
    """Return model and recording of a device, and the covariance of its residuals at the truth."""
    made, noise = recording(truth, seed), known_noise(truth)
    force = calibrated_force(true_accelerometer(truth), made, noise)
    model = gyroscope_model(made, force, None, effects)
    x = np.concatenate([true_parameters(truth), np.zeros(model.rate_design.shape[2])])
    covariance = model.covariance(x, made.poses, force.direction_covariance, noise)
    return model, made, covariance


def true_parameters(truth):
    g = truth.gyroscope
    return np.concatenate([g.T[~np.eye(3, dtype=bool)], g.K, g.b])


def calibrated(made, truth, settings=None):
    force, noise = true_accelerometer(truth), known_noise(TRUTH)
    return calibrate_gyroscope(made, noise, force, RATE_UNIT, settings or CalibrateSettings())


def test_without_noise_the_truth_comes_back():
    quiet = noiseless(TRUTH)
    fitted = calibrated(recording(quiet, 0), quiet)
    # what is left is the integration between samples
    for name in "TKb":
        true = getattr(quiet.gyroscope, name)
        np.testing.assert_allclose(getattr(fitted, name), true, atol=1e-5)


def test_the_rates_have_the_rounding_of_the_angular_rate():
    made, noise = recording(TRUTH, 0), known_noise(TRUTH)
    force = calibrated_force(true_accelerometer(TRUTH), made, noise)
    model, count, rounding = gyroscope_model(made, force), len(made.poses), np.arange(6) * 1e-8
    plain, rounded = (
        model.covariance(
            true_parameters(TRUTH),
            replace(made.poses, added=np.tile(variance, (count, 1))),
            force.direction_covariance,
            noise,
        ).diagonal()[: 3 * count]
        for variance in (0 * rounding, rounding)
    )
    np.testing.assert_allclose(
        (rounded - plain).reshape(count, 3), rounding[None, 3:].repeat(count, 0)
    )


def test_the_derivative_is_that_of_differences():
    model, *_ = model_of(TRUTH, 1, (find_effect("g_sensitivity")(),))
    x = np.concatenate([true_parameters(TRUTH), np.full(9, 1e-4)])
    numeric, analytic = slopes(lambda x: model.residuals(x)[0], x), model.residuals(x)[1]
    # second order in the step: rotation within one sample
    np.testing.assert_allclose(analytic, numeric, atol=2e-4 * np.abs(analytic).max())


def test_errors_at_the_truth_have_the_predicted_covariance():
    scaled, count = 0.0, 0
    for seed in range(SEEDS):
        model, _, covariance = model_of(TRUTH, seed)
        errors = model.rotation_errors(true_parameters(TRUTH))[0].ravel()
        own = covariance[-len(errors) :, -len(errors) :]
        scaled += errors @ np.linalg.solve(own, errors)
        count += len(errors)
    # chi square of 80 errors a device, three standard deviations either way
    assert scaled / count == pytest.approx(1, abs=3 * np.sqrt(2 / count))


def test_a_walk_of_the_rate_is_common_to_rotations_and_the_poses_beside_them():
    noise = replace(TRUTH.gyroscope.noise, B=(0.0, 0.0, 0.0), K=(3e-5, 3e-5, 3e-5))
    truth = replace(TRUTH, gyroscope=replace(TRUTH.gyroscope, noise=noise))
    x, sums = true_parameters(truth), np.zeros(3)
    count = np.zeros(2)
    for seed in range(SEEDS):
        model, made, covariance = model_of(truth, seed)
        residuals, jacobian = model.residuals(x)
        n, first = 3 * len(made.poses), made.rotations.first
        apart = covariance.copy()
        apart[:n, n:] = apart[n:, :n] = 0
        # an error of the rate turns gravity as one of the bias does: less what the mean of the
        # poses at both ends makes of it
        less = np.eye(len(residuals))[n:]
        turned = (-jacobian[n:, 9:12] / truth.gyroscope.K).reshape(-1, 2, 3)
        for k, pose in enumerate(first):
            for end in (pose, pose + 1):
                less[2 * k : 2 * k + 2, 3 * end : 3 * end + 3] -= turned[k] / 2
        left = less @ residuals
        sums += [
            residuals @ np.linalg.solve(covariance, residuals),
            left @ np.linalg.solve(less @ covariance @ less.T, left),
            left @ np.linalg.solve(less @ apart @ less.T, left),
        ]
        count += [len(residuals), len(left)]
    all_, together, alone = sums / count[[0, 1, 1]]
    # three standard deviations either way
    off = 3 * np.sqrt(2 / count)
    assert all_ == pytest.approx(1, abs=off[0])
    assert together == pytest.approx(1, abs=off[1])
    # as if rates and rotations had nothing in common
    assert alone < 1 - off[1]


def test_a_bias_that_is_held_stays_at_the_first_rest():
    made = recording(TRUTH, 2)
    fitted = calibrated(made, TRUTH, CalibrateSettings(gyroscope_bias="initial_rest"))
    np.testing.assert_array_equal(fitted.b, made.poses.w[0])
    assert np.all(np.sqrt(np.diag(fitted.covariance))[9:] > 0)


def test_too_few_rotations_leave_the_bias_alone():
    made = recording(TRUTH, 3)
    fitted = calibrated(made.select(np.arange(len(made.poses)) < 4), TRUTH)
    assert fitted.method == "static"
    assert "3 rotations between poses found, at least 5 needed" in fitted.not_testable
    assert fitted.names == ("b0", "b1", "b2")
    np.testing.assert_allclose(fitted.b, TRUTH.gyroscope.b, atol=5 * max(fitted.std.values()))
