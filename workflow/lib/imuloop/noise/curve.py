"""Allan curve of a record: degrees of freedom of its points, and a plain fit of five coefficients.

The fit is the cross-check of the estimate; it is neither tested nor has it intervals.
"""

from dataclasses import dataclass
from numbers import Real

import numpy as np
import pandas as pd
from scipy.special import xlogy

from imuloop.core.errors import ImuloopError
from imuloop.noise.allan import allan_variance, averaging_factors, interval, terms
from imuloop.noise.likelihood import weighted_nnls
from imuloop.noise.settings import NoiseSettings

# order of the coefficients
TERMS = ("Q", "N", "B", "K", "R")
# fewer points cannot carry five terms
MIN_POINTS = 8
# rounds of weights, and relative rounding of the curve, so that a ramp alone keeps finite weights
ROUNDS, ROUNDING = 6, 1e-9


@dataclass(frozen=True)
class NoiseOfCurve:
    r"""Expectation and variance of the points of a pooled curve, for any noise coefficients.

    A point is the mean square of the difference c = (1, -2, 1) over m samples of the integrated
    output X, over :math:`2 \tau^2`.
    The difference is Gaussian; at a distance d its covariance is a sum over the processes,

    .. math:: r(d) = \sum_p \theta_p r_p(d),\quad r_p(d) = \sum_{a,b} c_a c_b k_p(d + (a - b) m)

    with the generalised covariance k of X: 1 at d = 0 (quantisation), -|d|/2 (white),
    d^2 ln|d| / 2 pi (flicker), |d|^3/12 (walk). The fourth moments of a Gaussian then give, for M
    terms and w(d) pairs of them,

    .. math:: \mathrm{var}(\sigma^2(\tau))
        = \frac{1}{4 \tau^4 M^2} \sum_d w(d) [2 r(d)^2 + 4 R^2 \tau^4 r(d)]

    with a ramp R, which second differences see.

    Attributes
    ----------
    level : ndarray, shape (k, 5)
        Expectation for unit (Q^2, N^2, B^2, K^2, R^2) = theta.
    quadratic, ramp : ndarray, shape (k, 4, 4) and (k, 4)
        Factors of theta_p theta_q, and of R^2 theta_p, in the variance.
    """

    level: np.ndarray
    quadratic: np.ndarray
    ramp: np.ndarray

    @classmethod
    def of(cls, factors, lengths, rate):
        """Return the noise of a curve at averaging `factors` over stretches, rate in Hz."""
        lengths, repeats = np.unique(lengths, return_counts=True)
        m = np.asarray(factors, dtype=np.int64)[:, None]
        # the difference of a difference, as a function of the distance
        count, squared = terms(m, lengths), np.poly(np.ones(4))
        longest = count.max(axis=1, keepdims=True)

        def pairs(d):
            each = zip(repeats, count.T[..., None], strict=True)
            return sum(n * np.clip(c - d, 0, None) for n, c in each) * np.where(d > 0, 2.0, 1.0)

        def covariance(d):
            shifts = np.arange(-2, 3)[:, None, None] * m
            return np.tensordot(squared, _kernels(np.abs(d + shifts) / rate), (0, 1))

        # white and walk end with the difference; flicker's tail has gone with the fourth power
        step, reach = np.maximum(np.minimum(m, longest) // 8, 1), np.minimum(3 * m, longest)
        d = step * np.arange(np.max(-(-reach // step), initial=1), dtype=float)
        r, weight = covariance(d), pairs(d) * step * (d < reach)
        level, ramp = r[..., 0].T, np.einsum("pkd,kd->kp", r, weight)
        quadratic = np.einsum("pkd,kd,qkd->kpq", r, weight, r)
        # quantisation lives on single lags, exactly
        d, spike = m * np.arange(3.0), squared[2:]
        weight, level[:, 0] = pairs(d) * spike, spike[0]
        cross = np.einsum("pkd,kd->kp", covariance(d), weight)
        cross[:, 0], ramp[:, 0] = weight @ spike, weight.sum(axis=1)
        quadratic[:, 0] = quadratic[:, :, 0] = cross
        scale, number = 2 * (m / rate) ** 2, np.maximum(count @ repeats[:, None], 1)
        level = np.hstack([level / scale, scale / 4]) * (longest > 0)
        return cls(level, quadratic * 2 / (scale * number)[..., None] ** 2, ramp / number**2)

    def variance(self, theta):
        """Return the variances for theta = (Q^2, N^2, B^2, K^2, R^2), shape (k,)."""
        random = np.asarray(theta[:4])
        return self.quadratic @ random @ random + theta[4] * (self.ramp @ random)

    def degrees_of_freedom(self, theta):
        r"""Return the equivalent degrees of freedom of the points, shape (k,).

        .. math:: \nu = 2 \sigma^4 / \mathrm{var}(\hat\sigma^2)

        for theta as in `variance`, white noise where none is known; not-a-number without terms.
        """
        theta = theta if any(theta[:4]) else np.array([0, 1.0, 0, 0, 0])
        level, variance = self.level @ theta, self.variance(theta)
        return np.divide(2 * level**2, variance, out=np.full(len(level), np.nan), where=level > 0)


def _kernels(lag):
    """Return the generalised covariance of the integrated output for unit Q, N, B, K, (4, ...).

    Without quantisation, which is none beyond lag 0.
    """
    return np.stack([0 * lag, -lag / 2, xlogy(lag**2, lag) / (2 * np.pi), lag**3 / 12])


def fit_curve(variance, curve):
    r"""Return the non-negative Q, N, B, K, R, SI, that best fit an Allan curve; none is tested.

    The variance (not the deviation) is linear in the squares of the coefficients,

    .. math:: \sigma^2(\tau) = 3 Q^2/\tau^2 + N^2/\tau + (2 \ln 2/\pi) B^2 + K^2 \tau/3
        + R^2 \tau^2/2

    Weights are the inverse of the variance of each point, from the last fit and not from the
    data, which would favour points that came out low. All are 0 where the curve has under eight
    points or is zero somewhere.

    Takes the overlapping Allan variance, shape (k,), and its NoiseOfCurve.

    References
    ----------
    IEEE Std 952-1997 (R2008), annex C.
    """
    variance = np.asarray(variance, dtype=float)
    if len(variance) < MIN_POINTS or not np.all(variance > 0):
        return [0.0] * 5
    # orders of magnitude apart otherwise: fit the curve relative to itself
    scale = np.array([np.min(variance / column) for column in curve.level.T])
    level = curve.level * scale
    # start: white noise, whose relative variance grows with tau
    weight = level[:, 1] / level[0, 1] / variance**2
    for _ in range(ROUNDS):
        theta = weighted_nnls(level, variance, weight)
        weight = 1 / (curve.variance(theta * scale) + (ROUNDING * (level @ theta)) ** 2)
    return np.sqrt(theta * scale).tolist()


def allan(values, rate):
    """Return the overlapping Allan deviation of an evenly sampled record, without gaps.

    Parameters
    ----------
    values : array_like, shape (n,) or (n, k), or DataFrame
        Record of each axis, any unit.
    rate : float
        Samples per second, Hz.

    Returns
    -------
    DataFrame
        A row per axis and averaging time: `axis`, `tau_s`, `adev` in the unit of the values, and
        its 95 % interval by the noise that the Allan curve shows, `ci_low` and `ci_high`.

    Raises
    ------
    ImuloopError
        If the values are no table of numbers, one is not finite, there are too few, or the rate is
        not above 0.
    """
    if not (isinstance(rate, Real) and 0 < rate < np.inf):
        raise ImuloopError(f"rate: {rate!r} is not a number of samples per second above 0")
    try:
        table = pd.DataFrame(values).astype(float)
    except (TypeError, ValueError) as error:
        raise ImuloopError(f"values: not numbers of shape (n,) or (n, k): {error}") from error
    if not np.isfinite(table.to_numpy()).all():
        raise ImuloopError("values: some are not finite; give a stretch without")
    factors, parts = averaging_factors(len(table), NoiseSettings()), []
    if not len(factors):
        raise ImuloopError(f"values: {len(table)} samples are too few for an Allan deviation")
    curve = NoiseOfCurve.of(factors, [len(table)], rate)
    for axis, column in table.items():
        x = column.to_numpy()
        variance = allan_variance([x], factors)
        edf = curve.degrees_of_freedom(np.square(fit_curve(variance, curve)))
        low, high = interval(variance, edf)
        rows = {"axis": axis, "tau_s": factors / rate, "adev": np.sqrt(variance)}
        parts.append(pd.DataFrame(rows | {"ci_low": np.sqrt(low), "ci_high": np.sqrt(high)}))
    return pd.concat(parts, ignore_index=True)
