"""Estimators of N, B and K, each a few lines; `bench.noise.methods` compares them.

All of them take squares of linear forms of a record, whose expectation is linear in the squared
coefficients theta = (N^2, B^2, K^2), and weigh them by their scatter under the noise found so far.
For squares of independent Gaussian forms the fixed point of that is the maximum of the likelihood.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.fft import dct, dctn, dst, next_fast_len
from scipy.linalg import cholesky, eigh, solve_triangular
from scipy.optimize import nnls

from imuloop.noise.allan import allan_variance, averaging_factors
from imuloop.noise.curve_covariance import curve_covariance
from imuloop.noise.fit import design
from imuloop.noise.layout import Layout
from imuloop.noise.modes import expected_squares, modes
from imuloop.noise.processes import (
    densities,
    distances,
    mean_covariances,
    sample_covariances,
)
from imuloop.noise.settings import NoiseSettings

TERMS = "NBK"


@dataclass(frozen=True)
class Method:
    """Squares of linear forms of a record of a given length and rate.

    Attributes
    ----------
    squares : callable
        Record, shape (n,), to the squares, shape (k,), SI squared.
    expected : ndarray, shape (k, 3)
        Expected squares for unit N, B, K; not-a-number where the method cannot have the term.
    scatter : callable
        theta, shape (3,), and the squares found to their variance, shape (k,), or covariance,
        shape (k, k).
    """

    squares: Callable
    expected: np.ndarray
    scatter: Callable


def independent(squares, expected, values=1):
    """Return the Method of independent squares, each the mean of that many Gaussian values."""
    return Method(squares, expected, lambda theta, _: 2 * _model(expected, theta) ** 2 / values)


def sine(n, rate):
    r"""Exact likelihood of the first differences of white noise and walk.

    Their covariance is tridiagonal Toeplitz; the DST-I diagonalises it, with the eigenvalues
    :math:`N^2 (2 - 2\cos\omega)/\Delta t + K^2 \Delta t,\ \omega = \pi k/n`.
    """
    chord = 2 - 2 * np.cos(np.pi * np.arange(1, n) / n)
    nothing = np.full(n - 1, np.nan)
    expected = np.column_stack([chord * rate, nothing, np.full(n - 1, 1 / rate)])
    return independent(lambda x: dst(np.diff(x), type=1, norm="ortho") ** 2, expected)


def cosine(n, rate):
    """Debiased Whittle likelihood in the DCT-II of the record itself, without its mean."""
    expected = expected_squares(sample_covariances(n, 1 / rate)[1:]).T
    return independent(lambda x: dct(x, norm="ortho")[1:] ** 2, expected)


def blocks(n, rate):
    """Return the modes of `imuloop.noise`: cosines in blocks, and of the means of the blocks."""
    basis = modes([Layout(rate, (0,), (n,), (0,))])

    def squares(x):
        slow, fast = basis.amplitudes([[x]])
        return np.concatenate([slow**2, fast])

    return independent(squares, basis.units[:, 1:], basis.count)


def dense(n, rate, m=50):
    """Exact likelihood of white and flicker noise in block means, cosines within the blocks.

    For two terms one eigenvector problem, O(n^3), serves all records of this length; three need a
    factorisation of the covariance in each step of each fit.
    """
    number = n // m
    covariance = mean_covariances(distances(m * np.arange(number)), m, 1 / rate)[2]
    # in the cosine basis without the mean, where white noise is the identity
    covariance = dctn(covariance, norm="ortho")[1:, 1:]
    values, vectors = eigh(covariance)
    within = expected_squares(sample_covariances(m, 1 / rate)[1:3]).T
    # unit N, B: a mean of m samples of white noise has the variance rate/m
    between = np.column_stack([np.full(number - 1, rate / m), values])
    expected = np.concatenate([between, within])
    expected = np.column_stack([expected, np.full(len(expected), np.nan)])

    def squares(x):
        parts = x[: number * m].reshape(number, m)
        slow = vectors.T @ dct(parts.mean(axis=1), norm="ortho")[1:]
        fast = dct(parts, norm="ortho", axis=1)[:, 1:]
        return np.concatenate([slow**2, (fast**2).mean(axis=0)])

    return independent(squares, expected, np.repeat([1, number], [number - 1, m - 1]))


def fourier(n, rate, debiased=True, taper=None):
    r"""Whittle likelihood of the first differences.

    Debiased: with the expected periodogram :math:`\sum_d \gamma_d h_d e^{-i\omega d}` instead of
    the spectral density, h the autocorrelation of the taper, without one the triangle 1 - |d|/n.
    """
    n -= 1
    taper = np.ones(n) if taper is None else taper(n)
    taper = taper / np.linalg.norm(taper)
    kept = np.arange(1, (n + 1) // 2)
    if debiased:
        expected = expected_periodogram(differenced(n, rate), taper)[:, kept].T
    else:
        frequency = kept * rate / n
        chord = 2 - 2 * np.cos(2 * np.pi * kept / n)
        expected = densities(frequency, 1 / rate)[:, 1:] * (chord * rate)[:, None]
    return independent(
        lambda x: np.abs(np.fft.rfft(taper * np.diff(x))[kept]) ** 2, expected, values=2
    )


def differenced(n, rate):
    """Return the covariance of n first differences for unit N, B, K, shape (3, n)."""
    record = sample_covariances(n + 1, 1 / rate)[1:]
    both = np.concatenate([record[:, 1:2], record], axis=1)
    return 2 * both[:, 1:-1] - both[:, :-2] - both[:, 2:]


def expected_periodogram(covariance, taper):
    """Return the expected periodogram at the n // 2 + 1 frequencies, shape (..., n // 2 + 1)."""
    n = len(taper)
    size = next_fast_len(2 * n, real=True)
    overlap = np.fft.irfft(np.abs(np.fft.rfft(taper, size)) ** 2, size)[:n]
    product = covariance * overlap
    return 2 * np.fft.rfft(product).real - product[..., :1]


def sine_taper(n):
    """Return the first sine taper, zero just outside the record."""
    return np.sin(np.pi * np.arange(1, n + 1) / (n + 1))


def wavelet(n, rate):
    """Generalised method of wavelet moments: Haar variances at dyadic scales, full covariance."""
    factors = 2 ** np.arange(int(np.log2(n / 2)) + 1)
    covariance = curve_covariance(factors, [n], rate)
    return Method(
        lambda x: allan_variance([x], factors),
        _curve(factors, rate),
        lambda theta, _: covariance.matrix(_five(theta)),
    )


def curve(n, rate, relative=True):
    """Non-negative least squares on the Allan curve, ten points a decade.

    With relative residuals, or with weights from the variance of each point.
    """
    factors = averaging_factors(n, NoiseSettings())
    if relative:
        scatter = lambda _, found: found**2  # noqa: E731
    else:
        covariance = curve_covariance(factors, [n], rate, reach=1)
        scatter = lambda theta, _: covariance.variance(_five(theta))  # noqa: E731
    return Method(lambda x: allan_variance([x], factors), _curve(factors, rate), scatter)


def _curve(factors, rate):
    """Return the Allan variances for unit N, B, K, those of flicker and walk by samples."""
    expected = design(factors / rate)[:, 1:4]
    for row, m in zip(expected, factors, strict=True):
        flicker = mean_covariances(np.array([0, m]), int(m), 1 / rate)[2]
        row[1] = flicker[0] - flicker[1]
    expected[:, 2] *= 1 + 1 / (2 * factors.astype(float) ** 2)
    return expected


def _five(theta):
    """Return (Q^2, N^2, B^2, K^2, R^2)."""
    return np.array([0, *theta, 0])


def _model(expected, theta):
    """Return the expected squares, terms of zero left out."""
    used = np.asarray(theta) > 0
    return expected[:, used] @ theta[used]


def estimate(method, x, terms, rounds=50):
    """Return the coefficients of a record.

    Parameters
    ----------
    method : Method
        Made for the length and rate of the record.
    x : ndarray, shape (n,)
        Record, SI.
    terms : str
        Those to fit, 'N' among them: a part of 'NBK'.
    rounds : int
        Most steps of Fisher's scoring.

    Returns
    -------
    ndarray, shape (3,)
        N, B, K, SI; 0 where not fitted.
    """
    fitted = [TERMS.index(t) for t in terms]
    found = method.squares(x)
    theta = np.zeros(3)
    theta[0] = np.median(found / method.expected[:, 0])
    for step in range(rounds):
        gram, projection = _normal(method, theta, found, fitted)
        size = np.sqrt(np.diag(gram))
        root = cholesky(gram / np.outer(size, size))
        right = solve_triangular(root, projection / size, trans="T")
        new = np.zeros(3)
        new[fitted] = nnls(root, right)[0] / size
        change = np.abs(new[fitted] - theta[fitted]) * size
        # half a step where whole ones swing to and fro
        theta = new if step < rounds // 3 else (theta + new) / 2
        # in standard errors
        if change.max() < 1e-3:
            break
    return np.sqrt(theta)


def bound(method, truth):
    """Return the relative standard errors of the terms of `truth`, a dict, as one.

    The Cramér–Rao bound where the squares are those of independent Gaussian values and hold all
    that the record tells; the level is unknown too.
    """
    theta = np.array([truth.get(t, 0.0) for t in TERMS]) ** 2
    fitted = np.flatnonzero(theta)
    relative = standard_errors(method, theta, fitted) / theta[fitted] / 2
    return {TERMS[j]: e for j, e in zip(fitted, relative, strict=True)}


def standard_errors(method, theta, fitted):
    """Return the standard errors of the squared coefficients of the columns `fitted`."""
    gram, _ = _normal(method, theta, np.zeros(len(method.expected)), fitted)
    size = np.sqrt(np.diag(gram))
    return np.sqrt(np.diag(np.linalg.inv(gram / np.outer(size, size)))) / size


def diagonal_loss(units, theta):
    """Return the standard errors where modes count as uncorrelated over those of the exact bound.

    Parameters
    ----------
    units : ndarray, shape (p, k, k)
        Covariance of the modes for unit coefficients.
    theta : ndarray, shape (p,)
        Squared coefficients.
    """
    covariance = np.tensordot(theta, units, axes=1)
    solved = [np.linalg.solve(covariance, unit) for unit in units]
    information = np.array([[np.sum(a * b.T) / 2 for a in solved] for b in solved])
    expected = np.diagonal(units, axis1=1, axis2=2)
    weights = expected / np.diag(covariance) ** 2 / 2
    linear = np.linalg.solve(weights @ expected.T, weights)
    found = linear @ (2 * covariance**2) @ linear.T
    return np.sqrt(np.diag(found) / np.diag(np.linalg.inv(information)))


def _normal(method, theta, found, fitted):
    """Return A' C^-1 A and A' C^-1 y."""
    a, c = method.expected[:, fitted], method.scatter(theta, found)
    if c.ndim == 1:
        weighted = a / c[:, None]
        return weighted.T @ a, weighted.T @ found
    root = cholesky(c, lower=True)
    a, y = (solve_triangular(root, v, lower=True) for v in (a, found))
    return a.T @ a, a.T @ y
