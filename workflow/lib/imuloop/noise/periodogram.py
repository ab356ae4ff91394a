"""Periodogram of the clean stretches of a session, over its local background."""

from dataclasses import dataclass
from itertools import pairwise
from math import log

import numpy as np
from scipy import fft, special

from imuloop.noise.waves import levels, parts

# periods in a session below which a line is not told from a drift; as far from Nyquist
SHORTEST = 3
# independent values in a block of the background: at least, and a quarter of those below it up to
# what a median needs and to 0.3 Hz; 1 % of its frequency where that is more. Mains' wander, folded
# or not, is narrower than half a block and a line; what is wider is none
FEWEST, SHARE, ENOUGH, WIDTH_HZ, WIDTH = 24, 0.25, 256, 0.3, 0.01
# places in a block where the spectrum is calculated: 1e-4 of a walk's, where it is steepest
NODES = 33
# chance at one frequency below which peaks are ranked by their height
SURE = 1e-9


@dataclass(frozen=True)
class Band:
    """What is searched in one session.

    `edges` of the blocks in steps of the padded transform, `sizes` the independent values in each;
    `independent` is W of `find_line`.
    """

    rate: float
    samples: int
    span: float
    padded: int
    edges: np.ndarray
    sizes: np.ndarray
    independent: float

    @property
    def step(self):
        """Distance of the frequencies of the padded transform, Hz."""
        return self.rate / self.padded

    def near(self, frequency):
        """Return the block of a frequency in Hz and those beside it."""
        at = np.searchsorted(self.edges, frequency / self.step, side="right") - 1
        block = int(np.clip(at, 0, self.sizes.size - 1))
        return slice(max(block - 1, 0), min(block + 2, self.sizes.size))


@dataclass(frozen=True)
class Search:
    """Periodogram over spectrum of one session, and the medians of its blocks."""

    band: Band
    spectrum: object
    ratio: np.ndarray
    medians: np.ndarray

    def strongest(self):
        """Return the least chance, at one frequency, that a peak may have, and its place in Hz."""
        edges = self.band.edges - self.band.edges[0]
        peaks = np.maximum.reduceat(self.ratio, edges[:-1])
        near = [slice(max(b - 1, 0), min(b + 2, peaks.size)) for b in range(peaks.size)]
        # between two frequencies of the padded transform a peak is up to 1/sinc^2(1/4) higher
        chances = np.array([self._chance(x / 0.81, n) for x, n in zip(peaks, near, strict=True)])
        # a strong line leaks into other blocks, where it is weaker
        b = int(np.where(chances <= max(chances.min(), SURE), peaks, 0).argmax())
        top = edges[b] + int(self.ratio[edges[b] : edges[b + 1]].argmax())
        place = float(top + self.band.edges[0])
        if 0 < top < self.ratio.size - 1:
            left, centre, right = np.log(self.ratio[top - 1 : top + 2].astype(float))
            place += np.clip((right - left) / (4 * centre - 2 * (left + right)), -0.5, 0.5)
        return chances[b], place * self.band.step

    def chance(self, wave):
        """Return the chance of a peak as high as a fitted wave at one frequency."""
        density = self.spectrum(np.array([wave.frequency]))[0]
        return self._chance(
            wave.explained / (self.band.rate * density), self.band.near(wave.frequency)
        )

    def _chance(self, ratio, near):
        background, sizes = self.medians[near].max(), self.band.sizes[near]
        return one_frequency(ratio / background, sizes.min(), sizes.size)

    def density(self, frequency):
        """Return the local density and its degrees of freedom; a median has 48 % of a mean's."""
        near = self.band.near(frequency)
        sizes = self.band.sizes[near]
        scale = np.average(self.medians[near], weights=sizes) / log(2)
        return self.spectrum(np.array([frequency]))[0] * scale, 2 * log(2) ** 2 * sizes.sum()


def band_of(layout):
    """Return what is searched in a session, None where it is too short."""
    starts, lengths = np.array(layout.starts), np.array(layout.lengths)
    n, samples = int(lengths.sum()), int((starts + lengths).max() - starts.min())
    # frequencies in units of rate/n, the distance of independent ones
    low = SHORTEST * n / samples
    enough = max(ENOUGH, WIDTH_HZ * n / layout.rate)
    sizes, k = [], low
    while k + (size := int(max(FEWEST, min(SHARE * k, enough), WIDTH * k))) < n / 2 - low:
        sizes.append(size)
        k += size
    if not sizes:
        return None
    padded = fft.next_fast_len(2 * samples, real=True)
    edges = np.ceil((low + np.cumsum([0, *sizes])) * padded / n).astype(int)
    edges[-1] = int((n / 2 - low) * padded / n)
    middle = starts + (lengths - 1) / 2
    spread = (middle - np.average(middle, weights=lengths)) ** 2 + (lengths**2 - 1) / 12
    turns = np.sqrt(4 * np.pi * np.average(spread, weights=lengths))
    return Band(
        rate=layout.rate,
        samples=n,
        span=samples / layout.rate,
        padded=padded,
        edges=edges,
        sizes=np.array(sizes),
        independent=float((edges[-1] - edges[0]) / padded * turns),
    )


def periodogram(layout, stretches, spectrum):
    """Return the Search of one session, None where it is too short or has no noise."""
    band = band_of(layout)
    if band is None:
        return None
    # single precision: its rounding lies 14 decades below the variance
    transform = fft.rfft(_filled(layout, stretches, band.padded))
    ratio = np.empty(band.edges[-1] - band.edges[0], np.float32)
    medians = np.empty(band.sizes.size)
    for b, (i, j) in enumerate(pairwise(band.edges)):
        # a spectrum is straight between so many places in a block
        nodes = np.linspace(i, j - 1, min(NODES, j - i))
        density = spectrum(band.step * nodes)
        if not (density > 0).all():
            return None
        power = transform.real[i:j] ** 2 + transform.imag[i:j] ** 2
        power *= 2 / (band.samples * band.rate)
        power /= np.interp(np.arange(i, j), nodes, density)
        # every other one: those between are not independent
        medians[b] = np.median(power[::2])
        ratio[i - band.edges[0] : j - band.edges[0]] = power
    return Search(band, spectrum, ratio, medians) if medians.all() else None


def _filled(layout, stretches, padded):
    """Return a session without its levels and its slope, zeros in the gaps and behind."""
    level, counts = levels(layout)
    starts, lengths = np.array(layout.starts), np.array(layout.lengths)
    middles = starts + (lengths - 1) / 2
    x_mean = np.bincount(level, [np.sum(x) for x in stretches]) / counts
    t_mean = np.bincount(level, lengths * middles) / counts
    upper = 0.0
    for i, part in parts(layout):
        t = np.arange(part.start, part.stop) + (starts[i] - t_mean[level[i]])
        upper += t @ (stretches[i][part] - x_mean[level[i]])
    slope = upper / (lengths @ ((lengths**2 - 1) / 12 + (middles - t_mean[level]) ** 2))
    filled = np.zeros(padded, np.float32)
    for i, part in parts(layout):
        t = np.arange(part.start, part.stop) + (starts[i] - t_mean[level[i]])
        at = starts[i] - starts.min() + part.start
        filled[at : at + t.size] = stretches[i][part] - x_mean[level[i]] - slope * t
    return filled


def one_frequency(x, m, sides):
    """Return E[exp(-x M)], M the largest of `sides` medians of m exponentials of mean 1."""
    if x <= 0:
        return 1.0
    s = np.geomspace(1e-4, 1e3, 700)
    below = special.betainc((m + 1) / 2, (m + 1) / 2, -np.expm1(-s / x)) ** sides
    return np.trapezoid(np.exp(-s) * below, s)


def over_band(chance, independent):
    """Return the chance of a peak anywhere from that at one frequency."""
    chance = max(chance, 1e-300)
    return float(-np.expm1(-chance * (1 + independent * np.sqrt(-np.log(min(chance, 1.0))))))
