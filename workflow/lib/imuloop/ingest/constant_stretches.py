"""Stretches of one value on an axis: stuck, or held over several rows."""

import numpy as np

# a value repeated fewer times is never stuck; a stuck stretch is so many times longer than the
# longest of the others, of at least so many; where these vary more than chance lets them (noise
# below the quantisation step), so many times
LEAST_STUCK, STUCK_FACTOR, LEAST_STRETCHES, STUCK_FACTOR_COARSE = 10, 5, 50, 50
# the longest stretches of an axis that are kept, and lengths that are counted one by one
KEPT, LENGTHS = 1000, 256
# steps that the noise of 64 rows spans: to tell stretches, and to tell a cut tail; of a piece so
# many such blocks, at most twice, are looked at
SPAN, WIDE_SPAN, BLOCKS = 1.5, 3.5, 256
# values are held where rows a new value are at least this many, and this share of stretches near
# it
LEAST_HELD, HELD_SHARE = 1.25, 0.98


class ConstantStretches:
    """Stretches of one value on an axis, over row groups: their lengths, and the longest."""

    def __init__(self, step):
        self.step = step or 0.0
        self.counts = np.zeros(LENGTHS + 1, dtype=int)
        self.long, self.open, self.last, self.rows = [], 0, np.nan, 0
        # blocks that change, whose noise spans the quantisation step, and several of it
        self.varied = self.lively = self.wide = 0

    def add(self, x, row, starts):
        """Take in a piece that begins at `row`; at `starts`, from 1 on, its values change."""
        if x[0] != self.last:
            starts = np.append(0, starts)
        if len(starts):
            ends = starts + row
            lengths = np.diff(ends, prepend=self.open)
            self.counts += np.bincount(np.minimum(lengths, LENGTHS), minlength=LENGTHS + 1)
            for i in np.flatnonzero(lengths >= LEAST_STUCK):
                value = x[starts[i] - 1] if starts[i] else self.last
                self._keep(lengths[i], ends[i] - lengths[i], value)
            self.open = int(ends[-1])
        self.last, self.rows = x[-1], row + len(x)
        blocks = x[: len(x) // 64 * 64].reshape(-1, 64)
        width = np.ptp(blocks[:: max(len(blocks) // BLOCKS, 1)], axis=1)
        self.varied += int((width > 0).sum())
        self.lively += int((width > SPAN * self.step).sum())
        self.wide += int((width > WIDE_SPAN * self.step).sum())

    def _keep(self, length, start, value):
        self.long.append((int(length), int(start), float(value)))
        if len(self.long) > 2 * KEPT:
            self.long = sorted(self.long, reverse=True)[:KEPT]

    @property
    def fine(self):
        """Whether the noise spans the quantisation step."""
        return self.lively >= 0.5 * self.varied > 0

    def stuck(self):
        """Return (rows, first row, value) of each stretch too long for chance."""
        if self.rows > self.open:
            length = self.rows - self.open
            self.counts[min(length, LENGTHS)] += 1
            if length >= LEAST_STUCK:
                self._keep(length, self.open, self.last)
            self.open = self.rows
        long = sorted((each for each in self.long if np.isfinite(each[2])), reverse=True)
        # the zero-th count is the empty stretch before the first row
        counts, usual = self.counts[1:], np.arange(1, LENGTHS + 1)
        short = np.flatnonzero(counts[: LEAST_STUCK - 1])
        lengths = [each[0] for each in long] + [int(short[-1]) + 1 if len(short) else 1]
        for k in range(len(long) - 1, -1, -1) if self.fine else ():
            rest = np.where(usual <= lengths[k + 1], counts, 0)
            n = rest.sum()
            if n < LEAST_STRETCHES:
                continue
            even = lengths[k + 1] <= 1 + 3 * (rest @ usual) / n * np.log(n)
            if lengths[k] >= (STUCK_FACTOR if even else STUCK_FACTOR_COARSE) * lengths[k + 1]:
                return long[: k + 1]
        return []


def held_lengths(changed):
    """Return how many stretches without a change on any axis (k, n) there are, by length."""
    lengths = np.diff(np.flatnonzero(changed.any(axis=0)))
    return np.bincount(np.minimum(lengths, LENGTHS), minlength=LENGTHS + 1)


def rows_a_value(counts):
    """Return how many rows a value of a sensor is held, 1 where it is not."""
    total, counts, lengths = counts.sum(), counts[:LENGTHS], np.arange(LENGTHS)
    if counts.sum() < LEAST_STRETCHES:
        return 1.0

    def near(length):
        return counts * (np.abs(lengths - length) <= max(1.0, 0.15 * length))

    # of the median, so that a few stuck stretches do not count
    kept = near(lengths[np.searchsorted(np.cumsum(counts), counts.sum() / 2)])
    mean = float(kept @ lengths / kept.sum())
    return mean if mean >= LEAST_HELD and near(mean).sum() >= HELD_SHARE * total else 1.0
