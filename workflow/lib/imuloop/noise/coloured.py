"""Noise with a correlation time in window means: its test, its limit, its held-out likelihood."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import dct
from scipy.optimize import brentq
from scipy.optimize.elementwise import find_root
from scipy.special import log_ndtr, ndtri

from imuloop.core.fisher import fisher
from imuloop.core.noise_model import Coefficient, GaussMarkovTerm
from imuloop.noise.likelihood import log_likelihood, weighted_nnls
from imuloop.noise.modes import binned
from imuloop.noise.processes import gauss_markov_mean_spectrum, mean_spectra

# bins of the spectrum a decade
BINS = 12
# a fit ends where the likelihood grows by less
CLOSE, ROUNDS = 1e-4, 60
# share of the largest power that a bin has at least at first: one coefficient may happen to be as
# good as 0, and then it alone would count
LEAST = 1e-6
# correlation times that are tried a decade, from so many windows to such a share of the record
TIMES = 4
SHORTEST, LONGEST = 2.0, 1 / 16
# what the other blocks estimate of a process: a size on each axis, and its time
ESTIMATED = 4
# of errors with and without a process: more says no more
_LARGEST_RATIO = 1e9


def coefficients(values):
    """Return θ, (n - 1,), and squares, (n - 1, 3), of the cosine transform of means (n, 3)."""
    n = len(values)
    squares = dct(values - values.mean(axis=0), norm="ortho", axis=0)[1:] ** 2
    return np.pi * np.arange(1, n) / n, squares


@dataclass(frozen=True)
class WindowSpectrum:
    """The spectra of window means of the three axes, in bins.

    `theta`, shape (m,), is the mean of 2π frequency times window length, `count`, (m,), the number
    of coefficients, `power`, (3, m), their mean square, SI squared.
    """

    theta: np.ndarray
    count: np.ndarray
    power: np.ndarray

    @classmethod
    def of(cls, parts):
        """Return that of several `coefficients`, pooled."""
        theta = np.concatenate([t for t, _ in parts])
        squares = np.concatenate([s for _, s in parts])
        number = np.floor(BINS * np.log10(theta / theta.min()) + 1e-9).astype(int)
        _, number, count = np.unique(number, return_inverse=True, return_counts=True)
        power = np.array([binned(column, number) for column in squares.T])
        return cls(binned(theta, number), count, power)

    @property
    def correlation_times(self):
        """The correlation times to try, in lengths of a window."""
        longest = LONGEST * np.pi / self.theta[0]
        count = max(1, int(np.floor(TIMES * np.log10(max(longest / SHORTEST, 1)))) + 1)
        return SHORTEST * 10 ** (np.arange(count) / TIMES)

    def units(self, tc):
        """Return the spectra of unit Q, N, B, K and of a process of variance 1, shape (m, 5)."""
        process = gauss_markov_mean_spectrum(self.theta, tc)
        return np.column_stack([mean_spectra(self.theta), process])

    def value(self, units, variances):
        """Return the log-likelihood of variances, shape (3, p), of each axis."""
        return log_likelihood(self.power, self.count, variances @ units.T)


def most_likely(power, count, units):
    """Return the likeliest variances of `units`, shape (m, p), none negative, shape (p,).

    Non-negative least squares, the weights those of the last fit, until the likelihood stays;
    `power` and `count`, shape (m,), are the mean square of the coefficients and their number.
    """
    floor, last = 1e-9 * power.max(), -np.inf
    expected = np.maximum(power, LEAST * power.max())
    for _ in range(ROUNDS):
        found = weighted_nnls(units, power, count / expected**2)
        new = np.maximum(units @ found, floor)
        value = log_likelihood(power, count, new)
        if abs(value - last) < CLOSE:
            break
        # half steps in the logarithm do not swing to and fro
        expected, last = np.sqrt(expected * new), value
    return found


@dataclass(frozen=True)
class _Fits:
    """Fits of the three axes, without a process and with one of each of c correlation times.

    `log_p`, shape (c,), is that of the likelihood ratio, the axes combined; `plain` and `wide` are
    variances, shape (3, 4) and (c, 3, 5); `best` is the most telling correlation time's index.
    """

    times: np.ndarray
    log_p: np.ndarray
    plain: np.ndarray
    wide: np.ndarray

    @classmethod
    def of(cls, spectrum):
        times, units = spectrum.correlation_times, mean_spectra(spectrum.theta)
        # an axis that never changes has no noise, and no process beside it
        live = np.flatnonzero(spectrum.power.any(axis=1))
        plain, wide = np.zeros((3, 4)), np.zeros((len(times), 3, 5))
        log_p = np.zeros((3, len(times)))
        for axis in live:
            power, count = spectrum.power[axis], spectrum.count
            plain[axis] = most_likely(power, count, units)
            without = log_likelihood(power, count, units @ plain[axis])
            for i, tc in enumerate(times):
                with_it = spectrum.units(tc)
                wide[i, axis] = most_likely(power, count, with_it)
                gain = log_likelihood(power, count, with_it @ wide[i, axis]) - without
                # half of chance gives no gain
                log_p[axis, i] = log_ndtr(-np.sqrt(2 * gain)) if gain > 10 * CLOSE else 0.0
        return cls(times, fisher(log_p), plain, wide)

    @property
    def best(self):
        return int(np.argmin(self.log_p))


@dataclass(frozen=True)
class Coloured:
    """The test of noise with a correlation time."""

    # logarithm of the p-value, times the number of correlation times
    log_p: float
    # the most telling correlation time, s
    tc: float
    # Q², N², B², K² and the variance of the process on each axis, SI, and standard errors, (3, 5)
    variances: np.ndarray
    std: np.ndarray

    @property
    def p_value(self):
        """Probability of such a spectrum without the process, at most 1."""
        return float(min(1.0, np.exp(self.log_p)))

    @property
    def drive(self):
        """Density q of the drive on each axis, SI, and its standard error, shape (2, 3)."""
        q = np.sqrt(2 * self.variances[:, 4] / self.tc)
        there, error = q > 0, self.std[:, 4] / self.tc
        return np.array([q, np.divide(error, q, out=np.zeros(3), where=there)])

    def beside(self, noise, place):
        """Return the AxisNoise of an axis with the process, flicker and walk as found beside it."""
        if not self.variances[place, 4] > 0:
            return noise
        term = GaussMarkovTerm(Coefficient.of(*self.drive[:, place]), Coefficient.of(self.tc, 0.0))

        def coefficient(j):
            if not self.variances[place, j] > 0:
                return Coefficient()
            value = np.sqrt(self.variances[place, j])
            return Coefficient.of(value, self.std[place, j] / (2 * value))

        return replace(noise, B=coefficient(2), K=coefficient(3), gauss_markov=(term,))


def coloured(spectrum, length):
    """Return the Coloured test of the WindowSpectrum of windows of `length`, s."""
    fits = _Fits.of(spectrum)
    tc, variances = fits.times[fits.best], fits.wide[fits.best]
    # from windows of unit length to SI
    si = np.array([length**2, length, 1.0, 1 / length, 1.0])
    return Coloured(
        float(fits.log_p[fits.best] + np.log(len(fits.times))),
        float(tc * length),
        variances * si,
        np.array([_errors(spectrum.units(tc), spectrum.count, v) for v in variances]) * si,
    )


def _errors(units, count, variances):
    """Return the standard errors of variances, 0 where they are."""
    there = np.flatnonzero(variances > 0)
    relative = units[:, there] * np.sqrt(count / 2)[:, None] / (units @ variances)[:, None]
    size, std = np.linalg.norm(relative, axis=0), np.zeros(len(variances))
    information = (relative / size).T @ (relative / size)
    std[there] = np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True))) / size
    return std


def limits(test, spectrum, length, threshold, power):
    """Return the smallest q of each axis that would have been found, and at which time.

    The expected spectrum with a process of variance v is fitted without it: the root of twice the
    loss of likelihood is normal about its expectation. Held-out blocks have to be likelier, too.
    The time, s, is the most telling one of those at which some size would be found; q is in SI,
    None where flicker and walk would imitate a process of any size.
    """
    times = sorted(spectrum.correlation_times, key=lambda tc: abs(np.log(tc * length / test.tc)))
    alone = [np.log(0.5)] * (len(spectrum.power) - 1)

    def chance(log_p):
        return fisher([log_p, *alone]) + np.log(len(times)) - threshold

    needed = -ndtri(np.exp(brentq(chance, -700.0, 0.0))) + ndtri(power)
    # with a root d the gain of held-out blocks is normal about d²/2 less what other blocks do not
    # know, c, its variance d² + 2 c: that it is one for certain needs more
    certain, lost = ndtri(0.975) + ndtri(power), ESTIMATED / 2
    needed = max(needed, np.sqrt((certain + np.sqrt(certain**2 + 4 * lost)) ** 2 - 2 * lost))
    for tc in times:
        found = _limits(spectrum, tc, needed)
        if any(found):
            break
    return float(tc * length), [v and float(np.sqrt(2 * v / (tc * length))) for v in found]


def _limits(spectrum, tc, needed):
    """Return the variance of each axis' process at which the root of twice the loss is as needed.

    None where it is at no variance.
    """
    count, plain = spectrum.count, mean_spectra(spectrum.theta)
    process = gauss_markov_mean_spectrum(spectrum.theta, tc)
    bases = [plain @ most_likely(power, count, plain) for power in spectrum.power]

    def size(base):
        @np.vectorize
        def excess(log_v):
            expected = base + np.exp(log_v) * process
            seen = plain @ most_likely(expected, count, plain)
            loss = log_likelihood(expected, count, expected) - log_likelihood(expected, count, seen)
            return np.sqrt(max(2 * loss, 0.0)) - needed

        tried = np.log(base.min() / process.max()) - 4 + np.arange(2.0, 32.0, 2.0)
        high = next((u for u in tried if excess(u) > 0), None)
        if high is None:
            return None
        known = {"xatol": 2e-4, "xrtol": 4 * np.finfo(float).eps}
        return float(np.exp(find_root(excess, (high - 2, high), tolerances=known).x))

    return [size(base) for base in bases]


def held_out_ratio(folds, draws, seed):
    """Return by how much a process shrinks the error that held-out means are expected to have.

    ``exp(-gain)`` with the gain in log-likelihood a coefficient: a normal error that is smaller by
    this ratio gains as much. The noise, its correlation time too, is that of the other blocks.
    Takes `coefficients` of the parts of the other blocks and of each block, and number and seed of
    the bootstrap draws; gives the ratio and its 95 % interval, whole blocks drawn again.
    """
    gains, number = [], 0
    for others, own in folds:
        fits, held = _Fits.of(WindowSpectrum.of(others)), WindowSpectrum.of(own)
        units = held.units(fits.times[fits.best])
        # of an axis that never changes in the other blocks they know no noise
        known = fits.plain.any(axis=1)
        held = replace(held, power=held.power[known])
        gain = held.value(units, fits.wide[fits.best][known])
        gains.append((gain - held.value(units[:, :4], fits.plain[known])).sum())
        number += 3 * held.count.sum()
    drawn = np.random.default_rng(seed).integers(len(gains), size=(draws, len(gains)))
    losses = -len(gains) * np.array(gains)[drawn].mean(axis=1) / number
    # of a block that the others call impossible the ratio has no bound
    ratio, *ratios = np.exp(np.minimum([-sum(gains) / number, *losses], np.log(_LARGEST_RATIO)))
    return float(ratio), [float(q) for q in np.quantile(ratios, [0.025, 0.975])]
