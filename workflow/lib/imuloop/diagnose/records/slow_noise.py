"""Noise of a static record: a grid of hypotheses."""

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.core.precision import precision
from imuloop.estimate.evidence import Hypotheses

# ratio of neighbouring variances of flicker, and of walk, on the grid
STEP = 6.0
# probability, before the data, that an axis has no flicker, and that it has no walk
ABSENT = (1 / 2, 1 / 10)


def ratios(span, length):
    """Return the grid of ``B²/N²``, Hz, and ``K²/N²``, Hz², (g, 2), and its log prior, (g,).

    Over a record of `span` S in windows of `length` τ, s, the slow noise of mode k (half waves) has
    the variance ``B² S/(π k τ)`` and ``K² S²/(π² k² τ)`` where the white noise has ``N²/τ``. The
    grid goes from half the white noise in the slowest mode to thirty times it in the middle one;
    the prior is even in the logarithm of each ratio.
    """
    axes, priors = [], []
    for power, absent in zip((1, 2), ABSENT, strict=True):
        # white noise over that of a unit coefficient, in the slowest and in the middle mode
        low, high = 0.5 * (np.pi / span) ** power, 30 * (0.5 * np.pi / length) ** power
        count = max(2, int(np.ceil(np.log(high / low) / np.log(STEP))) + 1)
        axes.append(np.concatenate([[0.0], low * STEP ** np.arange(count)]))
        priors.append(np.concatenate([[absent], np.full(count, (1 - absent) / count)]))
    flicker, walk = np.meshgrid(*axes, indexing="ij")
    grid = np.column_stack([flicker.ravel(), walk.ravel()])
    return grid, np.log(np.outer(*priors)).ravel()


def unit_noise(name):
    """Return noise of one process with coefficient 1."""
    return AxisNoise(**{name: Coefficient(1.0, (1.0, 1.0), 1.0, True)})


def hypotheses(windows, grid):
    """Return the Hypotheses of means over windows, shape (n, 2), on the grid, for N = 1."""
    white, flicker, walk = (unit_noise(name).mean_covariance(windows) for name in "NBK")
    return Hypotheses.of(precision(white + b * flicker + k * walk) for b, k in grid)
