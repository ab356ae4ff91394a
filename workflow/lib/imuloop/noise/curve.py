"""Plain fit of the five coefficients to an Allan curve, and the degrees of freedom of its points.

The fit is the cross-check of the estimate; it is neither tested nor has it intervals.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import xlogy

from imuloop.noise.allan import terms
from imuloop.noise.likelihood import weighted_nnls

# order of the coefficients
TERMS = ("Q", "N", "B", "K", "R")
# fewer points cannot carry five terms
MIN_POINTS = 8
# rounds of weights, and relative rounding of the curve, so that a ramp alone keeps finite weights
ROUNDS, ROUNDING = 6, 1e-9


def design(tau):
    """Return the Allan variance of each term for a unit coefficient, shape (k, 5)."""
    tau = np.asarray(tau, dtype=float)
    flicker = np.full_like(tau, 2 * np.log(2) / np.pi)
    return np.column_stack([3 / tau**2, 1 / tau, flicker, tau / 3, tau**2 / 2])


@dataclass(frozen=True)
class CurveVariance:
    r"""Variance of the points of a pooled overlapping Allan curve, for any noise coefficients.

    The second difference of the integrated output X over m samples is Gaussian; at a distance d
    its covariance is a sum over the processes,

    .. math:: r(d) = \sum_p \theta_p r_p(d),\quad r_p(d) = \sum_{a,b} c_a c_b k_p(d + (a - b) m),
        \quad c = (1, -2, 1),\ a, b \in \{-1, 0, 1\}

    with the generalised covariance k of X: 1 at d = 0 (quantisation), -|d|/2 (white),
    d^2 ln|d| / 2 pi (flicker), |d|^3/12 (walk). The fourth moments of a Gaussian then give

    .. math:: \mathrm{var}(\sigma^2(\tau))
        = \frac{1}{4 \tau^4 M^2} \sum_d w(d) [2 r(d)^2 + 4 R^2 \tau^4 r(d)]

    where w(d) counts the pairs of terms and R is a ramp: `quadratic`, shape (k, 4, 4), holds the
    factors of theta_p theta_q, theta = (Q^2, N^2, B^2, K^2), `ramp`, (k, 4), those of R^2 theta_p.
    """

    quadratic: np.ndarray
    ramp: np.ndarray

    @classmethod
    def of(cls, factors, lengths, rate):
        """Return that of averaging `factors` over independent stretches, rate in Hz."""
        lengths, repeats = np.unique(lengths, return_counts=True)
        quadratic, ramp = np.zeros((len(factors), 4, 4)), np.zeros((len(factors), 4))
        for i, m in enumerate(np.asarray(factors, dtype=np.int64)):
            count = terms(m, lengths)
            if not count.any():
                continue

            def pairs(d, m=m, count=count):
                pairs = np.clip(lengths[:, None] + 1 - 2 * m - d, 0, count[:, None])
                return (repeats @ pairs) * np.where(d > 0, 2.0, 1.0)

            # white and walk end at 2 m; flicker's tail has gone with the fourth power
            step = max(1, m // 8)
            d = np.arange(0, 3 * m, step, dtype=float)
            smooth, weight = _second_differences(d, m, rate), pairs(d) * step
            quadratic[i, 1:, 1:] = (smooth * weight) @ smooth.T
            ramp[i, 1:] = smooth @ weight
            # quantisation lives on single lags, exactly
            d, spike = m * np.arange(3.0), np.array([6.0, -4.0, 1.0])
            weight = pairs(d) * spike
            quadratic[i, 0, 0], ramp[i, 0] = weight @ spike, weight.sum()
            quadratic[i, 0, 1:] = _second_differences(d, m, rate) @ weight
            quadratic[i, 1:, 0] = quadratic[i, 0, 1:]
            quadratic[i] /= 2 * (m / rate) ** 4 * (repeats @ count) ** 2
            ramp[i] /= (repeats @ count) ** 2
        return cls(quadratic, ramp)

    def variance(self, theta):
        """Return the variances for theta = (Q^2, N^2, B^2, K^2, R^2), shape (k,)."""
        random = np.asarray(theta[:4])
        return self.quadratic @ random @ random + theta[4] * (self.ramp @ random)

    def degrees_of_freedom(self, theta, tau):
        r"""Return the equivalent degrees of freedom of the points, shape (k,).

        .. math:: \nu = 2 \sigma^4 / \mathrm{var}(\hat\sigma^2)

        for theta as of `variance`, white noise where none is known; `tau` in s.
        """
        theta = theta if any(theta[:4]) else np.array([0, 1.0, 0, 0, 0])
        return 2 * (design(tau) @ theta) ** 2 / self.variance(theta)


def _second_differences(d, m, rate):
    """Return r_p(d) of white, flicker and walk for unit coefficients, d in samples."""
    # c by c: the second difference of a second difference
    weight = np.array([1, -4, 6, -4, 1])
    lag = np.abs(d + np.arange(-2, 3)[:, None] * m) / rate
    kernels = -lag / 2, xlogy(lag**2, lag) / (2 * np.pi), lag**3 / 12
    return np.array([weight @ kernel for kernel in kernels])


def fit_curve(tau, variance, spread):
    r"""Return Q, N, B, K, R, SI, that fit an Allan curve best, none negative, none tested.

    The variance (not the deviation) is linear in the squares of the coefficients,

    .. math:: \sigma^2(\tau) = 3 Q^2/\tau^2 + N^2/\tau + (2 \ln 2/\pi) B^2 + K^2 \tau/3
        + R^2 \tau^2/2

    Weights are the inverse of the variance of each point, from the last fit and not from the
    data, which would favour points that came out low. All are 0 where the curve has under eight
    points or is zero somewhere.

    Takes averaging times, s, overlapping Allan variance, shape (k,), and its CurveVariance.

    References
    ----------
    IEEE Std 952-1997 (R2008), annex C.
    """
    variance = np.asarray(variance, dtype=float)
    if len(variance) < MIN_POINTS or not np.all(variance > 0):
        return [0.0] * 5
    # orders of magnitude apart otherwise: fit the curve relative to itself
    a = design(tau)
    scale = np.array([np.min(variance / column) for column in a.T])
    a = a * scale
    # start: white noise, whose relative variance grows with tau
    weight = a[:, 1] / a[0, 1] / variance**2
    for _ in range(ROUNDS):
        theta = weighted_nnls(a, variance, weight)
        weight = 1 / (spread.variance(theta * scale) + (ROUNDING * (a @ theta)) ** 2)
    return np.sqrt(theta * scale).tolist()
