"""Stretches of one value on an axis: stuck, or held over several rows."""

import numpy as np

# a value repeated fewer times is never stuck; a stuck stretch is so many times longer than the
# longest of the others, of at least so many; where these vary more than chance lets them (noise
# below the quantisation step), so many times
LEAST_STUCK, STUCK_FACTOR, LEAST_STRETCHES, STUCK_FACTOR_COARSE = 10, 5, 50, 50
# the longest stretches of an axis that are looked at, and lengths that are counted one by one
KEPT, LENGTHS = 2000, 256
# steps that the noise of 64 rows spans: to tell stretches, and to tell a cut tail; so many such
# blocks, at most twice, are looked at
SPAN, WIDE_SPAN, BLOCKS = 1.5, 3.5, 256
# values are held where rows a new value are at least this many, and this share of stretches near
# it
LEAST_HELD, HELD_SHARE = 1.25, 0.98


class ConstantStretches:
    """Stretches of one value on an axis: their first rows, lengths and values."""

    def __init__(self, x, step):
        edges = np.concatenate(([0], np.flatnonzero(x[1:] != x[:-1]) + 1, [len(x)]))
        self.starts, self.lengths = edges[:-1], np.diff(edges)
        self.values = x[self.starts]
        blocks, step = x[: len(x) // 64 * 64].reshape(-1, 64), step or 0.0
        width = np.ptp(blocks[:: max(len(blocks) // BLOCKS, 1)], axis=1)
        varied = np.count_nonzero(width > 0)
        # whether the noise spans the quantisation step, and several of it
        self.fine = np.count_nonzero(width > SPAN * step) >= 0.5 * varied > 0
        self.wide = np.count_nonzero(width > WIDE_SPAN * step) >= 0.5 * varied

    def stuck(self):
        """Return (rows, first row, value) of each stretch too long for chance."""
        long = (self.lengths >= LEAST_STUCK) & np.isfinite(self.values)
        each = (x[long].tolist() for x in (self.lengths, self.starts, self.values))
        long = sorted(zip(*each, strict=True), reverse=True)[:KEPT]
        counts, usual = _by_length(self.lengths)[1:], np.arange(1, LENGTHS + 1)
        short = self.lengths[self.lengths < LEAST_STUCK]
        lengths = [each[0] for each in long] + [int(short.max(initial=1))]
        for k in range(len(long) - 1, -1, -1) if self.fine else ():
            rest = np.where(usual <= lengths[k + 1], counts, 0)
            n = rest.sum()
            if n < LEAST_STRETCHES:
                continue
            even = lengths[k + 1] <= 1 + 3 * (rest @ usual) / n * np.log(n)
            if lengths[k] >= (STUCK_FACTOR if even else STUCK_FACTOR_COARSE) * lengths[k + 1]:
                return long[: k + 1]
        return []


def _by_length(lengths):
    """Return how many stretches there are of each length, up to `LENGTHS`."""
    return np.bincount(np.minimum(lengths, LENGTHS), minlength=LENGTHS + 1)


def rows_a_value(changed):
    """Return how many rows a sensor's value is held, 1 where it is not; of its changes, (k, n)."""
    counts = _by_length(np.diff(np.flatnonzero(changed.any(axis=0))))
    total, counts, lengths = counts.sum(), counts[:LENGTHS], np.arange(LENGTHS)
    if counts.sum() < LEAST_STRETCHES:
        return 1.0

    def near(length):
        return counts * (np.abs(lengths - length) <= max(1.0, 0.15 * length))

    # of the median, so that a few stuck stretches do not count
    kept = near(lengths[np.searchsorted(np.cumsum(counts), counts.sum() / 2)])
    mean = float(kept @ lengths / kept.sum())
    return mean if mean >= LEAST_HELD and near(mean).sum() >= HELD_SHARE * total else 1.0
