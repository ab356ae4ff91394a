"""Covariance of pose means against Monte-Carlo draws, each entry within 5 %.

The processes are drawn from their definitions, sample by sample; nothing is shared with the kernel.
"""

import numpy as np
import pytest
from scipy.signal import lfilter

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkov, NoiseModel, Sinusoid
from imuloop.core.samples import CHANNELS

# Monte-Carlo error of an entry: at most sqrt(2/DRAWS) = 1.4 % of the two standard deviations
DRAWS, BOUND = 10_000, 0.05
# s; unequal lengths, gaps, two windows that touch, one that overlaps two others, not in order
WINDOWS = np.array([[0, 30], [40, 60], [60, 100], [310, 400], [150, 290], [50, 75]])
LENGTH = np.diff(WINDOWS)[:, 0]
# samples of 1 s
N = 400


def known(value):
    return Coefficient(value, (0.9 * value, 1.1 * value), 1.08 * value, True)


# sizes that give the means of the windows similar variances
TERMS = {
    "Q": known(0.6),
    "N": known(0.2),
    "B": known(0.05),
    "K": known(0.004),
    "gauss_markov": (GaussMarkov(known(0.02), known(10.0)),),
    "sinusoid": (Sinusoid(known(0.1), known(0.03)),),
}
PROCESSES = {name: AxisNoise(**{name: term}) for name, term in TERMS.items()}
PROCESSES["all"] = AxisNoise(**TERMS)


def draw(name, count, rng):
    """Return the output of each second, SI, shape (count, N)."""
    if name == "Q":
        # an angle that was read with independent errors
        return np.diff(0.6 * rng.standard_normal((count, N + 1)))
    if name == "N":
        return 0.2 * rng.standard_normal((count, N))
    if name == "K":
        step = 0.004 * rng.standard_normal((count, N))
        # from zero at t = 0, in the middle of each second
        return np.cumsum(step, axis=1) - step / 2
    if name == "gauss_markov":
        q, tc = 0.02, 10.0
        keep, std = np.exp(-1 / tc), q * np.sqrt(tc / 2)
        drive = std * rng.standard_normal((count, N))
        drive[:, 1:] *= np.sqrt(1 - keep**2)
        return lfilter([1], [1, -keep], drive)
    if name == "sinusoid":
        return 0.1 * np.sin(2 * np.pi * (0.03 * (np.arange(N) + 0.5) + rng.random((count, 1))))
    # one-sided density B^2/(pi f); a ring of 16 lengths, so that its ends are not seen to meet
    f = np.fft.rfftfreq(16 * N)[1:]
    std = np.sqrt(0.05**2 / (np.pi * f) * 16 * N / 4)
    spectrum = np.zeros((count, len(f) + 1), dtype=complex)
    spectrum.real[:, 1:] = std * rng.standard_normal((count, len(f)))
    spectrum.imag[:, 1:] = std * rng.standard_normal((count, len(f)))
    return np.fft.irfft(spectrum)[:, :N]


@pytest.fixture(scope="module")
def integrals():
    """Return the outputs integrated over the windows, by process, shape (DRAWS, 6)."""
    middle = np.arange(N)[:, None] + 0.5
    inside = ((WINDOWS[:, 0] < middle) & (middle < WINDOWS[:, 1])).astype(float)
    rng = np.random.default_rng(11)
    drawn = {
        name: np.concatenate([draw(name, 500, rng) @ inside for _ in range(DRAWS // 500)])
        for name in TERMS
    }
    return {**drawn, "all": sum(drawn.values())}


def deviation(drawn, covariance, name):
    """Return the largest error of an entry beside the two standard deviations."""
    # flicker has no level of its own: what a fitted bias absorbs is taken out of both
    free = np.eye(6) - (1 / 6 if name in ("B", "all") else 0)
    found = free @ (drawn.T @ drawn / DRAWS) @ free.T
    expected = free @ covariance @ free.T
    std = np.sqrt(np.diag(expected))
    return np.max(np.abs(found - expected) / (std[:, None] * std))


def on_gy(noise):
    return NoiseModel("device", {**dict.fromkeys(CHANNELS, AxisNoise()), "gy": noise})


@pytest.mark.parametrize("name", PROCESSES)
def test_pose_means_agree_with_simulation(integrals, name):
    covariance = on_gy(PROCESSES[name]).pose_mean_covariance(WINDOWS)
    assert deviation(integrals[name] / LENGTH, covariance[4], name) < BOUND
    assert not np.delete(covariance, 4, axis=0).any()


def test_a_ramp_is_no_part_of_it():
    ramp = on_gy(AxisNoise(R=known(0.1)))
    assert not ramp.pose_mean_covariance(WINDOWS).any()
