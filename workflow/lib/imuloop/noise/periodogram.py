"""Periodogram of a signal over the local background of its noise, in which lines are sought."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.special import betainc

# periods in a signal below which a line cannot be told from a drift; lines stay as far from half
# the rate
SHORTEST = 3
# independent values in a block of the background: a quarter (SHARE) of those below the block, but
# at least FEWEST, and at most ENOUGH for a median or WIDTH_HZ, whichever is more; and 1 % (WIDTH)
# of the frequency where that is more. The wander of mains is narrower than half a block; a wider
# peak does not count as a line
FEWEST, SHARE, ENOUGH, WIDTH_HZ, WIDTH = 24, 0.25, 256, 0.3, 0.01
# number of frequencies at which the spectrum is computed; interpolation between them is right
# within 2e-4 for a walk, the steepest spectrum, over six decades
NODES = 1000
# nodes of the integral for the chance of a peak
EXPONENTS = np.geomspace(1e-4, 1e3, 700)


@dataclass(frozen=True)
class Periodogram:
    r"""Periodogram of one Signal, divided by its noise, so that peaks can be tested.

    The periodogram is :math:`I(f) = 2 |\sum_j x_j e^{-2 \pi i f t_j}|^2/(n r)` for n values
    :math:`x_j` at the times :math:`t_j` and a sampling rate r; see `Signal.power`. It is divided by
    the spectrum S of the fitted noise, and by a background.

    The background allows for a local error of the spectrum. It is a factor for each block of
    frequencies: the largest of three medians of I/S, one in the block and one in each of its two
    neighbours. The first and the last block have the two nearest blocks as neighbours. A band of
    lines wider than half a block (0.15 Hz, 0.5 % of f or 128 independent frequencies) raises the
    background, too, and so does not count as a line.

    Let x be the height of a peak relative to spectrum and background. If the spectrum is right up
    to a local factor, I/S of noise is exponential. In noise, a peak of at least the height x then
    has the probability

    .. math:: p_1 = E[e^{-x M}],\quad p = 1 - \exp(-p_1 - W \sqrt u e^{-u}),\quad u = -\ln p_1

    where :math:`p_1` is the probability at one given frequency, and p that at any frequency of the
    searched band. M is the largest of three medians of m exponential variables of mean 1. The
    number of independent frequencies in the searched band, whose width is B, is :math:`W = B
    \sqrt{4 \pi\,\mathrm{var}(t)}`. The second formula is Baluev's bound on the maximum over a
    continuous frequency.

    Attributes
    ----------
    step : float
        Distance between two frequencies, Hz.
    first : int
        First frequency, in steps.
    edges : ndarray of int, shape (b + 1,)
        Edges of the b blocks of frequencies of the background, in steps above the first frequency.
    sizes : ndarray, shape (b,)
        m: the smallest number of independent values in the block or one of its two neighbours.
    variance : ndarray, shape (b,)
        Factor for each block, Hz. The spectrum S, SI^2/Hz, times this factor is the variance, SI^2,
        of white noise that is as dense as the noise in the block.
    ratio : ndarray, shape (f,)
        x: periodogram divided by spectrum and background, at each of f frequencies from the first
        edge to the last.
    independent : float
        W: number of independent frequencies in the searched band.
    spectrum : callable
        One-sided density S of the fitted noise, SI^2/Hz, as a function of frequency in Hz.

    References
    ----------
    R. V. Baluev, MNRAS 385 (2008) 1279. Median, largest of neighbours: H. Rohling, IEEE Trans.
    Aerosp. Electron. Syst. 19 (1983) 608.
    """

    step: float
    first: int
    edges: np.ndarray
    sizes: np.ndarray
    variance: np.ndarray
    ratio: np.ndarray
    independent: float
    spectrum: Callable

    @classmethod
    def of(cls, signal, spectrum):
        """Return the Periodogram of a Signal, or None if no sinusoid can be sought in it.

        `signal` is the Signal. The result is None if the signal is too short, has large gaps
        (`Signal.is_sparse`) or never changes. `spectrum` is the one-sided density of its noise,
        SI^2/Hz, as a function of frequency in Hz.
        """
        n = int(signal.lengths.sum())
        # frequencies in units of rate/n, the distance of independent ones
        low = SHORTEST * n / signal.extent
        sizes = _block_sizes(low, n, signal.rate)
        # in a record that never changes, nothing but rounding is left
        if not sizes or signal.is_sparse or signal.is_constant():
            return None
        power, factor = signal.power
        padded = 2 * (len(power) - 1)
        edges = np.ceil((low + np.cumsum([0, *sizes])) * padded / n).astype(int)
        edges[-1] = int((n / 2 - low) * padded / n)
        start, stop, step = edges[0], edges[-1], signal.rate / padded
        nodes = np.geomspace(start, stop, NODES)
        density = spectrum(step * nodes) * n * signal.rate / 2
        # the division stays in single precision
        expected = np.interp(np.arange(start, stop), nodes, density / factor)
        ratio = np.divide(power[start:stop], expected, dtype=power.dtype, casting="same_kind")
        edges -= start
        # only every second value: those between are not independent
        medians = np.array([np.median(ratio[i:j:2]) for i, j in pairwise(edges.tolist())])
        if not medians.all():
            return None
        centre = np.clip(np.arange(len(sizes)), 1, len(sizes) - 2)
        background = maximum_filter1d(medians, 3, mode="nearest")[centre]
        ratio /= np.repeat(background.astype(ratio.dtype), np.diff(edges))
        return cls(
            step=step,
            first=int(start),
            edges=edges,
            sizes=minimum_filter1d(sizes, 3, mode="nearest")[centre],
            variance=signal.rate / 2 * background / np.log(2),
            ratio=ratio,
            independent=float(edges[-1] / padded * np.sqrt(4 * np.pi * signal.samples.var())),
            spectrum=spectrum,
        )

    def highest(self, low=0.0, high=np.inf):
        """Return the height of the highest peak relative to the background, and its frequency, Hz.

        The peak is sought from the frequency `low` to the frequency `high`, Hz.
        """
        ends = np.array([low, high]) / self.step - self.first
        i, j = np.clip(ends, 0, len(self.ratio) - 1).astype(int)
        index = i + int(self.ratio[i : j + 1].argmax())
        return float(self.ratio[index]), (self.first + index) * self.step

    def noise(self, frequency):
        """Return the variance of white noise as dense as the noise at one frequency, SI^2, and m.

        The first result is the variance of a white noise with the sampling rate of the signal,
        whose density is that of the noise of the signal at `frequency`, Hz. The second result, m,
        is the smallest number of independent values in the block of this frequency or in one of its
        two neighbours; from it follows the error of the background.
        """
        index = np.searchsorted(self.edges[1:-1], frequency / self.step - self.first, side="right")
        return self.spectrum(np.array([frequency]))[0] * self.variance[index], self.sizes[index]

    def chance(self, sinusoid):
        """Return the probability that noise alone has a peak as high as that of a sinusoid.

        `sinusoid` is a FittedSinusoid of the signal. The probability is for the frequency of the
        sinusoid only, not for a peak anywhere.
        """
        variance, m = self.noise(sinusoid.frequency)
        return chance_at_one(sinusoid.explained / (2 * np.log(2) * variance), m)


def chance_at_one(x, m):
    """Return the probability that noise has a peak of at least the height `x` at one frequency.

    The height is a ratio of powers: the periodogram over the background, which is estimated from
    medians. The probability is E[exp(-x M)], where M is the largest of three medians of `m`
    exponential variables whose mean is 1. M allows for the error of the background.
    """
    # least squares explain nothing, or less by rounding, at x = 0
    below = betainc((m + 1) / 2, (m + 1) / 2, -np.expm1(-EXPONENTS / max(x, 1e-9))) ** 3
    return np.trapezoid(np.exp(-EXPONENTS) * below, EXPONENTS)


def chance_over_band(chance, independent):
    """Return the probability that noise has a peak of a given height anywhere in a band.

    The height is given by `chance`, the probability of a peak of at least this height at one
    frequency. `independent` is the number of independent frequencies in the band.
    """
    chance = max(chance, 1e-300)
    return float(-np.expm1(-chance * (1 + independent * np.sqrt(-np.log(min(chance, 1.0))))))


def _block_sizes(low, n, rate):
    """Return the number of independent frequencies in each block, a list of int.

    A block is a range of frequencies in which the background of the periodogram is one factor. `n`
    is the number of values of the signal and `rate` its sampling rate, Hz. Independent frequencies
    lie rate/n apart. The first block begins at the frequency `low`, in units of rate/n; the last
    one ends below n/2 - `low`. The list is empty if no block fits.
    """
    enough, sizes, k = max(ENOUGH, WIDTH_HZ * n / rate), [], low
    while k + (size := int(max(FEWEST, min(SHARE * k, enough), WIDTH * k))) < n / 2 - low:
        sizes.append(size)
        k += size
    return sizes
