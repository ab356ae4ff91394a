"""Noise coefficients as common tools read them from an Allan curve.

Each function takes averaging times in s and the Allan variance, SI squared, and returns the
coefficients that it gives by letter; it tests none of them.
"""

import numpy as np

from imuloop.noise.likelihood import weighted_nnls

FLICKER = np.sqrt(2 * np.log(2) / np.pi)


def design(tau):
    """The Allan variance of Q, N, B, K, R for a unit coefficient, shape (k, 5)."""
    return np.column_stack([3 / tau**2, 1 / tau, FLICKER**2 + 0 * tau, tau / 3, tau**2 / 2])


def non_negative(tau, variance):
    """Non-negative least squares of the five terms, relative residuals: weights 1/sigma^2."""
    return _non_negative(tau, variance, 1 / np.square(variance))


def weighted(tau, variance):
    """The same, where each point counts by its own error; for white noise it grows as sqrt(tau)."""
    return _non_negative(tau, variance, 1 / (np.square(variance) * tau))


def _non_negative(tau, variance, weight):
    theta = weighted_nnls(design(tau), variance, weight)
    return {name: np.sqrt(value) for name, value in zip("QNBKR", theta, strict=True) if value}


def lines(tau, variance):
    """Lines of fixed slope through the logarithm of the deviation.

    N: slope -1/2 through tau < 10 s, read at 1 s. K: slope +1/2 through the whole curve, read at
    3 s. The way of `allan_variance_ros`, which takes 10,000 evenly spaced times up to 1000 s: here
    each of the log-spaced times counts for the evenly spaced ones that it stands for.
    """
    log_tau, log_deviation = np.log(tau), np.log(variance) / 2
    weight = np.where(tau <= 1000, np.gradient(tau), 0)
    white = np.average(log_deviation + log_tau / 2, weights=weight * (tau < 10))
    walk = np.average(log_deviation - log_tau / 2, weights=weight)
    return {"N": np.exp(white), "K": np.sqrt(3) * np.exp(walk)}


def minimum(tau, variance):
    """The lowest deviation taken as B, and as the "random walk" K; the way of `imu_utils`."""
    low = np.sqrt(np.min(variance))
    return {"B": low, "K": low}


def scaled_minimum(tau, variance):
    """The lowest deviation over 0.6643 taken as B."""
    return {"B": np.sqrt(np.min(variance)) / FLICKER}


RIVALS = {
    "non-negative fit to the curve, weights 1/σ²": non_negative,
    "the same, weights by each point's error": weighted,
    "lines: −½ below 10 s, +½ through all": lines,
    "minimum of the curve": minimum,
    "minimum of the curve / 0.6643": scaled_minimum,
}
