"""The spectrum of window means, in bins, and the likeliest variances of the processes in it."""

from dataclasses import dataclass

import numpy as np
from scipy.fft import dct

from imuloop.noise.likelihood import log_likelihood
from imuloop.noise.modes import binned
from imuloop.noise.nonnegative import nonnegative

# bins a decade
BINS = 12
# the fit ends where the likelihood grows by less
CLOSE, ROUNDS = 1e-4, 60
# share of the largest power that a bin has at least at first: one coefficient may happen to be as
# good as 0, and then it alone would count
LEAST = 1e-6


@dataclass(frozen=True)
class Spectrum:
    """The spectrum of one axis in bins.

    Attributes
    ----------
    theta : ndarray, shape (m,)
        Mean of 2π frequency times window length.
    power : ndarray, shape (m,)
        Mean square of the coefficients, SI squared.
    count : ndarray, shape (m,)
        Number of coefficients.
    """

    theta: np.ndarray
    power: np.ndarray
    count: np.ndarray


def coefficients(values):
    """Return θ, (n - 1,), and squares, (n - 1, 3), of the cosine transform of means (n, 3)."""
    n = len(values)
    squares = dct(values - values.mean(axis=0), norm="ortho", axis=0)[1:] ** 2
    return np.pi * np.arange(1, n) / n, squares


def spectra(parts):
    """Return the Spectrum of each axis of coefficients (θ, squares), pooled."""
    theta = np.concatenate([t for t, _ in parts])
    squares = np.concatenate([s for _, s in parts])
    number = np.floor(BINS * np.log10(theta / theta.min()) + 1e-9).astype(int)
    _, number, count = np.unique(number, return_inverse=True, return_counts=True)
    theta = binned(theta, number)
    return [Spectrum(theta, binned(column, number), count) for column in squares.T]


def likeliest(power, count, units):
    """Return the likeliest variances, none negative, of many spectra at once.

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
        each = zip(weighted @ units, (weighted @ power[..., None])[..., 0], guess, strict=True)
        variances = np.array([nonnegative(*one) for one in each])
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
