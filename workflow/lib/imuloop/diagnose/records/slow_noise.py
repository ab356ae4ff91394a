"""Noise of a static record: a grid of hypotheses, and the predictions of known noise."""

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.core.precision import precision
from imuloop.diagnose.evidence import Hypotheses

# ratio of neighbouring variances of flicker, and of walk, on the grid
STEP = 6.0
# probability, before the data, that an axis has no flicker, and that it has no walk
ABSENT = (1 / 2, 1 / 10)
# variance of a level of which nothing is known, over the largest of the noise
UNKNOWN = 1e6


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


def prediction_errors(values, windows, noise):
    """Return the error of predicting each mean from those before it, shape (n,), SI.

    The prediction is the conditional mean by an AxisNoise beside a level of which nothing is known:
    with its covariance ``Σ = L Lᵀ`` the error is ``diag(L) L⁻¹ x``. Takes means x, shape (n,), over
    windows, (n, 2) s; the first, which nothing predicts, has the error 0.
    """
    covariance = noise.mean_covariance(windows)
    root = cholesky(covariance + UNKNOWN * np.diag(covariance).max(), lower=True)
    errors = np.diag(root) * solve_triangular(root, values - values[0], lower=True)
    return np.append(0.0, errors[1:])
