"""Naming, turning round or rescaling the axes changes what it has to, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imuloop.calibrate.pose_fits import AccelerometerPoses

from calibrate.devices import (
    ACCELERATION_UNIT,
    RATE_UNIT,
    IndependentMeans,
    known_noise,
    poses_of,
    recording,
)
from imuloop.calibrate.accelerometer import unpack
from imuloop.calibrate.calibrate import calibrate_accelerometer, calibrate_gyroscope
from imuloop.calibrate.recording import Recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.calibrate.six_position import find_faces, fit_six_position
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.units import RawUnit
from imuloop.simulate.truth import example_truth
from property.strategies import G, directions, misalignments, seeds, signed_permutations, vectors

SETTINGS = CalibrateSettings()
ERROR = 2e-3
FACES = np.vstack([np.eye(3), -np.eye(3)])
devices = st.tuples(misalignments(triangular=True, size=0.03), vectors(0.95, 1.05), vectors(-1, 1))


def means(device, up, seed):
    """Return mean specific force at attitudes, with errors of 2 mm/s²."""
    T, K, b = device
    f = np.linalg.solve(T, G * up.T).T / K + b
    return f + np.random.default_rng(seed).normal(scale=ERROR, size=f.shape)


def multi_position(f, error=ERROR):
    """Return T, K, b of the nine-parameter fit to pose means with independent errors."""
    sensor = AccelerometerPoses(IndependentMeans(error**2), G, ACCELERATION_UNIT, SETTINGS)
    return unpack(sensor.fit(Recording(poses_of(f))).fit.x)


def six_position(f, error=ERROR):
    """Return T, K, b of the six-position fit; its errors are in calibrated units."""
    return unpack(fit_six_position(f, find_faces(f, 20.0), G, ERROR**2).x)


METHODS = {
    "multi_position": (multi_position, lambda seed: directions(20, seed)),
    "six_position": (six_position, lambda seed: np.tile(FACES, (2, 1))),
}
method = pytest.mark.parametrize("method", METHODS)


@method
@settings(max_examples=15)
@given(devices, signed_permutations, seeds)
def test_the_norm_does_not_depend_on_how_axes_are_named_or_turned(method, device, turn, seed):
    # the triangular T ties the body frame to the order of the axes; norms know no frame
    fit, attitudes = METHODS[method]
    f = means(device, attitudes(seed), seed)
    T, K, b = fit(f)
    other_T, other_K, other_b = fit(f @ turn.T)
    raw = directions(30, seed + 1) * G
    plain = np.linalg.norm((K * (raw - b)) @ T.T, axis=1)
    turned = np.linalg.norm((other_K * (raw @ turn.T - other_b)) @ other_T.T, axis=1)
    np.testing.assert_allclose(turned, plain, atol=1e-6)


@pytest.fixture(scope="module")
def made():
    """A simulated session, and the calibration of its accelerometer that is the truth."""
    truth = example_truth()
    a = truth.accelerometer
    force = SensorCalibration(ACCELERATION_UNIT, a.T, a.K, a.b)
    return known_noise(truth), recording(truth, 11), force


def turned_recording(made, turn):
    """Return recording and noise of a device whose axes are named and turned otherwise.

    The accelerometer is calibrated first, so that only the gyroscope is left to estimate. A
    mirrored frame turns angular rate, an axial vector, the other way.
    """
    noise, log, force = made
    mirror = np.linalg.det(turn)

    def each(table):
        return replace(table, f=force.apply(table.f) @ turn.T, w=mirror * table.w @ turn.T)

    order = np.abs(turn).argmax(axis=1)
    axes = {s + "xyz"[i]: noise.axes[s + "xyz"[k]] for s in "ag" for i, k in enumerate(order)}
    return replace(log, poses=each(log.poses), rotations=each(log.rotations)), NoiseModel("d", axes)


NOTHING = SensorCalibration(ACCELERATION_UNIT, np.eye(3), np.ones(3), np.zeros(3))


@settings(max_examples=6)
@given(signed_permutations)
def test_a_gyroscope_turns_with_its_axes(made, turn):
    fits = [
        calibrate_gyroscope(log, noise, NOTHING, RATE_UNIT, SETTINGS)
        for log, noise in (turned_recording(made, p) for p in (np.eye(3), turn))
    ]
    plain, other = fits
    mirror = np.linalg.det(turn)
    np.testing.assert_allclose(other.T, turn @ plain.T @ turn.T, atol=1e-6)
    np.testing.assert_allclose(other.K, np.abs(turn) @ plain.K, atol=1e-6)
    np.testing.assert_allclose(other.b, mirror * turn @ plain.b, atol=1e-7)
    assert other.reduced_chi2 == pytest.approx(plain.reduced_chi2, rel=1e-4)


@settings(max_examples=4)
@given(st.floats(1e-6, 1e3), st.floats(-1e5, 1e5))
def test_the_unit_of_the_log_reaches_k_and_b_alone(made, scale, offset):
    noise, log, force = made
    for calibrate, unit in (
        (lambda u: calibrate_accelerometer(log.poses, noise, G, u, SETTINGS), ACCELERATION_UNIT),
        (lambda u: calibrate_gyroscope(log, noise, force, u, SETTINGS), RATE_UNIT),
    ):
        plain, other = calibrate(unit), calibrate(RawUnit("count", scale, offset))
        np.testing.assert_array_equal(other.T, plain.T)
        np.testing.assert_allclose(other.K, plain.K * scale, rtol=1e-12)
        np.testing.assert_allclose((other.b - offset) * scale, plain.b, atol=1e-10 * scale * 1e5)
        for name, std in plain.std.items():
            factor = {"K": scale, "b": 1 / scale}.get(name[0], 1.0)
            assert other.std[name] == pytest.approx(std * factor, rel=1e-9)
