"""The spectrum of a static record: noise with a correlation time beside the usual terms."""

from dataclasses import dataclass

import numpy as np
from scipy.fft import dct
from scipy.optimize import brentq, nnls
from scipy.stats import norm

from imuloop.diagnose.static_search import fisher

# bins of the spectrum a decade, and the correlation times that are tried
BINS, TIMES = 12, 4
# correlation times from so many windows to such a share of the record
SHORTEST, LONGEST = 2.0, 1 / 16
# the fit ends where the likelihood grows by less
CLOSE, ROUNDS = 1e-4, 60


def unit_spectra(theta):
    """Return the spectra of window means for unit Q, N, B, K and windows of unit length.

    Parameters
    ----------
    theta : ndarray, shape (m,)
        2π times frequency times length of a window.

    Returns
    -------
    ndarray, shape (m, 4)
        Expected square of the coefficients of an orthonormal cosine transform. The walk's holds
        exactly but for the ends, flicker is summed over its aliases.
    """
    cosine = np.cos(theta)
    aliases = np.abs(theta[:, None] / (2 * np.pi) + np.arange(-8, 9))
    flicker = (np.sinc(aliases) ** 2 / (2 * np.pi * aliases)).sum(axis=1)
    return np.column_stack(
        [2 - 2 * cosine, np.ones_like(theta), flicker, (2 + cosine) / (6 * (1 - cosine))]
    )


def process_spectrum(theta, tc):
    """Return the same for a Gauss-Markov process of variance 1, `tc` in lengths of a window."""
    a, cosine = np.exp(-1 / tc), np.cos(theta)
    same = 2 * tc**2 * (1 / tc - 1 + a)
    next_one = tc**2 * (1 - a) ** 2
    return same + 2 * next_one * (cosine - a) / (1 - 2 * a * cosine + a * a)


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

    def log_likelihood(self, expected):
        """Return ``-Σ n (log E + P/E)/2``."""
        return float(-(self.count * (np.log(expected) + self.power / expected)).sum() / 2)

    def fit(self, units):
        """Return the likeliest variances, none negative, of unit spectra, shape (m, k).

        Non-negative least squares, the weights those of the last fit, until the likelihood stays.
        """
        size = units.max(axis=0)
        units = units / size
        expected, last = self.power.copy(), -np.inf
        for _ in range(ROUNDS):
            weight = np.sqrt(self.count) / expected
            variances, _ = nnls(units * weight[:, None], self.power * weight)
            new = np.maximum(units @ variances, 1e-9 * self.power.max())
            # half steps in the logarithm do not swing to and fro
            expected = np.sqrt(expected * new)
            value = self.log_likelihood(new)
            if abs(value - last) < CLOSE:
                break
            last = value
        return variances / size


def coefficients(values):
    """Return θ, (n - 1,), and squares, (n - 1, 3), of the cosine transform of means (n, 3)."""
    n = len(values)
    squares = dct(values - values.mean(axis=0), type=2, norm="ortho", axis=0)[1:] ** 2
    return np.pi * np.arange(1, n) / n, squares


def spectra(parts):
    """Return the Spectrum of each axis of coefficients (θ, squares), pooled."""
    theta = np.concatenate([t for t, _ in parts])
    squares = np.concatenate([s for _, s in parts])
    number = np.floor(BINS * np.log10(theta / theta.min()) + 1e-9).astype(int)
    _, number, count = np.unique(number, return_inverse=True, return_counts=True)

    def mean(values):
        return np.bincount(number, weights=values) / count

    return [Spectrum(mean(theta), mean(column), count) for column in squares.T]


@dataclass(frozen=True)
class Coloured:
    """The test of noise with a correlation time.

    Attributes
    ----------
    log_p : float
        Logarithm of the p-value, times the number of correlation times.
    tc : float
        The most telling correlation time, s.
    tries : int
        Number of correlation times.
    variances : ndarray, shape (3, 5)
        Q², N², B², K² and the variance of the process on each axis, SI.
    std : ndarray, shape (3, 5)
        Their standard errors.
    """

    log_p: float
    tc: float
    tries: int
    variances: np.ndarray
    std: np.ndarray

    @property
    def p_value(self):
        """Probability of such a spectrum without the process, at most 1."""
        return float(min(1.0, np.exp(self.log_p)))


def correlation_times(axes):
    """Return the correlation times to try for spectra, in lengths of a window."""
    longest = LONGEST * np.pi / axes[0].theta[0]
    count = max(1, int(np.floor(TIMES * np.log10(max(longest / SHORTEST, 1)))) + 1)
    return SHORTEST * 10 ** (np.arange(count) / TIMES)


def log_p_value(axis, tc):
    """Return log p of the likelihood ratio of a process of one axis; half of chance gives none."""
    plain = unit_spectra(axis.theta)
    wide = np.column_stack([plain, process_spectrum(axis.theta, tc)])
    without, with_it = (axis.log_likelihood(u @ axis.fit(u)) for u in (plain, wide))
    gain = with_it - without
    return float(norm.logsf(np.sqrt(2 * gain))) if gain > 10 * CLOSE else 0.0


def coloured(axes, length):
    """Return the Coloured test of the three axes' spectra of windows of `length`, s."""
    times = correlation_times(axes)
    tests = [fisher([log_p_value(axis, tc) for axis in axes]) for tc in times]
    best = int(np.argmin(tests))
    tc = times[best]
    variances, std = zip(*(_estimate(axis, tc, length) for axis in axes), strict=True)
    return Coloured(
        tests[best] + np.log(len(times)),
        float(tc * length),
        len(times),
        np.array(variances),
        np.array(std),
    )


def _estimate(axis, tc, length):
    """Return Q², N², B², K² and the variance of the process, and standard errors."""
    units = np.column_stack([unit_spectra(axis.theta), process_spectrum(axis.theta, tc)])
    variances = axis.fit(units)
    there = np.flatnonzero(variances > 0)
    relative = units[:, there] * np.sqrt(axis.count / 2)[:, None] / (units @ variances)[:, None]
    std = np.zeros(5)
    size = np.linalg.norm(relative, axis=0)
    information = (relative / size).T @ (relative / size)
    std[there] = np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True))) / size
    # from windows of unit length to SI
    unit = np.array([length**2, length, 1.0, 1 / length, 1.0])
    return variances * unit, std * unit


def limits(test, axes, length, threshold, power):
    """Return the smallest q of each axis that would have been found, and at which time.

    The expected spectrum with a process of variance v is fitted without it: the root of twice the
    loss of likelihood is normal about its expectation. The time is the most telling one of those
    at which some size would be found.

    Returns
    -------
    float
        Correlation time, s.
    list of float or None
        Of each axis, SI; None where flicker and walk would imitate a process of any size.
    """

    def chance(p):
        return fisher([p, *[np.log(0.5)] * (len(axes) - 1)]) + np.log(test.tries) - threshold

    needed = norm.isf(np.exp(brentq(chance, -700.0, 0.0))) + norm.ppf(power)
    times = sorted(correlation_times(axes), key=lambda tc: abs(np.log(tc * length / test.tc)))
    for tc in times:
        found = [_limit(axis, tc, needed) for axis in axes]
        if any(found):
            break
    return float(tc * length), [v and float(np.sqrt(2 * v / (tc * length))) for v in found]


def _limit(axis, tc, needed):
    """Return the variance of a process at which the root of twice the loss is as needed."""
    plain, process = unit_spectra(axis.theta), process_spectrum(axis.theta, tc)
    base = plain @ axis.fit(plain)

    def excess(log_v):
        expected = base + np.exp(log_v) * process
        seen = Spectrum(axis.theta, expected, axis.count)
        loss = seen.log_likelihood(expected) - seen.log_likelihood(plain @ seen.fit(plain))
        return np.sqrt(max(2 * loss, 0.0)) - needed

    low = np.log(base.min() / process.max()) - 4
    for high in low + np.arange(2.0, 32.0, 2.0):
        if excess(high) > 0:
            return float(np.exp(brentq(excess, high - 2, high, xtol=1e-2)))
    return None


def held_out_ratio(folds, length, settings):
    """Return by how much a process shrinks the error that held-out means are expected to have.

    ``exp(-gain)`` with the gain in log-likelihood a coefficient: a normal error that is smaller by
    this ratio gains as much. The noise, its correlation time too, is that of the other blocks.

    Parameters
    ----------
    folds : list of (list of (θ, squares), list of (θ, squares))
        Coefficients of the parts of the other blocks, and of each block.
    length : float
        Length of the windows, s.
    settings : DiagnoseSettings
        Draws and seed.

    Returns
    -------
    float
        The ratio; below 1 where the process predicts better.
    list of float
        Its 95 % interval, whole blocks drawn again.
    """
    gains, number = [], 0
    for others, own in folds:
        gain, seen = 0.0, spectra(others)
        tc = coloured(seen, length).tc / length
        for rest, held in zip(seen, spectra(own), strict=True):
            plain, wide = (_units(rest.theta, tc, w) for w in (False, True))
            at, at_wide = (_units(held.theta, tc, w) for w in (False, True))
            gain += held.log_likelihood(at_wide @ rest.fit(wide))
            gain -= held.log_likelihood(at @ rest.fit(plain))
            number += held.count.sum()
        gains.append(gain)
    draws = np.random.default_rng(settings.seed).integers(
        len(gains), size=(settings.draws, len(gains))
    )
    ratios = np.exp(-len(gains) * np.array(gains)[draws].mean(axis=1) / number)
    interval = [float(q) for q in np.quantile(ratios, [0.025, 0.975])]
    return float(np.exp(-sum(gains) / number)), interval


def _units(theta, tc, wide):
    plain = unit_spectra(theta)
    return np.column_stack([plain, process_spectrum(theta, tc)]) if wide else plain
