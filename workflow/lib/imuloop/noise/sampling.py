"""When the clean stretches of a run were sampled, and their values."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from imuloop.core.samples import LONG_GAP_STEPS


@dataclass(frozen=True)
class Sampling:
    """Clean stretches of a run on its grid of samples; gaps keep their place in time.

    Attributes
    ----------
    rate : float
        Hz.
    starts, lengths : tuple of int
        First sample of each stretch, counted from the start of the run, ascending, and its samples.
    levels : tuple of int
        Neighbours of one number share a level, across a gap; after a disturbance, which may have
        moved the device, a new one begins.
    """

    rate: float
    starts: tuple[int, ...]
    lengths: tuple[int, ...]
    levels: tuple[int, ...]

    @property
    def extent(self):
        """First and last sample."""
        return self.starts[0], self.starts[-1] + self.lengths[-1] - 1

    @property
    def span(self):
        """Time from the first to the last sample, s."""
        first, last = self.extent
        return (last - first + 1) / self.rate

    @cached_property
    def level(self):
        """The level of each stretch as 0, 1, ..., shape (s,)."""
        return np.cumsum(np.diff(self.levels, prepend=self.levels[:1]) != 0)

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
        starts, levels = np.array(self.starts), np.array(self.levels)
        gaps = starts[1:] - (starts + self.lengths)[:-1]
        new = (gaps + 1 > LONG_GAP_STEPS) | (np.diff(levels) != 0)
        first = np.flatnonzero(np.append(True, new))
        return self._with(starts[first], np.add.reduceat(self.lengths, first), levels[first])

    def with_values(self, values):
        """Return the Run of values, shape (n,)."""
        return Run(self.rate, self.starts, self.lengths, self.levels, values)

    def _with(self, starts, lengths, levels, **others):
        columns = {"starts": starts, "lengths": lengths, "levels": levels}
        return replace(self, **{k: tuple(v.tolist()) for k, v in columns.items()}, **others)


@dataclass(frozen=True, eq=False)
class Run(Sampling):
    """The same with the values of all stretches, one after the other, shape (n,)."""

    values: np.ndarray

    def is_constant(self):
        """Return whether no stretch ever changes."""
        return not any(np.ptp(x) for x in self.split(self.values))

    def means(self, size):
        """Return the run of the means over `size` samples, counted from the start of each stretch.

        None where no stretch is as long.
        """
        lengths = np.array(self.lengths) // size
        kept, each = lengths > 0, zip(self.split(self.values), lengths, strict=True)
        if not kept.any():
            return None
        values = np.concatenate([x[: n * size].reshape(n, size).mean(axis=1) for x, n in each])
        starts, levels = np.array(self.starts)[kept] // size, np.array(self.levels)[kept]
        return self._with(starts, lengths[kept], levels, values=values, rate=self.rate / size)

    def cut(self, begin, end):
        """Return the run from sample `begin` to before `end`, its values a view."""
        starts, ends = np.array(self.starts), np.add(self.starts, self.lengths)
        offset = np.clip(begin - starts, 0, self.lengths).sum()
        first, last = np.clip([starts, ends], begin, end)
        kept, lengths = last > first, last - first
        values = self.values[offset : offset + lengths.sum()]
        return self._with(first[kept], lengths[kept], np.array(self.levels)[kept], values=values)
