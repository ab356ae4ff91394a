"""Noise with a correlation time in window means: its test, its limit, its held-out likelihood."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr, ndtri

from imuloop.core.fisher import fisher
from imuloop.core.noise_model import Coefficient, GaussMarkov
from imuloop.core.root import root
from imuloop.noise.likelihood import log_likelihood
from imuloop.noise.processes import gauss_markov_mean_spectrum, mean_spectra
from imuloop.noise.spectrum import CLOSE, likeliest, spectra

# correlation times that are tried a decade, from so many windows to such a share of the record
TIMES = 4
SHORTEST, LONGEST = 2.0, 1 / 16
# what the other blocks estimate of a process: a size on each axis, and its time
ESTIMATED = 4
# of errors with and without a process: more says no more
_LARGEST_RATIO = 1e9


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

    @property
    def drive(self):
        """Density q of the drive on each axis, SI, and its standard error, shape (2, 3)."""
        q = np.sqrt(2 * self.variances[:, 4] / self.tc)
        there, error = q > 0, self.std[:, 4] / self.tc
        return np.array([q, np.divide(error, q, out=np.zeros(3), where=there)])

    def beside(self, noise, place):
        """Return an axis' noise with the process, and with the flicker and walk found beside it.

        Parameters
        ----------
        noise : AxisNoise
            Noise of the axis.
        place : int
            The axis.
        """
        if not self.variances[place, 4] > 0:
            return noise
        term = GaussMarkov(Coefficient.of(*self.drive[:, place]), Coefficient.of(self.tc, 0.0))

        def root(j):
            if not self.variances[place, j] > 0:
                return Coefficient()
            value = np.sqrt(self.variances[place, j])
            return Coefficient.of(value, self.std[place, j] / (2 * value))

        return replace(noise, B=root(2), K=root(3), gauss_markov=(term,))


def correlation_times(axes):
    """Return the correlation times to try for spectra, in lengths of a window."""
    longest = LONGEST * np.pi / axes[0].theta[0]
    count = max(1, int(np.floor(TIMES * np.log10(max(longest / SHORTEST, 1)))) + 1)
    return SHORTEST * 10 ** (np.arange(count) / TIMES)


@dataclass(frozen=True)
class _Fits:
    """Fits of the three axes, without a process and with one of each correlation time.

    Attributes
    ----------
    times : ndarray, shape (c,)
        Correlation times, lengths of a window.
    log_p : ndarray, shape (c,)
        Of the likelihood ratio, the axes combined.
    plain, wide : ndarray, shape (3, 4) and (c, 3, 5)
        Variances.
    """

    times: np.ndarray
    log_p: np.ndarray
    plain: np.ndarray
    wide: np.ndarray

    @classmethod
    def of(cls, parts):
        """Return the fits of several parts, three axes each; bins that one lacks count nothing."""
        bins = max(len(axes[0].theta) for axes in parts)
        times = [correlation_times(axes) for axes in parts]
        tries = max(map(len, times))

        def beside(arrays, fill=1.0):
            found = np.full((len(parts), *arrays[0].shape[:-1], bins), fill)
            for own, values in zip(found, arrays, strict=True):
                own[..., : values.shape[-1]] = values
            return found

        power = beside([np.array([axis.power for axis in axes]) for axes in parts])
        count = beside([axes[0].count for axes in parts], 0.0)
        # an axis that never changes has no noise, and no process beside it
        dead = ~power.any(axis=2)
        power[dead] = 1.0
        # one array a time, for all axes; the last time again where a part has fewer
        each = [np.append(t, t[-1:].repeat(tries - len(t))) for t in times]
        wide = [_units(axes[0].theta, t) for axes, t in zip(parts, each, strict=True)]
        wide = beside([w.swapaxes(1, 2) for w in wide]).swapaxes(2, 3)[:, :, None]
        plain, count = wide[:, 0, :, :, :4], count[:, None]
        without = likeliest(power, count, plain)
        with_it = likeliest(power[:, None], count[:, None], wide)
        gain = _value(power[:, None], count[:, None], wide, with_it)
        gain = gain - _value(power, count, plain, without)[:, None]
        # half of chance gives no gain
        gain[np.broadcast_to(dead[:, None], gain.shape)] = 0.0
        without[dead] = 0.0
        log_p = np.where(gain > 10 * CLOSE, log_ndtr(-np.sqrt(2 * np.maximum(gain, 0))), 0.0)
        return [
            cls(t, fisher(np.moveaxis(p, 1, 0))[: len(t)], *fits)
            for t, p, *fits in zip(times, log_p, without, with_it, strict=True)
        ]

    @property
    def best(self):
        """Index of the most telling correlation time."""
        return int(np.argmin(self.log_p))


def coloured(axes, length):
    """Return the Coloured test of the three axes' spectra of windows of `length`, s."""
    (fits,) = _Fits.of([axes])
    best, times = fits.best, fits.times
    variances, std = zip(
        *(
            _estimate(axis, times[best], v, length)
            for axis, v in zip(axes, fits.wide[best], strict=True)
        ),
        strict=True,
    )
    return Coloured(
        float(fits.log_p[best] + np.log(len(times))),
        float(times[best] * length),
        len(times),
        np.array(variances),
        np.array(std),
    )


def _estimate(axis, tc, variances, length):
    """Return Q², N², B², K² and the variance of the process, and standard errors."""
    units = _units(axis.theta, tc)
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
    loss of likelihood is normal about its expectation. Held-out blocks have to be likelier, too.
    The time is the most telling one of those at which some size would be found.

    Returns
    -------
    float
        Correlation time, s.
    list of float or None
        Of each axis, SI; None where flicker and walk would imitate a process of any size.
    """

    def chance(p):
        alone = np.full((len(axes) - 1, *p.shape), np.log(0.5))
        return fisher([p, *alone]) + np.log(test.tries) - threshold

    needed = -ndtri(np.exp(root(chance, -700.0, 0.0))[0]) + ndtri(power)
    # with a root d the gain of held-out blocks is normal about d²/2 less what other blocks do not
    # know, c, its variance d² + 2 c: that it is one for certain needs more
    certain, lost = ndtri(0.975) + ndtri(power), ESTIMATED / 2
    needed = max(needed, np.sqrt((certain + np.sqrt(certain**2 + 4 * lost)) ** 2 - 2 * lost))
    times = sorted(correlation_times(axes), key=lambda tc: abs(np.log(tc * length / test.tc)))
    for tc in times:
        found = _limits(axes, tc, needed)
        if any(found):
            break
    return float(tc * length), [v and float(np.sqrt(2 * v / (tc * length))) for v in found]


def _limits(axes, tc, needed):
    """Return the variance of a process at which the root of twice the loss is as needed."""
    theta, count = axes[0].theta, axes[0].count
    plain, process = mean_spectra(theta), gauss_markov_mean_spectrum(theta, tc)
    base = likeliest(np.array([axis.power for axis in axes]), count, plain) @ plain.T

    def excess(log_v, base):
        expected = base + np.exp(log_v)[..., None] * process
        seen = likeliest(expected, count, plain) @ plain.T
        loss = log_likelihood(expected, count, expected) - log_likelihood(expected, count, seen)
        return np.sqrt(np.maximum(2 * loss, 0.0)) - needed

    tried = (np.log(base.min(axis=1) / process.max()) - 4) + np.arange(0.0, 32.0, 2.0)[:, None]
    enough = excess(tried, base) > 0
    enough[0] = False
    high = tried[enough.argmax(axis=0), np.arange(len(axes))]
    there = enough.any(axis=0)
    found = [None] * len(axes)
    if there.any():
        seen, high = base[there], high[there]
        sizes = np.exp(root(lambda log_v: excess(log_v, seen), high - 2, high, 1e-4))
        for place, v in zip(np.flatnonzero(there), sizes.tolist(), strict=True):
            found[place] = v
    return found


def held_out_ratio(folds, draws, seed):
    """Return by how much a process shrinks the error that held-out means are expected to have.

    ``exp(-gain)`` with the gain in log-likelihood a coefficient: a normal error that is smaller by
    this ratio gains as much. The noise, its correlation time too, is that of the other blocks.

    Parameters
    ----------
    folds : list of (list of (θ, squares), list of (θ, squares))
        Coefficients of the parts of the other blocks, and of each block.
    draws, seed : int
        Bootstrap draws of the interval, and their seed.

    Returns
    -------
    float
        The ratio; below 1 where the process predicts better.
    list of float
        Its 95 % interval, whole blocks drawn again.
    """
    gains, number = [], 0
    fits_of_all = _Fits.of([spectra(others) for others, _ in folds])
    for fits, (_, own) in zip(fits_of_all, folds, strict=True):
        held = spectra(own)
        power, count = np.array([axis.power for axis in held]), held[0].count
        units = _units(held[0].theta, fits.times[fits.best])
        # of an axis that never changes in the other blocks they know no noise
        known = fits.plain.any(axis=1)
        gain = _value(power[known], count, units, fits.wide[fits.best][known])
        gains.append((gain - _value(power[known], count, units[:, :4], fits.plain[known])).sum())
        number += len(held) * count.sum()
    drawn = np.random.default_rng(seed).integers(len(gains), size=(draws, len(gains)))
    losses = -len(gains) * np.array(gains)[drawn].mean(axis=1) / number
    # of a block that the others call impossible the ratio has no bound
    ratio, *ratios = np.exp(np.minimum([-sum(gains) / number, *losses], np.log(_LARGEST_RATIO)))
    return float(ratio), [float(q) for q in np.quantile(ratios, [0.025, 0.975])]


def _value(power, count, units, variances):
    """Return the log-likelihood of variances of unit spectra."""
    return log_likelihood(power, count, (units @ variances[..., None])[..., 0])


def _units(theta, tc):
    """Return the unit spectra, the process of each correlation time last, shape (..., m, 5)."""
    process = gauss_markov_mean_spectrum(theta, np.asarray(tc)[..., None])
    plain = np.broadcast_to(mean_spectra(theta), (*process.shape, 4))
    return np.concatenate([plain, process[..., None]], axis=-1)
