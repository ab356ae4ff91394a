"""Periodogram of the clean stretches of a signal, over its local background."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.special import betainc

# periods in a signal below which a line is not told from a drift; as far from Nyquist
SHORTEST = 3
# independent values in a block of the background: at least, and a quarter of those below it up to
# what a median needs and to 0.3 Hz; 1 % of its frequency where that is more. Mains' wander, folded
# or not, is narrower than half a block and a line; what is wider is none
FEWEST, SHARE, ENOUGH, WIDTH_HZ, WIDTH = 24, 0.25, 256, 0.3, 0.01
# frequencies at which the spectrum is calculated: 2e-4 of a walk's, the steepest, over six decades
NODES = 1000
# where the chance of a peak is integrated
EXPONENTS = np.geomspace(1e-4, 1e3, 700)
# chance at one frequency below which peaks are ranked by their height
SURE = 1e-9


@dataclass(frozen=True)
class Periodogram:
    r"""Periodogram of one Signal relative to its spectrum, and the background of its blocks.

    The periodogram :math:`I(f) = 2 |\sum x_j e^{-2 \pi i f t_j}|^2/(n r)`, level means and one
    slope removed, gaps filled with zeros, padded to twice the record, is divided by the spectrum
    and by the local background: the largest of the medians of I/S in the block of frequencies
    around and in the two beside it, or the next two at an end. So a misfit of the smooth model, its
    slope, and a band of neighbouring lines wider than half a block (0.15 Hz, 0.5 % of f or 128
    independent frequencies) raise the background and are no lines. With a spectrum that is right up
    to a local factor, I/S
    is exponential, and

    .. math:: p_1 = E[e^{-x M}],\quad p = 1 - \exp(-p_1 - W \sqrt u e^{-u}),\quad u = -\ln p_1

    where x is the ratio at its maximum, M the largest of the medians of m exponentials and
    :math:`W = B \sqrt{4 \pi\,\mathrm{var}(t)}` counts the independent frequencies of the band B
    (Baluev's bound on the maximum over a continuous frequency).

    Attributes
    ----------
    step : float
        Between frequencies of the padded transform, Hz.
    first : int
        Number of the first frequency, in steps.
    edges : ndarray of int, shape (b + 1,)
        Of the blocks of the background, in steps from the first.
    sizes, background : ndarray, shape (b,)
        Of each block and the two nearest the fewest independent values, and the largest median.
    ratio : ndarray
        I/S from the first edge to the last.
    independent : float
        W.
    spectrum : callable
        S, one-sided, as a function of frequency in Hz.
    rate : float
        Of the samples, Hz.

    References
    ----------
    R. V. Baluev, MNRAS 385 (2008) 1279. Median, largest of neighbours: H. Rohling, IEEE Trans.
    Aerosp. Electron. Syst. 19 (1983) 608.
    """

    step: float
    first: int
    edges: np.ndarray
    sizes: np.ndarray
    background: np.ndarray
    ratio: np.ndarray
    independent: float
    spectrum: Callable
    rate: float

    @classmethod
    def of(cls, signal, spectrum):
        """Return the periodogram of one Signal; None if it is too short, sparse or has no noise.

        `spectrum` is the one-sided density, SI^2/Hz, as a function of frequency in Hz.
        """
        n, (first, last) = int(signal.lengths.sum()), signal.extent
        # frequencies in units of rate/n, the distance of independent ones
        low = SHORTEST * n / (last + 1 - first)
        sizes = _block_sizes(low, n, signal.rate)
        # of what never changes rounding alone is left
        if not sizes or signal.is_sparse or signal.is_constant():
            return None
        t = signal.samples.astype(float)
        padded = 16 * fft.next_fast_len(-(-(last + 1 - first) // 8))
        edges = np.ceil((low + np.cumsum([0, *sizes])) * padded / n).astype(int)
        edges[-1] = int((n / 2 - low) * padded / n)
        start, stop, step = edges[0], edges[-1], signal.rate / padded
        nodes = np.geomspace(start, stop, NODES)
        density = spectrum(step * nodes) * n * signal.rate / 2
        if not (density > 0).all():
            return None
        # single precision: its rounding lies 14 decades below the variance; a power of two keeps
        # squares within it
        size = 2.0 ** np.rint(np.log2(density.max()) / 2)
        transform = fft.rfft(_filled(signal, t, size), padded)[start:stop]
        ratio = transform.real**2 + transform.imag**2
        ratio /= np.interp(np.arange(start, stop), nodes, density / size**2)
        edges -= start
        # every other one: those between are not independent
        medians = np.array([np.median(ratio[i:j:2]) for i, j in pairwise(edges.tolist())])
        if not medians.all():
            return None
        centre = np.clip(np.arange(len(sizes)), 1, len(sizes) - 2)
        return cls(
            step=step,
            first=int(start),
            edges=edges,
            sizes=minimum_filter1d(sizes, 3, mode="nearest")[centre],
            background=maximum_filter1d(medians, 3, mode="nearest")[centre],
            ratio=ratio,
            independent=float(edges[-1] / padded * np.sqrt(4 * np.pi * t.var())),
            spectrum=spectrum,
            rate=signal.rate,
        )

    def block(self, frequency):
        """Return the number of the block of a frequency in Hz."""
        place = frequency / self.step - self.first
        return int(np.searchsorted(self.edges[1:-1], place, side="right"))

    def strongest(self, level):
        """Return the least chance, at one frequency, that a peak may have, and its place in Hz.

        A chance of 1 stands for any that is no line at the level.
        """
        heights, chances = (
            np.maximum.reduceat(self.ratio, self.edges[:-1]),
            np.ones(len(self.sizes)),
        )
        # between two frequencies of the padded transform a peak is up to 1/sinc^2(1/4) higher
        x = heights / 0.81 / self.background
        # a median is below 1, so that the chance is above exp(-x)
        for b in np.flatnonzero(x > np.log(self.independent / level)):
            chances[b] = chance_at_one(x[b], self.sizes[b])
        # a strong line leaks into other blocks, where it is weaker
        b = int(np.where(chances <= max(chances.min(), SURE), heights, 0).argmax())
        return chances[b], self._highest(*self.edges[b : b + 2])

    def near(self, frequency, reach):
        """Return the place of the highest peak within `reach` of a frequency, Hz."""
        ends = (np.array([frequency - reach, frequency + reach]) / self.step).astype(int)
        first, last = np.clip(ends - self.first, 0, len(self.ratio) - 1)
        return self._highest(first, last + 1)

    def _highest(self, first, last):
        return float((self.first + first + self.ratio[first:last].argmax()) * self.step)

    def variance(self, frequency):
        """Return the variance of white noise of the local density, SI^2."""
        density = self.spectrum(np.array([frequency]))[0]
        return density * self.rate / 2 * self.background[self.block(frequency)] / np.log(2)

    def chance(self, sinusoid):
        """Return the chance of a peak as high as a fitted sinusoid at one frequency."""
        x = sinusoid.explained / (2 * np.log(2) * self.variance(sinusoid.frequency))
        return chance_at_one(x, self.sizes[self.block(sinusoid.frequency)])


def chance_at_one(x, m):
    """Return E[exp(-x M)], M the largest of three medians of m exponentials of mean 1."""
    if x <= 0:
        return 1.0
    below = betainc((m + 1) / 2, (m + 1) / 2, -np.expm1(-EXPONENTS / x)) ** 3
    return np.trapezoid(np.exp(-EXPONENTS) * below, EXPONENTS)


def chance_over_band(chance, independent):
    """Return the chance of a peak anywhere from that at one frequency."""
    chance = max(chance, 1e-300)
    return float(-np.expm1(-chance * (1 + independent * np.sqrt(-np.log(min(chance, 1.0))))))


def _block_sizes(low, n, rate):
    """Return the independent values in each block of the background, from `low` on."""
    enough, sizes, k = max(ENOUGH, WIDTH_HZ * n / rate), [], low
    while k + (size := int(max(FEWEST, min(SHARE * k, enough), WIDTH * k))) < n / 2 - low:
        sizes.append(size)
        k += size
    return sizes


def _filled(signal, t, size):
    """Return the values at t over `size`, levels and slope removed, with zeros in the gaps."""
    t, x, (first, last) = signal.centred(t), signal.centred(signal.values), signal.extent
    x -= (t @ x) / (t @ t) * t
    filled = np.zeros(last + 1 - first, np.float32)
    for start, part in zip(signal.starts, signal.split(x), strict=True):
        filled[start - first : start - first + len(part)] = part / size
    return filled
