"""Covariance between the points of an Allan curve: they share the same data."""

from dataclasses import dataclass

import numpy as np

from imuloop.noise.allan import terms
from imuloop.noise.fit import TERMS, design


@dataclass(frozen=True)
class CurveCovariance:
    r"""Covariance of overlapping Allan variances as a function of the noise coefficients.

    The second difference of the integrated output X over m samples is Gaussian; between the
    factors m, m' and at a distance d of their centres its covariance is a sum over the processes,

    .. math:: r(d) = \sum_p \theta_p r_p(d),\quad r_p(d) = \sum_{a,b} c_a c_b k_p(d + a m - b m'),
        \quad c = (1, -2, 1),\ a, b \in \{-1, 0, 1\}

    with the generalised covariance k of X: 1 at d = 0 (quantisation), -|d|/2 (white),
    d^2 ln|d| / 2 pi (flicker), |d|^3/12 (walk). The fourth moments of a Gaussian then give

    .. math:: \mathrm{cov}(\sigma^2(\tau), \sigma^2(\tau'))
        = \frac{1}{4 \tau^2 \tau'^2 M M'} \sum_d w(d) [2 r(d)^2 + 4 R^2 \tau^2 \tau'^2 r(d)]

    where w(d) counts the pairs of terms and R is a ramp. It is quadratic in theta, so the sums
    over d are taken once and serve every axis and every iteration of a fit.

    Attributes
    ----------
    quadratic : ndarray, shape (4, 4, k, k)
        Factors of theta_p theta_q, theta = (Q^2, N^2, B^2, K^2).
    ramp : ndarray, shape (4, k, k)
        Factors of R^2 theta_p.
    """

    quadratic: np.ndarray
    ramp: np.ndarray

    def matrix(self, theta):
        """Return the covariance for theta = (Q^2, N^2, B^2, K^2, R^2), shape (k, k)."""
        random = theta[:4]
        quadratic = np.tensordot(np.outer(random, random), self.quadratic, axes=2)
        return quadratic + theta[4] * np.tensordot(random, self.ramp, axes=1)

    def variance(self, theta):
        """Return the diagonal of `matrix`, shape (k,)."""
        random = theta[:4]
        quadratic = np.einsum("p,q,pqii->i", random, random, self.quadratic)
        return quadratic + theta[4] * np.einsum("p,pii->i", random, self.ramp)


def degrees_of_freedom(noise, tau, covariance):
    r"""Return the equivalent degrees of freedom of the points of an Allan curve.

    .. math:: \nu = 2 \sigma^4 / \mathrm{var}(\hat\sigma^2)

    Parameters
    ----------
    noise : AxisNoise
        Its five coefficients; where none is known, white noise.
    tau : array_like, shape (k,)
        Averaging times, s.
    covariance : CurveCovariance
        Of the same points; its diagonal is enough.

    Returns
    -------
    ndarray, shape (k,)
    """
    theta = np.array([getattr(noise, name).square for name in TERMS])
    theta = theta if theta[:4].any() else np.array([0, 1.0, 0, 0, 0])
    return 2 * (design(tau) @ theta) ** 2 / covariance.variance(theta)


def curve_covariance(factors, lengths, rate, reach=300.0):
    """Return the covariance of the points of one pooled Allan curve.

    Parameters
    ----------
    factors : array_like of int, shape (k,)
        Averaging factors, ascending.
    lengths : array_like of int, shape (s,)
        Samples of each stretch; stretches count as independent.
    rate : float
        Sampling rate, Hz.
    reach : float
        Largest ratio of two factors whose covariance is computed; beyond, it is taken as zero
        (for white noise the correlation falls with the power 3/2 of the ratio). 1 gives the
        diagonal alone.

    Returns
    -------
    CurveCovariance
    """
    factors = np.asarray(factors, dtype=np.int64)
    lengths, repeats = np.unique(lengths, return_counts=True)
    counts = terms(factors, lengths[:, None])
    total = repeats @ counts
    quadratic = np.zeros((4, 4, len(factors), len(factors)))
    ramp = np.zeros((4, len(factors), len(factors)))
    tau = factors / rate
    for i, short in enumerate(factors):
        for j in range(i, len(factors)):
            long = factors[j]
            if long > reach * short or total[j] == 0:
                break

            def pairs(d, short=short, long=long, j=j):
                return repeats @ np.clip(
                    lengths[:, None] + 1 - short - long - d, 0, counts[:, j : j + 1]
                )

            # white and walk end at short + long; flicker's tail has gone with the fourth power
            step = max(1, short // 8)
            d = np.arange(0, short + 2 * long, step, dtype=float)
            smooth = _second_differences(d, short, long, rate)
            weight = pairs(d) * np.where(d > 0, 2.0, 1.0) * step
            second, first = np.zeros((4, 4)), np.zeros(4)
            second[1:, 1:] = (smooth * weight) @ smooth.T
            first[1:] = smooth @ weight
            # quantisation lives on single lags, exactly
            d, spike = _spikes(short, long)
            weight = pairs(np.abs(d))
            first[0] = weight @ spike
            second[0, 0] = weight @ spike**2
            second[0, 1:] = _second_differences(d, short, long, rate) @ (weight * spike)
            second[1:, 0] = second[0, 1:]
            scale = total[i] * total[j]
            quadratic[:, :, i, j] = quadratic[:, :, j, i] = second / (
                2 * tau[i] ** 2 * tau[j] ** 2 * scale
            )
            ramp[:, i, j] = ramp[:, j, i] = first / scale
    return CurveCovariance(quadratic, ramp)


def _second_differences(d, short, long, rate):
    """Return r_p(d) of white, flicker and walk for unit coefficients, d in samples."""
    total = np.zeros((3, len(d)))
    for a, ca in ((-1, 1), (0, -2), (1, 1)):
        for b, cb in ((-1, 1), (0, -2), (1, 1)):
            lag = np.abs(d + a * short - b * long) / rate
            square = lag * lag
            logarithm = np.log(lag, out=np.zeros_like(lag), where=lag > 0)
            total[0] -= ca * cb / 2 * lag
            total[1] += ca * cb / (2 * np.pi) * square * logarithm
            total[2] += ca * cb / 12 * square * lag
    return total


def _spikes(short, long):
    """Return the lags at which quantisation noise correlates, and how."""
    a, b = np.meshgrid([-1, 0, 1], [-1, 0, 1])
    coefficient = np.array([1.0, -2.0, 1.0])
    lags, inverse = np.unique(-a * short + b * long, return_inverse=True)
    return lags.astype(float), np.bincount(
        inverse.ravel(), (coefficient[a + 1] * coefficient[b + 1]).ravel()
    )
