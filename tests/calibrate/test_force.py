"""The direction of gravity is known as well as the accelerometer is, and the gyroscope says so."""

from dataclasses import replace

import numpy as np
from imuloop.calibrate.force import calibrated_force

from calibrate.devices import ACCELERATION_UNIT, known_noise, recording
from imuloop.calibrate import accelerometer
from imuloop.core.effect import FittedEffect, find_effect
from imuloop.core.model import SensorCalibration
from imuloop.simulate.truth import example_truth

TRUTH = example_truth()


def test_errors_of_parameters_move_directions_as_their_covariance_says():
    made, rng = recording(TRUTH, 3), np.random.default_rng(0)
    effect, a = find_effect("quadratic")(), TRUTH.accelerometer
    names = (*accelerometer.NAMES, *(f"quadratic.{p}" for p in effect.parameters))
    size = np.repeat([2e-3, 3e-3, 0.02, 2e-4], 3)
    root = size[:, None] * (np.eye(12) + 0.3 * rng.normal(size=(12, 12)))

    def calibration(x, covariance):
        T, K, b = accelerometer.unpack(x)
        values = dict(zip(effect.parameters, x[9:].tolist(), strict=True))
        fitted = (FittedEffect(effect, values, {}),)
        return SensorCalibration(ACCELERATION_UNIT, T, K, b, names, covariance, fitted)

    x = np.concatenate([a.T[np.triu_indices(3, 1)], a.K, a.b, [1e-4, -2e-4, 3e-4]])
    noise = known_noise(TRUTH)

    def directions(x):
        f = calibrated_force(calibration(x, root), made, noise).poses
        return (f / np.linalg.norm(f, axis=1, keepdims=True)).ravel()

    drawn = [directions(x + root @ rng.normal(size=12)) for _ in range(4000)]
    whole, exact = (
        calibrated_force(calibration(x, c), made, noise).direction_covariance
        for c in (root @ root.T, np.zeros((12, 12)))
    )
    own = whole - exact
    assert np.abs(np.cov(np.transpose(drawn)) - own).max() < 0.08 * own.max()


def test_an_effect_that_a_plan_leaves_out_moves_no_direction():
    made, a = recording(TRUTH, 3), TRUTH.accelerometer
    names = (*accelerometer.NAMES, "warm_up.Ax")
    given = SensorCalibration(ACCELERATION_UNIT, a.T, a.K, a.b, names, np.eye(10) * 1e-6)
    base = replace(given, names=names[:9], covariance=given.covariance[:9, :9])
    covariances = [
        calibrated_force(each, made, known_noise(TRUTH)).direction_covariance
        for each in (given, base)
    ]
    np.testing.assert_array_equal(*covariances)
