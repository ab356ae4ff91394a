"""Periodogram of the clean stretches of a session, over its local background."""

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from math import log

import numpy as np
from scipy import fft, special

from imuloop.noise.layout import CHUNK
from imuloop.noise.waves import extent

# periods in a session below which a line is not told from a drift; as far from Nyquist
SHORTEST = 3
# independent values in a block of the background: at least, and a quarter of those below it up to
# what a median needs and to 0.3 Hz; 1 % of its frequency where that is more. Mains' wander, folded
# or not, is narrower than half a block and a line; what is wider is none
FEWEST, SHARE, ENOUGH, WIDTH_HZ, WIDTH = 24, 0.25, 256, 0.3, 0.01
# places in a block where the spectrum is calculated: 1e-4 of a walk's, where it is steepest
NODES = 33
# frequencies are transformed by their remainder after this, see `_squares`
REMAINDERS = 16
# a session of which a smaller share was recorded is not searched: zeros in its gaps would be most
# of the work, and each line many of equal height
SPARSEST = 16
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

    @cached_property
    def nodes(self):
        """Places in each block between which a spectrum is straight."""
        return [np.linspace(i, j - 1, min(NODES, j - i)) for i, j in pairwise(self.edges)]

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
        ratios = [x / 0.81 / self.medians[n].max() for x, n in zip(peaks, near, strict=True)]
        sizes = [(int(self.band.sizes[n].min()), n.stop - n.start) for n in near]
        # no chance is below exp(-x E M), so that most need not be calculated
        least = np.exp([-x * mean_highest(*of) for x, of in zip(ratios, sizes, strict=True)])
        chances = np.ones(peaks.size)
        for b in np.argsort(least, kind="stable"):
            if least[b] > max(chances.min(), SURE):
                break
            chances[b] = one_frequency(ratios[b], *sizes[b])
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

    def density_of_parts(self, frequency):
        """Return the density in parts of the session, of which no frequency is empty.

        Where a log repeats itself, most frequencies of the whole are.
        """
        return max(self.density(frequency)[0], self.spectrum(np.array([frequency]))[0])


def is_sparse(layout):
    """Return whether less than 1/`SPARSEST` of a session was recorded."""
    first, last = extent(layout)
    return last + 1 - first > SPARSEST * sum(layout.lengths)


@cache
def band_of(layout):
    """Return what is searched in a session, None where it is too short or too sparse."""
    if is_sparse(layout):
        return None
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
    padded = REMAINDERS * fft.next_fast_len(-(-2 * samples // REMAINDERS))
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
    # of what never changes rounding alone is left
    if band is None or not any(np.ptp(x) for x in stretches):
        return None
    nodes = band.nodes
    density = spectrum(band.step * np.concatenate(nodes)) * (band.samples * band.rate / 2)
    if not (density > 0).all():
        return None
    # a power of two that keeps squares within single precision
    size = 2.0 ** np.rint(np.log2(density.max()) / 2)
    density = np.split(density / size**2, np.cumsum([len(each) for each in nodes])[:-1])
    # single precision: its rounding lies 14 decades below the variance
    power = _squares(_filled(layout, stretches, band.padded // 2, size))
    medians = np.empty(band.sizes.size)
    for b, (i, j) in enumerate(pairwise(band.edges)):
        power[i:j] /= np.interp(np.arange(i, j), nodes[b], density[b])
        # every other one: those between are not independent
        medians[b] = _median(power[i:j:2])
    ratio = power[band.edges[0] : band.edges[-1]]
    return Search(band, spectrum, ratio, medians) if medians.all() else None


def _median(x):
    """Return the median; of a block numpy's own takes several times as long."""
    half = len(x) // 2
    if len(x) % 2:
        return np.partition(x, half)[half]
    return np.partition(x, (half - 1, half))[half - 1 : half + 1].sum() / 2


def _squares(x):
    r"""Return the squares of the Fourier transform of x and as many zeros behind.

    One remainder r of the frequency k = P l + r after the other, so that little more than x and the
    result is in memory. With M = 2 n/P

    .. math:: X_{Pl+r} = \sum_{j<M} e^{-2\pi i jl/M} e^{-\pi i jr/n}
        \sum_{p<P/2} x_{j+pM} e^{-2\pi i pr/P}

    and those above n are the conjugates of the remainder P - r.

    Parameters
    ----------
    x : ndarray of float32, shape (n,)
        n is a multiple of half of P, `REMAINDERS`.

    Returns
    -------
    ndarray of float32, shape (n + 1,)
    """
    n, folded = len(x), x.reshape(REMAINDERS // 2, -1)
    size = folded.shape[1]
    squares = np.empty(n + 1, np.float32)
    for r in range(REMAINDERS // 2 + 1):
        phase = np.exp(-2j * np.pi * r / REMAINDERS * np.arange(len(folded))).astype(np.complex64)
        y = np.empty(size, np.complex64)
        y.real, y.imag = phase.real.copy() @ folded, phase.imag.copy() @ folded
        turn = np.exp(-1j * np.pi * r / n * np.arange(min(CHUNK, size)))
        for i in range(0, size, CHUNK):
            y[i : i + CHUNK] *= turn[: size - i] * np.exp(-1j * np.pi * i * r / n)
        y = fft.fft(y, overwrite_x=True)
        power = y.real**2
        power += y.imag**2
        for place, each in ((r, power), (REMAINDERS - r, power[::-1])):
            count = len(squares[place::REMAINDERS])
            squares[place::REMAINDERS] = each[:count]
    return squares


def _filled(layout, stretches, padded, size):
    """Return a session over `size`, levels and slope removed, zeros in the gaps and behind."""
    level, counts = layout.of_level
    starts, lengths = np.array(layout.starts), np.array(layout.lengths)
    middles = starts + (lengths - 1) / 2
    x_mean = np.bincount(level, [np.sum(x) for x in stretches]) / counts
    t_mean = np.bincount(level, lengths * middles) / counts
    upper = 0.0
    for i, part in layout.parts:
        t = np.arange(part.start, part.stop) + (starts[i] - t_mean[level[i]])
        upper += t @ (stretches[i][part] - x_mean[level[i]])
    slope = upper / (lengths @ ((lengths**2 - 1) / 12 + (middles - t_mean[level]) ** 2))
    filled = np.zeros(padded, np.float32)
    for i, part in layout.parts:
        t = np.arange(part.start, part.stop) + (starts[i] - t_mean[level[i]])
        at = starts[i] - starts.min() + part.start
        filled[at : at + t.size] = (stretches[i][part] - x_mean[level[i]] - slope * t) / size
    return filled


def one_frequency(x, m, sides):
    """Return E[exp(-x M)], M the largest of `sides` medians of m exponentials of mean 1."""
    if x <= 0:
        return 1.0
    s = np.geomspace(1e-4, 1e3, 700)
    below = special.betainc((m + 1) / 2, (m + 1) / 2, -np.expm1(-s / x)) ** sides
    return np.trapezoid(np.exp(-s) * below, s)


@cache
def mean_highest(m, sides):
    """Return the mean of the largest of `sides` medians of m exponentials of mean 1, or more."""
    s = np.linspace(0, 6, 400)
    below = special.betainc((m + 1) / 2, (m + 1) / 2, -np.expm1(-s)) ** sides
    return 1.0001 * np.trapezoid(1 - below, s)


def over_band(chance, independent):
    """Return the chance of a peak anywhere from that at one frequency."""
    chance = max(chance, 1e-300)
    return float(-np.expm1(-chance * (1 + independent * np.sqrt(-np.log(min(chance, 1.0))))))
