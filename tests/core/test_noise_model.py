"""The noise model against closed forms, and against the dense covariance of samples."""

import numpy as np
import pytest
from scipy.linalg import toeplitz

from calibrate.devices import coefficient
from imuloop.core.files import write_json
from imuloop.core.noise_model import (
    AxisNoise,
    Coefficient,
    GaussMarkovTerm,
    LowPassTerm,
    NoiseModel,
    SinusoidTerm,
)
from imuloop.core.samples import CHANNELS
from imuloop.noise.processes import covariances

PROCESSES = {
    "quantisation": AxisNoise(Q=coefficient(0.3)),
    "white": AxisNoise(N=coefficient(0.2)),
    "flicker": AxisNoise(B=coefficient(0.05)),
    "walk": AxisNoise(K=coefficient(0.02)),
    "gauss_markov": AxisNoise(gauss_markov=(GaussMarkovTerm(coefficient(0.1), coefficient(4.0)),)),
    "sinusoid": AxisNoise(
        sinusoid=(SinusoidTerm(coefficient(0.3), coefficient(0.07), "50 Hz mains, alias"),)
    ),
}
PROCESSES["all"] = AxisNoise(
    coefficient(0.3),
    coefficient(0.2),
    coefficient(0.05),
    coefficient(0.02),
    Coefficient(upper95=1e-3),
    PROCESSES["gauss_markov"].gauss_markov,
    PROCESSES["sinusoid"].sinusoid,
    LowPassTerm("second order", coefficient(20.0), 0.01),
)
process = pytest.mark.parametrize("name", PROCESSES)
# s; unequal lengths, gaps, two windows that touch, one that overlaps two others, not in order
WINDOWS = np.array([[0, 30], [40, 60], [60, 100], [310, 400], [150, 290], [50, 75]])


def model(axis):
    return NoiseModel("device", dict.fromkeys(CHANNELS, axis))


def lag_covariance(axis, n, dt):
    """Return the covariance at lags of 0, 1, ... samples."""
    tcs = [term.tc.value for term in axis.gauss_markov]
    squares = [axis.Q.square, axis.N.square, axis.B.square, axis.K.square]
    squares += [term.q.square * term.tc.value / 2 for term in axis.gauss_markov]
    lags = np.array(squares) @ np.array([*covariances(np.arange(n), 1, dt, tcs)])
    for term in axis.sinusoid:
        phase = 2 * np.pi * term.frequency.value * dt * np.arange(n)
        lags += term.amplitude.value**2 / 2 * np.cos(phase)
    return lags


@process
def test_pose_means_are_means_of_samples(name):
    n, dt = 4000, 0.1
    axes = {**dict.fromkeys(CHANNELS, AxisNoise()), "gy": PROCESSES[name]}
    covariance = NoiseModel("device", axes).mean_covariance(WINDOWS)
    middle = dt * (np.arange(n) + 0.5)
    average = (WINDOWS[:, :1] < middle) & (middle < WINDOWS[:, 1:])
    average = average / average.sum(axis=1, keepdims=True)
    # flicker and walk have an arbitrary level: the part that a fitted bias absorbs is removed
    free = np.eye(6) - 1 / 6
    expected = free @ average @ toeplitz(lag_covariance(PROCESSES[name], n, dt)) @ average.T @ free
    std = np.sqrt(np.diag(expected))
    error = np.abs(free @ covariance[4] @ free - expected) / (std[:, None] * std)
    assert error.max() < 2e-3
    assert not np.delete(covariance, 4, axis=0).any()
    # a ramp is not part of it
    assert not model(AxisNoise(R=coefficient(0.1))).mean_covariance(WINDOWS).any()


@process
@pytest.mark.parametrize("tau", [0.01, 1.0, 37.0, 2000.0])
def test_adjacent_means_have_the_allan_variance(name, tau):
    c = model(PROCESSES[name]).mean_covariance([[5, 5 + tau], [5 + tau, 5 + 2 * tau]])[4]
    half_variance = (c[0, 0] + c[1, 1] - 2 * c[0, 1]) / 2
    assert half_variance == pytest.approx(PROCESSES[name].allan_variance(tau), rel=1e-9)


def test_means_of_different_power_cycles_are_independent():
    cycle = np.arange(len(WINDOWS)) % 2
    covariance = model(PROCESSES["all"]).mean_covariance(WINDOWS, cycle)
    assert not covariance[:, cycle[:, None] != cycle].any()
    for k in (0, 1):
        alone = model(PROCESSES["all"]).mean_covariance(WINDOWS[cycle == k])
        np.testing.assert_array_equal(covariance[:, cycle == k][:, :, cycle == k], alone)


def test_the_file_gives_back_what_was_written(tmp_path):
    noise = model(PROCESSES["all"])
    write_json(tmp_path / "noise.json", noise.to_dict())
    assert NoiseModel.from_json(tmp_path / "noise.json") == noise
