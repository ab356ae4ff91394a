"""Periodogram of the clean stretches of a signal, over its local background."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import log

import numpy as np
from scipy import fft
from scipy.special import betainc

# periods in a signal below which a line is not told from a drift; as far from Nyquist
SHORTEST = 3
# independent values in a block of the background: at least, and a quarter of those below it up to
# what a median needs and to 0.3 Hz; 1 % of its frequency where that is more. Mains' wander, folded
# or not, is narrower than half a block and a line; what is wider is none
FEWEST, SHARE, ENOUGH, WIDTH_HZ, WIDTH = 24, 0.25, 256, 0.3, 0.01
# places in a block where the spectrum is calculated: 1e-4 of a walk's, where it is steepest
NODES = 33
# where the chance of a peak is integrated
EXPONENTS = np.geomspace(1e-4, 1e3, 700)
# chance at one frequency below which peaks are ranked by their height
SURE = 1e-9


@dataclass(frozen=True)
class Periodogram:
    r"""Periodogram of one Signal relative to its spectrum, and the medians of its blocks.

    The periodogram :math:`I(f) = 2 |\sum x_j e^{-2 \pi i f t_j}|^2/(n r)`, level means and one
    slope removed, gaps filled with zeros, padded to twice the record, is divided by the spectrum
    and by the local background: the largest of the medians of I/S in the block of frequencies
    around and in the two beside it. So a misfit of the smooth model, its slope, and a band of
    neighbouring lines wider than half a block (0.15 Hz, 0.5 % of f or 128 independent frequencies)
    raise the background and are no lines. With a spectrum that is right up to a local factor, I/S
    is exponential, and

    .. math:: p_1 = E[e^{-x M}],\quad p = 1 - \exp(-p_1 - W \sqrt u e^{-u}),\quad u = -\ln p_1

    where x is the ratio at its maximum, M the largest of the medians of m exponentials and
    :math:`W = B \sqrt{4 \pi\,\mathrm{var}(t)}` counts the independent frequencies of the band B
    (Baluev's bound on the maximum over a continuous frequency).

    Attributes
    ----------
    rate, step : float
        Of the samples, and between frequencies of the padded transform, Hz.
    edges : ndarray of int, shape (b + 1,)
        Of the blocks of the background, in steps.
    sizes, medians : ndarray, shape (b,)
        Independent values in each block, and the median of its ratios.
    ratio : ndarray
        I/S from the first edge to the last.
    independent : float
        W.
    spectrum : callable
        S, one-sided, as a function of frequency in Hz.

    References
    ----------
    R. V. Baluev, MNRAS 385 (2008) 1279. Median, largest of neighbours: H. Rohling, IEEE Trans.
    Aerosp. Electron. Syst. 19 (1983) 608.
    """

    rate: float
    step: float
    edges: np.ndarray
    sizes: np.ndarray
    medians: np.ndarray
    ratio: np.ndarray
    independent: float
    spectrum: Callable

    @classmethod
    def of(cls, signal, spectrum):
        """Return the periodogram of one Signal; None if it is too short, sparse or has no noise."""
        n, (first, last) = int(signal.lengths.sum()), signal.extent
        # frequencies in units of rate/n, the distance of independent ones
        low = SHORTEST * n / (last + 1 - first)
        sizes = _block_sizes(low, n, signal.rate)
        # of what never changes rounding alone is left
        if not sizes or signal.is_sparse or signal.is_constant():
            return None
        padded = 16 * fft.next_fast_len(-(-(last + 1 - first) // 8))
        edges = np.ceil((low + np.cumsum([0, *sizes])) * padded / n).astype(int)
        edges[-1] = int((n / 2 - low) * padded / n)
        step, blocks = signal.rate / padded, [*pairwise(edges.tolist())]
        nodes = [np.linspace(i, j - 1, min(NODES, j - i)) for i, j in blocks]
        density = [spectrum(step * each) * n * signal.rate / 2 for each in nodes]
        if not all((each > 0).all() for each in density):
            return None
        # single precision: its rounding lies 14 decades below the variance; a power of two keeps
        # squares within it
        size = 2.0 ** np.rint(np.log2(max(each.max() for each in density)) / 2)
        transform = fft.rfft(_filled(signal, size), padded)
        power = transform.real**2 + transform.imag**2
        medians = np.empty(len(sizes))
        for b, (i, j) in enumerate(blocks):
            power[i:j] /= np.interp(np.arange(i, j), nodes[b], density[b] / size**2)
            # every other one: those between are not independent
            medians[b] = np.median(power[i:j:2])
        if not medians.all():
            return None
        middle = signal.starts + (signal.lengths - 1) / 2
        spread = (middle - np.average(middle, weights=signal.lengths)) ** 2 + (
            signal.lengths**2 - 1
        ) / 12
        turns = np.sqrt(4 * np.pi * np.average(spread, weights=signal.lengths))
        return cls(
            rate=signal.rate,
            step=step,
            edges=edges,
            sizes=np.array(sizes),
            medians=medians,
            ratio=power[edges[0] : edges[-1]],
            independent=float((edges[-1] - edges[0]) / padded * turns),
            spectrum=spectrum,
        )

    def near(self, frequency):
        """Return the block of a frequency in Hz and those beside it."""
        block = np.searchsorted(self.edges, frequency / self.step, side="right") - 1
        return self._beside(int(np.clip(block, 0, len(self.sizes) - 1)))

    def strongest(self, level):
        """Return the least chance, at one frequency, that a peak may have, and its place in Hz.

        A chance of 1 stands for any that is no line at the level.
        """
        edges = self.edges - self.edges[0]
        peaks, chances = np.maximum.reduceat(self.ratio, edges[:-1]), np.ones(len(self.sizes))
        # a median is below 1, so that the chance is above exp(-x)
        lowest = -np.log(level / self.independent)
        # between two frequencies of the padded transform a peak is up to 1/sinc^2(1/4) higher
        for b in np.flatnonzero(peaks / 0.81 > lowest * self.medians):
            chances[b] = self._chance(peaks[b] / 0.81, self._beside(b))
        # a strong line leaks into other blocks, where it is weaker
        b = int(np.where(chances <= max(chances.min(), SURE), peaks, 0).argmax())
        top = edges[b] + int(self.ratio[edges[b] : edges[b + 1]].argmax())
        place = float(top + self.edges[0])
        if 0 < top < self.ratio.size - 1:
            left, centre, right = np.log(self.ratio[top - 1 : top + 2].astype(float))
            place += np.clip((right - left) / (4 * centre - 2 * (left + right)), -0.5, 0.5)
        return chances[b], place * self.step

    def chance(self, sinusoid):
        """Return the chance of a peak as high as a fitted sinusoid at one frequency."""
        density = self.spectrum(np.array([sinusoid.frequency]))[0]
        ratio = sinusoid.explained / (self.rate * density)
        return self._chance(ratio, self.near(sinusoid.frequency))

    def _beside(self, block):
        return slice(max(block - 1, 0), block + 2)

    def _chance(self, ratio, near):
        sizes = self.sizes[near]
        return chance_at_one(ratio / self.medians[near].max(), sizes.min(), sizes.size)

    def density(self, frequency):
        """Return the local density and its degrees of freedom; a median has 48 % of a mean's."""
        near = self.near(frequency)
        sizes = self.sizes[near]
        scale = np.average(self.medians[near], weights=sizes) / log(2)
        return self.spectrum(np.array([frequency]))[0] * scale, 2 * log(2) ** 2 * sizes.sum()


def chance_at_one(x, m, sides):
    """Return E[exp(-x M)], M the largest of `sides` medians of m exponentials of mean 1."""
    if x <= 0:
        return 1.0
    below = betainc((m + 1) / 2, (m + 1) / 2, -np.expm1(-EXPONENTS / x)) ** sides
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


def _filled(signal, size):
    """Return the values over `size`, levels and slope removed, with zeros in the gaps."""
    samples = zip(signal.starts, signal.lengths, strict=True)
    t = signal.centred(np.concatenate([start + np.arange(float(n)) for start, n in samples]))
    x, (first, last) = signal.centred(signal.values), signal.extent
    x -= (t @ x) / (t @ t) * t
    filled = np.zeros(last + 1 - first, np.float32)
    for start, part in zip(signal.starts, signal.split(x), strict=True):
        filled[start - first : start - first + len(part)] = part / size
    return filled
