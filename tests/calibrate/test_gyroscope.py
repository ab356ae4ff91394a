"""Multi-position gyroscope: derivative, exact recovery, predicted covariance."""

import numpy as np
import pytest

from calibrate.devices import RATE_UNIT, known_noise, noiseless, recording
from imuloop.calibrate import accelerometer
from imuloop.calibrate.calibrate import calibrate_gyroscope
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.gyroscope import gyroscope_model, rotation_covariance, tangents
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import find_effect
from imuloop.core.model import SensorCalibration
from imuloop.core.units import RawUnit
from imuloop.simulate.truth import example_truth

TRUTH = example_truth()


def true_accelerometer(truth):
    a = truth.accelerometer
    known = {"names": accelerometer.NAMES, "covariance": np.zeros((9, 9))}
    return SensorCalibration(RawUnit("m/s^2", 1.0), a.T, a.K, a.b, **known)


def model_of(truth, seed, effects=()):
    made = recording(truth, seed)
    force = calibrated_force(true_accelerometer(truth), made, known_noise(TRUTH))
    return made, force, gyroscope_model(made, force, None, effects)


def true_parameters(truth):
    g = truth.gyroscope
    return np.concatenate([g.T[~np.eye(3, dtype=bool)], g.K, g.b])


def test_without_noise_the_truth_comes_back():
    quiet = noiseless(TRUTH)
    made = recording(quiet, 0)
    fitted = calibrate_gyroscope(
        made, known_noise(TRUTH), true_accelerometer(quiet), RATE_UNIT, CalibrateSettings()
    )
    # what is left is the integration between samples
    np.testing.assert_allclose(fitted.T, quiet.gyroscope.T, atol=1e-5)
    np.testing.assert_allclose(fitted.K, quiet.gyroscope.K, atol=1e-5)
    np.testing.assert_allclose(fitted.b, quiet.gyroscope.b, atol=1e-6)


def test_the_derivative_is_that_of_differences():
    _, _, model = model_of(TRUTH, 1, (find_effect("g_sensitivity")(),))
    x = np.concatenate([true_parameters(TRUTH), np.full(9, 1e-4)])
    numeric = [
        (model.residuals(x + h)[0] - model.residuals(x - h)[0]) / 2e-6
        for h in np.eye(len(x)) * 1e-6
    ]
    analytic = model.residuals(x)[1]
    # second order in the step: rotation within one sample
    np.testing.assert_allclose(analytic, np.transpose(numeric), atol=2e-4 * np.abs(analytic).max())


def test_errors_at_the_truth_have_the_predicted_covariance():
    x = true_parameters(TRUTH)
    scaled, count = 0.0, 0
    for seed in range(8):
        made, force, model = model_of(TRUTH, seed)
        covariance = rotation_covariance(
            model, x, made.poses.session, force.direction_covariance, known_noise(TRUTH)
        )
        errors = model.rotation_errors(x)[0].ravel()
        scaled += errors @ np.linalg.solve(covariance, errors)
        count += len(errors)
    # chi square of 8 x 80 errors, three standard deviations either way
    assert scaled / count == pytest.approx(1, abs=3 * np.sqrt(2 / count))


def test_tangents_are_orthonormal_and_right_handed():
    u = np.random.default_rng(0).normal(size=(50, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    frame = np.concatenate([tangents(u), u[:, None]], axis=1)
    np.testing.assert_allclose(
        frame @ np.swapaxes(frame, 1, 2), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12
    )


def test_a_bias_that_is_held_stays_at_the_first_rest():
    made = recording(TRUTH, 2)
    settings = CalibrateSettings(gyroscope_bias="initial_rest")
    fitted = calibrate_gyroscope(
        made, known_noise(TRUTH), true_accelerometer(TRUTH), RATE_UNIT, settings
    )
    np.testing.assert_array_equal(fitted.b, made.poses.w[0])
    assert np.all(np.sqrt(np.diag(fitted.covariance))[9:] > 0)


def test_too_few_rotations_leave_the_bias_alone():
    made = recording(TRUTH, 3)
    few = made.select(np.arange(len(made.poses)) < 4)
    fitted = calibrate_gyroscope(
        few, known_noise(TRUTH), true_accelerometer(TRUTH), RATE_UNIT, CalibrateSettings()
    )
    assert fitted.method == "static"
    assert "3 rotations between poses found, at least 5 needed" in fitted.not_testable
    assert fitted.names == ("b0", "b1", "b2")
    np.testing.assert_allclose(fitted.b, TRUTH.gyroscope.b, atol=5 * max(fitted.std.values()))
