"""Runs of one value on an axis: stuck, or held over several rows."""

import numpy as np

# a value repeated fewer times is never called stuck
LEAST_STUCK = 10
# a stuck run is so many times longer than the longest of the others; where these vary more than
# chance lets them (noise below the quantisation step), so many times
STUCK_FACTOR, STUCK_FACTOR_COARSE = 5, 50
# runs of the others needed to know what is usual
LEAST_RUNS = 50
# at most so many long runs of an axis are kept, the longest
KEPT_RUNS = 1000
# run lengths are counted one by one up to here
LENGTHS = 256
# steps that the noise of 64 rows spans: to tell runs, and to tell a cut tail
SPAN, WIDE_SPAN = 1.5, 3.5
# values are held where rows a new value are at least this many, and this share of runs near it
LEAST_HELD, HELD_SHARE = 1.25, 0.98


class Runs:
    """Runs of one value on an axis, over row groups: their lengths, and the longest."""

    def __init__(self, step):
        self.step = step
        self.counts = np.zeros(LENGTHS + 1, dtype=int)
        self.long = []
        self.open, self.last, self.rows = 0, np.nan, 0
        self.varied = self.lively = self.wide = 0

    def add(self, x, row):
        """Take in a row group that starts at `row`."""
        starts = np.flatnonzero(np.concatenate(([x[0] != self.last], x[1:] != x[:-1])))
        if len(starts):
            ends = starts + row
            lengths = np.diff(ends, prepend=self.open)
            values = np.where(starts > 0, x[starts - 1], self.last)
            self._keep(lengths, ends - lengths, values)
            self.open = int(ends[-1])
        self.last, self.rows = x[-1], row + len(x)
        # whether noise spans the quantisation step: else long runs are its nature
        blocks = x[: len(x) // 64 * 64].reshape(-1, 64)
        width = blocks.max(axis=1) - blocks.min(axis=1)
        self.varied += int((width > 0).sum())
        self.lively += int((width > SPAN * (self.step or 0.0)).sum())
        self.wide += int((width > WIDE_SPAN * (self.step or 0.0)).sum())

    def _keep(self, lengths, starts, values):
        self.counts += np.bincount(np.minimum(lengths, LENGTHS), minlength=LENGTHS + 1)
        chosen = np.flatnonzero(lengths >= LEAST_STUCK)
        self.long += [(int(lengths[i]), int(starts[i]), float(values[i])) for i in chosen]
        if len(self.long) > KEPT_RUNS:
            self.long = sorted(self.long, reverse=True)[:KEPT_RUNS]

    @property
    def fine(self):
        """Whether the noise spans the quantisation step."""
        return self.lively >= 0.5 * self.varied > 0

    def stuck(self):
        """Return (rows, first row, value) of each run too long for chance."""
        if self.rows > self.open:
            length = self.rows - self.open
            self._keep(np.array([length]), np.array([self.open]), np.array([self.last]))
            self.open = self.rows
        long = sorted((run for run in self.long if np.isfinite(run[2])), reverse=True)
        # the zero-th count is the empty run before the first row
        counts = self.counts[1:].copy()
        short = np.flatnonzero(counts[: LEAST_STUCK - 1])
        lengths = [run[0] for run in long] + [int(short[-1]) + 1 if len(short) else 1]
        usual = np.arange(1, LENGTHS + 1)
        for k in range(len(long) - 1, -1, -1):
            rest = np.where(usual <= lengths[k + 1], counts, 0)
            n = rest.sum()
            if n < LEAST_RUNS or not self.fine:
                continue
            even = lengths[k + 1] <= 1 + 3 * (rest @ usual) / n * np.log(n)
            if lengths[k] >= (STUCK_FACTOR if even else STUCK_FACTOR_COARSE) * lengths[k + 1]:
                return long[: k + 1]
        return []


def held_lengths(changes, rows):
    """Return how many runs of rows without a change on any axis there are, by length."""
    changed = np.zeros(rows, dtype=bool)
    for at in changes:
        changed[at + 1] = True
    # runs cut by the row group's ends are left out
    lengths = np.diff(np.flatnonzero(changed))
    return np.bincount(np.minimum(lengths, LENGTHS), minlength=LENGTHS + 1)


def rows_a_value(counts):
    """Return how many rows a value of a sensor is held, 1 where it is not."""
    lengths = np.arange(LENGTHS)
    n = counts[:LENGTHS].sum()
    if n < LEAST_RUNS:
        return 1.0
    # the median, so that a few stuck stretches do not count
    middle = lengths[np.searchsorted(np.cumsum(counts[:LENGTHS]), n / 2)]
    near = np.abs(lengths - middle) <= max(1.0, 0.15 * middle)
    kept = counts[:LENGTHS] * near
    mean = float(kept @ lengths / kept.sum())
    near = np.abs(lengths - mean) <= max(1.0, 0.15 * mean)
    share = counts[:LENGTHS][near].sum() / counts.sum()
    return mean if mean >= LEAST_HELD and share >= HELD_SHARE else 1.0
