"""Plain non-negative fit of the five coefficients to an Allan curve: the cross-check."""

import numpy as np

from imuloop.noise.nonnegative import nonnegative

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


def fit_curve(tau, variance, covariance):
    r"""Return Q, N, B, K, R that fit an Allan curve best, none negative, none tested.

    The variance (not the deviation) is linear in the squares of the coefficients,

    .. math:: \sigma^2(\tau) = 3 Q^2/\tau^2 + N^2/\tau + (2 \ln 2/\pi) B^2 + K^2 \tau/3
        + R^2 \tau^2/2

    Weights are the inverse of the variance of each point, from the last fit and not from the
    data, which would favour points that came out low.

    Parameters
    ----------
    tau : array_like, shape (k,)
        Averaging times, s.
    variance : array_like, shape (k,)
        Overlapping Allan variance, unit of the axis squared.
    covariance : CurveCovariance
        Of the same points; its diagonal is enough.

    Returns
    -------
    list of 5 floats
        SI; zeros where the curve has under eight points or is zero somewhere.

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
        weighted = a * weight[:, None]
        theta = nonnegative(weighted.T @ a, variance @ weighted)
        weight = 1 / (covariance.variance(theta * scale) + (ROUNDING * (a @ theta)) ** 2)
    return np.sqrt(theta * scale).tolist()
