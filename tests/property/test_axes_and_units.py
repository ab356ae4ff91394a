"""Naming, turning round or rescaling the axes changes the results as it has to, no more."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrate.devices import UNITS, calibrate_recording, known_noise, recording
from imuloop.core.noise_model import NoiseModel
from imuloop.core.units import RawUnit
from imuloop.simulate.truth import example_truth
from property.strategies import G, directions, signed_permutations


@pytest.fixture(scope="module")
def example():
    """The noise of a simulated device, and a session of it."""
    truth = example_truth()
    return known_noise(truth), recording(truth, 11)


@pytest.fixture(scope="module")
def plain_calibration(example):
    """Its accelerometer and gyroscope, calibrated as logged."""
    noise, log = example
    return calibrate_recording(log, noise, G)


def turned_recording(device, turn):
    """Return noise and recording of a device whose axes are named and turned otherwise.

    A mirrored frame turns angular rate, an axial vector, the other way.
    """
    noise, log = device
    mirror = np.linalg.det(turn)

    def turned(table):
        return replace(table, f=table.f @ turn.T, w=mirror * table.w @ turn.T)

    order = np.abs(turn).argmax(axis=1)
    axes = {s + "xyz"[i]: noise.axes[s + "xyz"[k]] for s in "ag" for i, k in enumerate(order)}
    return NoiseModel("d", axes), replace(
        log, poses=turned(log.poses), rotations=turned(log.rotations)
    )


@settings(max_examples=6)
@given(signed_permutations)
def test_both_sensors_turn_with_their_axes(example, plain_calibration, turn):
    """The triangular T ties the body frame to the order of the axes: products know no frame."""
    f, w, products, chi2 = G * directions(30, 1), directions(30, 2), [], []
    noise, log = turned_recording(example, turn)
    for frame, (force, rate) in (
        (np.eye(3), plain_calibration),
        (turn, calibrate_recording(log, noise, G)),
    ):
        mirror = np.linalg.det(frame)
        x, y = force.apply(f @ frame.T), mirror * rate.apply(mirror * w @ frame.T)
        products.append([(a * b).sum(axis=1) for a, b in ((x, x), (y, y), (x, y))])
        chi2.append(rate.reduced_chi2)
    for (one, other), size in zip(zip(*products, strict=True), (G**2, 1.0, G), strict=True):
        np.testing.assert_allclose(other, one, atol=1e-6 * size)
    assert chi2[1] == pytest.approx(chi2[0], rel=1e-4)


@settings(max_examples=4)
@given(st.floats(1e-6, 1e3), st.floats(-1e5, 1e5))
def test_the_unit_of_the_log_reaches_k_and_b_alone(example, plain_calibration, scale, offset):
    noise, log = example
    counts = dict.fromkeys(UNITS, RawUnit("count", scale, offset))
    for one, other in zip(
        plain_calibration, calibrate_recording(log, noise, G, units=counts), strict=True
    ):
        np.testing.assert_array_equal(other.T, one.T)
        np.testing.assert_allclose(other.K, one.K * scale, rtol=1e-12)
        np.testing.assert_allclose((other.b - offset) * scale, one.b, atol=1e-10 * scale * 1e5)
        for name, std in one.std.items():
            factor = {"K": scale, "b": 1 / scale}.get(name[0], 1.0)
            assert other.std[name] == pytest.approx(std * factor, rel=1e-9)
