"""A signal: the values of a channel in the clean stretches of one power cycle."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft

from imuloop.core.gaps import LONG_GAP_STEPS, gap_limit

# a power cycle of which a smaller share was recorded is not searched for lines: most of the work
# would be on the zeros in the gaps, and each line would appear as many of the same height
SPARSEST = 16


@dataclass(frozen=True, eq=False)
class Signal:
    """A signal: the clean stretches of one power cycle, on the grid of its sampling times.

    A clean stretch is a range of samples at rest, without a gap or a disturbance. Gaps keep their
    place in time. A level is the time between two disturbances. A disturbance may have moved the
    device, so each level has its own mean of the output.

    Attributes
    ----------
    rate : float
        Sampling rate, Hz.
    starts, lengths : ndarray of int, shape (s,)
        Grid point of the first sample of each stretch, ascending from 0, and the number of samples
        of the stretch.
    levels : ndarray of int, shape (s,)
        Number of the level of each stretch, ascending from 0 without a break. Stretches with only a
        gap between them share a level.
    values : ndarray, shape (n,), optional
        Values of one channel, all n samples of the stretches, one after the other; None if only the
        times matter.
    """

    rate: float
    starts: np.ndarray
    lengths: np.ndarray
    levels: np.ndarray
    values: np.ndarray | None = None

    @cached_property
    def samples(self):
        """Grid point of each of the n samples, (n,) of int, from 0; lost samples have one, too."""
        before = np.cumsum(self.lengths) - self.lengths
        return np.arange(self.lengths.sum()) + np.repeat(self.starts - before, self.lengths)

    @property
    def extent(self):
        """Number of grid points from the first to the last clean sample, gaps included."""
        return int(self.starts[-1] + self.lengths[-1])

    @property
    def span(self):
        """Time from the first to the last clean sample, s."""
        return self.extent / self.rate

    @property
    def is_sparse(self):
        """Whether less than 1/`SPARSEST` of the cycle was recorded; then no lines are sought."""
        return self.extent > SPARSEST * self.lengths.sum()

    def split(self, x):
        """Return an array cut into the stretches, a list of views.

        The array `x`, (n,), has a value for each of the n samples.
        """
        return np.split(x, np.cumsum(self.lengths)[:-1])

    def centred(self, x):
        """Return an array minus its mean over each level, (n,).

        The array `x`, (n,), has a value for each of the n samples. A level has the samples between
        two disturbances.
        """
        ends = np.cumsum(np.bincount(self.levels, self.lengths).astype(int))
        return np.concatenate([part - part.mean() for part in np.split(x, ends[:-1])])

    def closed_up(self):
        """Return a Signal without values, in which gaps of a few samples are closed up.

        The missing samples are left out of the grid, and the stretches before and after the gap
        become one. A longer gap, or a new level, still ends a stretch. White noise stays white and
        flicker stays flicker. A sinusoid does not stay a sinusoid. A random walk or a ramp goes on
        within the gaps, so after they are closed it looks larger, by up to the share of missing
        samples.
        """
        gaps = self.starts[1:] - (self.starts + self.lengths)[:-1]
        new = (gaps + 1 > gap_limit(1.0, LONG_GAP_STEPS)) | (np.diff(self.levels) != 0)
        first = np.flatnonzero(np.append(True, new))
        lengths = np.add.reduceat(self.lengths, first)
        return Signal(self.rate, self.starts[first], lengths, self.levels[first])

    def is_constant(self):
        """Return whether the values are constant within every stretch."""
        return not any(np.ptp(x) for x in self.split(self.values))

    @cached_property
    def power(self):
        """Squared magnitudes of the Fourier transform, (f,), and the factor for them, SI^2.

        The product of both is in SI^2. Without the factor the squares are of a size that single
        precision can hold. The f frequencies go from 0 to half the sampling rate. Before the
        transform, the mean of each level and one slope are subtracted, gaps are filled with zeros,
        and the record is padded to twice its length or a little more.
        """
        t, x = self.centred(self.samples.astype(float)), self.centred(self.values)
        x -= (t @ x) / (t @ t) * t
        # values of size one keep the squares within single precision, whose rounding lies 14
        # decades below the variance; dividing by a power of two does not round
        size = 2.0 ** np.rint(np.log2(x.std() or 1.0))
        filled = np.zeros(16 * fft.next_fast_len(-(-self.extent // 8)), np.float32)
        for start, part in zip(self.starts, self.split(x), strict=True):
            filled[start : start + len(part)] = part / size
        transform = fft.rfft(filled)
        return transform.real**2 + transform.imag**2, size**2
