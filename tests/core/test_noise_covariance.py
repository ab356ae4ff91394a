"""Covariance of pose means against that of means of samples, from their dense covariance."""

import numpy as np
import pytest
from scipy.linalg import toeplitz

from calibrate.devices import known
from imuloop.core.noise_model import AxisNoise, GaussMarkovTerm, NoiseModel, SinusoidTerm
from imuloop.core.samples import CHANNELS
from imuloop.noise.processes import gauss_markov_samples, sample_covariances

# s; unequal lengths, gaps, two windows that touch, one that overlaps two others, not in order
WINDOWS = np.array([[0, 30], [40, 60], [60, 100], [310, 400], [150, 290], [50, 75]])
N, DT = 4000, 0.1


Q, W, B, K = np.array([0.6, 0.2, 0.05, 0.004])[:, None] ** 2 * sample_covariances(N, DT)
# each process, and its covariance at lags of 0, 1, ... samples
PROCESSES = {
    "Q": (known(0.6), Q),
    "N": (known(0.2), W),
    "B": (known(0.05), B),
    "K": (known(0.004), K),
    "gauss_markov": (
        (GaussMarkovTerm(known(0.02), known(10.0)),),
        0.02**2 * 5 * gauss_markov_samples(N, DT, 10.0),
    ),
    "sinusoid": (
        (SinusoidTerm(known(0.1), known(0.03)),),
        0.1**2 / 2 * np.cos(2 * np.pi * 0.03 * DT * np.arange(N)),
    ),
}
PROCESSES["all"] = None, sum(lags for _, lags in PROCESSES.values())


def covariance(noise):
    axes = {**dict.fromkeys(CHANNELS, AxisNoise()), "gy": noise}
    return NoiseModel("device", axes).pose_mean_covariance(WINDOWS)


@pytest.mark.parametrize("name", PROCESSES)
def test_pose_means_are_means_of_samples(name):
    term, lags = PROCESSES[name]
    terms = {name: term} if term else {n: each for n, (each, _) in PROCESSES.items() if each}
    found = covariance(AxisNoise(**terms))
    middle = DT * (np.arange(N) + 0.5)
    average = (WINDOWS[:, :1] < middle) & (middle < WINDOWS[:, 1:])
    average = average / average.sum(axis=1, keepdims=True)
    # flicker and walk have no level of their own: what a fitted bias absorbs is taken out of both
    free = np.eye(6) - 1 / 6
    expected = free @ average @ toeplitz(lags) @ average.T @ free
    std = np.sqrt(np.diag(expected))
    error = np.abs(free @ found[4] @ free - expected) / (std[:, None] * std)
    assert error.max() < 2e-3
    assert not np.delete(found, 4, axis=0).any()


def test_a_ramp_is_no_part_of_it():
    assert not covariance(AxisNoise(R=known(0.1))).any()
