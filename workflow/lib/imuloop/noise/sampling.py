"""When the clean stretches of a power cycle were sampled, and their values."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.core.gaps import LONG_GAP_STEPS, gap_limit

# a power cycle of which a smaller share was recorded is not searched for lines: zeros in its gaps
# would be
# most of the work, and each line many of equal height
SPARSEST = 16


@dataclass(frozen=True, eq=False)
class Sampling:
    """Clean stretches of a power cycle on its grid of samples; gaps keep their place in time.

    Attributes
    ----------
    rate : float
        Hz.
    starts, lengths : ndarray of int, shape (s,)
        First sample of each stretch, counted from the start of the first, ascending, and its
        samples.
    levels : ndarray of int, shape (s,)
        Neighbours of one number share a level, across a gap; after a disturbance, which may have
        moved the device, a new one begins.
    """

    rate: float
    starts: np.ndarray
    lengths: np.ndarray
    levels: np.ndarray

    @classmethod
    def unbroken(cls, rate, samples):
        """Return the Sampling of one stretch."""
        return cls(rate, *np.array([[0], [samples], [0]]))

    @property
    def samples(self):
        """The number of each sample, shape (n,)."""
        before = np.cumsum(self.lengths) - self.lengths
        return np.arange(self.lengths.sum()) + np.repeat(self.starts - before, self.lengths)

    @property
    def extent(self):
        """First and last sample."""
        return int(self.starts[0]), int(self.starts[-1] + self.lengths[-1]) - 1

    @property
    def span(self):
        """Time from the first to the last sample, s."""
        first, last = self.extent
        return (last - first + 1) / self.rate

    @property
    def is_sparse(self):
        """Whether less than 1/`SPARSEST` of the power cycle was recorded."""
        return self.span * self.rate > SPARSEST * self.lengths.sum()

    @property
    def level(self):
        """The level of each stretch as 0, 1, ..., shape (s,)."""
        return np.cumsum(np.diff(self.levels, prepend=self.levels[0]) != 0)

    def with_values(self, values):
        """Return the Signal of values, shape (n,)."""
        return Signal(self.rate, self.starts, self.lengths, self.levels, values)

    def split(self, x):
        """Return the values of each stretch, as views, of those of all, shape (n,)."""
        return np.split(x, np.cumsum(self.lengths)[:-1])

    def centred(self, x):
        """Return values without the mean of each level, shape (n,)."""
        ends = np.cumsum(np.bincount(self.level, self.lengths).astype(int))
        return np.concatenate([part - part.mean() for part in np.split(x, ends[:-1])])

    def closed_up(self):
        """Return the same with gaps of a few samples closed up.

        White noise stays white and flicker flicker. What a walk or a ramp does within the gaps
        falls to the samples that are there, so that they seem larger by up to the share that is
        missing. A line does not stay one.
        """
        gaps = self.starts[1:] - (self.starts + self.lengths)[:-1]
        new = (gaps + 1 > gap_limit(1.0, LONG_GAP_STEPS)) | (np.diff(self.levels) != 0)
        first = np.flatnonzero(np.append(True, new))
        lengths = np.add.reduceat(self.lengths, first)
        return replace(self, starts=self.starts[first], lengths=lengths, levels=self.levels[first])


@dataclass(frozen=True, eq=False)
class Signal(Sampling):
    """A Sampling with the values of one channel: all stretches one after the other, (n,)."""

    values: np.ndarray

    def is_constant(self):
        """Return whether no stretch ever changes."""
        return not any(np.ptp(x) for x in self.split(self.values))

    def means(self, size):
        """Return the Signal of means over `size` samples, counted from the start of each stretch.

        None where no stretch is as long.
        """
        number = self.lengths // size
        kept, each = number > 0, zip(self.split(self.values), number, strict=True)
        if not kept.any():
            return None
        values = np.concatenate([x[: n * size].reshape(n, size).mean(axis=1) for x, n in each])
        starts = self.starts[kept] // size
        return Signal(self.rate / size, starts, number[kept], self.levels[kept], values)
