"""When the clean stretches of a session were sampled."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from imuloop.core.samples import LONG_GAP_STEPS


@dataclass(frozen=True)
class Sampling:
    """Clean stretches of one session on its grid of samples; gaps keep their place in time."""

    # Hz
    rate: float
    # first sample of each stretch, counted from the session's start, and its samples
    starts: tuple[int, ...]
    lengths: tuple[int, ...]
    # stretches of equal number share a level (across a gap); a disturbance may have moved the
    # device, so that a new number, hence a level of its own, begins after it
    levels: tuple[int, ...]

    @property
    def extent(self):
        """First and last sample."""
        return min(self.starts), int(np.add(self.starts, self.lengths).max()) - 1

    @cached_property
    def level(self):
        """The level of each stretch as 0, 1, ..., shape (s,)."""
        return np.unique(self.levels, return_inverse=True)[1]

    def level_means(self, values):
        """Return the mean of each level, of the values of each stretch."""
        sums = [np.sum(x) for x in values]
        return np.bincount(self.level, sums) / np.bincount(self.level, self.lengths)

    def joined(self, values):
        """Return the values of all stretches less their levels' means, and each one's number."""
        x = np.concatenate(
            [x - mean for x, mean in zip(values, self.level_means(values)[self.level], strict=True)]
        )
        stretch = zip(self.starts, self.lengths, strict=True)
        return x, np.concatenate([np.arange(start, start + n) for start, n in stretch])

    def cut(self, values, begin, end):
        """Return the sampling and the values, as views, from sample `begin` to before `end`."""
        kept = [
            (max(a, begin), x[max(begin - a, 0) : max(end - a, 0)], level)
            for a, x, level in zip(self.starts, values, self.levels, strict=True)
            if a < end and a + len(x) > begin
        ]
        starts, parts, levels = zip(*kept, strict=True) if kept else ((), (), ())
        return Sampling(self.rate, starts, tuple(len(x) for x in parts), levels), parts

    @cached_property
    def _first(self):
        """First of the stretches that gaps of a few samples part."""
        starts, levels = np.array(self.starts), np.array(self.levels)
        ends = starts + self.lengths
        new = (starts[1:] - ends[:-1] + 1 > LONG_GAP_STEPS) | (levels[1:] != levels[:-1])
        return np.flatnonzero(np.append(True, new))

    def closed_up(self):
        """Return the sampling with gaps of a few samples closed up.

        White noise stays white and flicker flicker. What a walk or a ramp does within the gaps
        falls to the samples that are there, so that they seem larger by up to the share that is
        missing. A line does not stay one.
        """
        return replace(
            self,
            starts=tuple(np.array(self.starts)[self._first].tolist()),
            lengths=tuple(np.add.reduceat(self.lengths, self._first).tolist()),
            levels=tuple(np.array(self.levels)[self._first].tolist()),
        )

    def close_up(self, values):
        """Return the values of stretches, one array each, as `closed_up` has them."""
        if len(self._first) == len(self.starts):
            return values
        edges = [*self._first.tolist(), len(values)]
        return [np.concatenate(values[i:j]) for i, j in pairwise(edges)]
