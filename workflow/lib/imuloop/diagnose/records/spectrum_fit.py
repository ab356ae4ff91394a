"""The likeliest variances of processes whose spectra add up, none negative, many fits at once."""

from functools import cache
from itertools import product

import numpy as np

# the fit ends where the likelihood grows by less
CLOSE, ROUNDS = 1e-4, 60
# share of the largest power that a bin has at least at first: one coefficient may happen to be as
# good as 0, and then it alone would count
LEAST = 1e-6


def log_likelihood(power, count, expected):
    """Return ``-Σ n (log E + P/E)/2`` over the bins, the last axis."""
    return -(count * (np.log(expected) + power / expected)).sum(axis=-1) / 2


def likeliest(power, count, units):
    """Return the likeliest variances, none negative.

    Non-negative least squares, the weights those of the last fit, until the likelihood stays.

    Parameters
    ----------
    power : ndarray, shape (..., m)
        Mean square of the coefficients in m bins.
    count : ndarray, shape (..., m)
        Number of coefficients, 0 in a bin that one fit lacks and another has.
    units : ndarray, shape (..., m, k)
        Spectra of variance one.

    Returns
    -------
    ndarray, shape (..., k)
        Variances; the axes before the last are those of power and units together.
    """
    shape = np.broadcast_shapes(power.shape, units.shape[:-1])
    k = units.shape[-1]
    power = np.broadcast_to(power, shape).reshape(-1, shape[-1])
    count = np.broadcast_to(count, shape).reshape(-1, shape[-1])
    units = np.broadcast_to(units, (*shape, k)).reshape(-1, shape[-1], k)
    size = units.max(axis=1)
    units, floor = units / size[:, None], 1e-9 * power.max(axis=1, keepdims=True)
    found = np.zeros((len(power), k))
    open_ = np.arange(len(power))
    expected = np.maximum(power, LEAST * power.max(axis=1, keepdims=True))
    last, guess = np.full(len(power), -np.inf), np.ones((len(power), k), bool)
    for _ in range(ROUNDS):
        weight = count / expected**2
        weighted = (units * weight[..., None]).swapaxes(1, 2)
        variances = nonnegative(weighted @ units, (weighted @ power[..., None])[..., 0], guess)
        found[open_] = variances
        new = np.maximum((units @ variances[..., None])[..., 0], floor)
        value = log_likelihood(power, count, new)
        more = np.abs(value - last) >= CLOSE
        if not more.any():
            break
        # half steps in the logarithm do not swing to and fro
        expected = np.sqrt(expected * new)[more]
        last, guess, open_ = value[more], variances[more] > 0, open_[more]
        power, count, units, floor = power[more], count[more], units[more], floor[more]
    return (found / size).reshape(*shape[:-1], k)


def nonnegative(normal, moment, guess):
    """Return the x, none negative, that minimise ``xᵀ A x - 2 bᵀ x`` of several small problems.

    Where a guess of what is above zero does not hold, every subset is solved: the best of those
    without a negative part is the solution.

    Parameters
    ----------
    normal, moment : ndarray, shape (p, k, k) and (p, k)
        A, positive definite, and b.
    guess : ndarray of bool, shape (p, k)
        What may be above zero.
    """
    size = np.sqrt(np.einsum("pkk->pk", normal))
    a, b = normal / size[:, :, None] / size[:, None, :], moment / size
    found = _solved(a, b, guess)
    slope = b - (a @ found[..., None])[..., 0]
    rounding = 1e-12 * np.abs(b).max(axis=1, keepdims=True)
    wrong = np.any((found < 0) | (~guess & (slope > rounding)), axis=1)
    if wrong.any():
        subsets = _subsets(b.shape[1])
        every = _solved(a[wrong][:, None], b[wrong][:, None], subsets)
        gain = (every * b[wrong][:, None]).sum(axis=2)
        best = np.where((every >= 0).all(axis=2), gain, -np.inf).argmax(axis=1)
        found[wrong] = every[np.arange(len(best)), best]
    return found / size


@cache
def _subsets(k):
    return np.array(list(product((False, True), repeat=k)))


def _solved(a, b, there):
    """Return the solutions with some components alone, the others zero."""
    alone = np.where(there[..., :, None] & there[..., None, :], a, np.eye(a.shape[-1]))
    return np.linalg.solve(alone, np.where(there, b, 0.0)[..., None])[..., 0]
