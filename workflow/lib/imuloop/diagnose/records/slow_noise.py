"""Noise hypotheses of a static record: a grid of ratios of slow noise to white noise."""

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.estimate.evidence import Hypotheses

# ratio of neighbouring variances of flicker, and of random walk, on the grid
STEP = 6.0
# prior probability that an axis has no flicker, and that it has no random walk
ABSENT = (1 / 2, 1 / 10)


def ratios(span, length):
    """Return the grid of ``B²/N²``, Hz, and ``K²/N²``, Hz², (g, 2), and its log prior, (g,).

    N, B and K are the coefficients of white noise, flicker and random walk. The record has the
    `span` S and windows of `length` τ, s. In its mode k, of k half waves, the variance of flicker
    is ``B² S/(π k τ)`` and the variance of random walk ``K² S²/(π² k² τ)``; white noise has
    ``N²/τ``. The grid goes from half the white noise in the slowest mode to thirty times the white
    noise in the middle mode. The prior is uniform in the logarithm of each ratio.
    """
    axes, priors = [], []
    for power, absent in zip((1, 2), ABSENT, strict=True):
        # least ratio, from the slowest mode, and largest ratio, from the middle mode
        low, high = 0.5 * (np.pi / span) ** power, 30 * (0.5 * np.pi / length) ** power
        count = max(2, int(np.ceil(np.log(high / low) / np.log(STEP))) + 1)
        axes.append(np.concatenate([[0.0], low * STEP ** np.arange(count)]))
        priors.append(np.concatenate([[absent], np.full(count, (1 - absent) / count)]))
    flicker, walk = np.meshgrid(*axes, indexing="ij")
    grid = np.column_stack([flicker.ravel(), walk.ravel()])
    return grid, np.log(np.outer(*priors)).ravel()


def unit_noise(name):
    """Return the AxisNoise of one process, 'N', 'B' or 'K', with the coefficient 1."""
    one = Coefficient(value=1.0, ci95=(1.0, 1.0), upper95=1.0, identifiable=True)
    return AxisNoise(**{name: one})


def hypotheses(windows, grid):
    """Return the Hypotheses of means over n windows: g covariances that their noise may have.

    `windows`, (n, 2), are start and end of each window, s. `grid`, (g, 2), has the ratios
    ``B²/N²``, Hz, and ``K²/N²``, Hz², of flicker and random walk to white noise, which has N = 1.
    """
    white, flicker, walk = (unit_noise(name).mean_covariance(windows) for name in "NBK")
    return Hypotheses.of(white + b * flicker + k * walk for b, k in grid)
