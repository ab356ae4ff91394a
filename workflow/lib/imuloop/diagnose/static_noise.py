"""Noise of a static record that is not known in advance: white, flicker and walk on a grid."""

from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, betaln

from imuloop.core.noise_model import AxisNoise, Coefficient

# ratio of neighbouring variances of flicker, and of walk, on the grid
STEP = 6.0
# probability, before the data, that an axis has no flicker, and that it has no walk
ABSENT = (1 / 2, 1 / 10)


def ratios(span, length):
    """Return the grid of flicker and walk, relative to white noise, with its prior.

    Over a record of `span` S in windows of `length` τ the slow noise of mode k (half waves) has
    the variance ``B² S/(π k τ)`` and ``K² S²/(π² k² τ)`` where the white noise has ``N²/τ``. The
    grid goes from half the white noise in the slowest mode to thirty times it in the middle one.

    Parameters
    ----------
    span, length : float
        Length of the record and of its windows, s.

    Returns
    -------
    ndarray, shape (g, 2)
        ``B²/N²`` in Hz and ``K²/N²`` in Hz².
    ndarray, shape (g,)
        Logarithm of the prior, even in the logarithm of each ratio.
    """
    axes, priors = [], []
    for power, absent in zip((1, 2), ABSENT, strict=True):
        # white noise over that of a unit coefficient, in the slowest and in the middle mode
        low, high = 0.5 * (np.pi / span) ** power, 30 * (0.5 * np.pi / length) ** power
        count = max(2, int(np.ceil(np.log(high / low) / np.log(STEP))) + 1)
        axes.append(np.concatenate([[0.0], low * STEP ** np.arange(count)]))
        priors.append(np.concatenate([[absent], np.full(count, (1 - absent) / count)]))
    flicker, walk = np.meshgrid(*axes, indexing="ij")
    return (
        np.column_stack([flicker.ravel(), walk.ravel()]),
        np.log(np.outer(*priors)).ravel(),
    )


def unit_noise(name):
    """Return noise of one process with coefficient 1."""
    return AxisNoise(**{name: Coefficient(1.0, (1.0, 1.0), 1.0, True)})


def mean_covariance(noise, windows):
    """Return the covariance of means over windows of one axis' noise, shape (n, n)."""
    times = np.unique(windows)
    start, end = np.searchsorted(times, windows).T
    times = times - times[0]
    kernel = noise.kernel(times, times[-1])
    length = np.diff(windows, axis=1)[:, 0]
    k = kernel[end] - kernel[start]
    k = k[:, end] - k[:, start]
    return (k + k.T) / (2 * length[:, None] * length)


@dataclass(frozen=True)
class GridNoise:
    """Precision of the means of one record at each point of the grid, for N = 1.

    Attributes
    ----------
    precision : ndarray, shape (g, n, n)
        Inverse covariance.
    log_det : ndarray, shape (g,)
        Logarithm of the covariance's determinant.
    """

    precision: np.ndarray
    log_det: np.ndarray

    @classmethod
    def of(cls, windows, grid):
        """Return it for windows, shape (n, 2), and the `ratios`."""
        white, flicker, walk = (mean_covariance(unit_noise(name), windows) for name in "NBK")
        precision = np.empty((len(grid), *white.shape))
        log_det = np.empty(len(grid))
        for point, (b, k) in enumerate(grid):
            covariance = white + b * flicker + k * walk
            precision[point] = np.linalg.inv(covariance)
            log_det[point] = np.linalg.slogdet(covariance)[1]
        return cls(precision, log_det)


@dataclass(frozen=True)
class Fit:
    """Least squares of one axis at every point of the grid.

    Attributes
    ----------
    theta : ndarray, shape (g, p)
        Parameters.
    inverse : ndarray, shape (g, p, p)
        Their covariance for a residual of χ²/dof = 1, which the three axes share.
    square : ndarray, shape (g,)
        χ² of the residual for N = 1.
    log_weight : ndarray, shape (g,)
        Logarithm of restricted likelihood times prior.
    dof : int
        Degrees of freedom.
    """

    theta: np.ndarray
    inverse: np.ndarray
    square: np.ndarray
    log_weight: np.ndarray
    dof: int

    @property
    def covariance(self):
        """Return the covariance of the parameters, shape (g, p, p)."""
        return self.inverse * (self.square / self.dof)[:, None, None]

    @property
    def weight(self):
        """Return the share of each noise, summing to 1."""
        return np.exp(self.log_weight - log_sum(self.log_weight))

    @property
    def values(self):
        """Return the parameters, averaged over the noise."""
        return self.weight @ self.theta

    @property
    def spread(self):
        """Return the covariance of `values`, that of the noise's uncertainty included."""
        off = self.theta - self.values
        return np.einsum("g,gpq->pq", self.weight, self.covariance + off[:, :, None] * off[:, None])

    @property
    def likeliest(self):
        """Return the point of the grid of the largest weight."""
        return int(np.argmax(self.log_weight))


def log_sum(values):
    """Return ``log Σ exp`` of values, shape (n,)."""
    top = np.max(values)
    return float(top + np.log(np.exp(values - top).sum()))


def log_sums(values):
    """Return ``log Σ exp`` of values, shape (k, n), over the last axis."""
    top = values.max(axis=1)
    return top + np.log(np.exp(values - top[:, None]).sum(axis=1))


def log_f_tail(statistic, q, dof):
    """Return the logarithm of the upper tail of F with q and `dof` degrees of freedom.

    ``I_x(dof/2, q/2)`` at ``x = dof/(dof + q F)``; below the smallest double its leading term
    ``x^a (1-x)^(b-1) / (a B(a, b))``.
    """
    a, b = dof / 2, q / 2
    x = dof / (dof + q * np.asarray(statistic, dtype=float))
    tail = betainc(a, b, x)
    if np.all(tail > 1e-280):
        return np.log(tail)
    safe = np.minimum(x, 1 - 1e-16)
    leading = a * np.log(safe) + (b - 1) * np.log1p(-safe) - np.log(a) - betaln(a, b)
    with np.errstate(divide="ignore"):
        return np.where(tail > 1e-280, np.log(tail), leading)


def log_p_value(without, with_it, points=slice(None)):
    """Return the logarithm of the p-value of the parameters that one fit has beyond another.

    At each point of the grid the F test is exact. What the noise is, the fit with the parameters
    tells: the p-values are averaged with its restricted likelihood as weight. So a pattern as
    smooth as the slow noise that the data cannot exclude gains nothing from being smooth.

    Parameters
    ----------
    without, with_it : Fit
        Of the same data, the second with more columns.
    points : index, optional
        The points of the grid to count; all by default.
    """
    return log_p_values([(without, with_it)], points)[0]


def log_p_values(pairs, points=slice(None)):
    """Return the same for several pairs of fits, (without, with), as a list."""
    before, after, dof, weight = (
        np.array(v)
        for v in zip(
            *((a.square, b.square, (a.dof - b.dof, b.dof), b.log_weight) for a, b in pairs),
            strict=True,
        )
    )
    q, dof = dof.T[:, :, None]
    drop = np.maximum(before - after, 0.0)
    tail = log_f_tail((drop / q / (after / dof))[:, points], q, dof)
    weight = weight[:, points]
    both = log_sums(weight + tail) - log_sums(weight)
    return both.tolist()
