"""One channel of a log: how its values repeat, keep to an end of its range, or jump."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

# rows of a block, and quantisation steps that noise spans in it: to two steps only, of noise below
# the step, says nothing
BLOCK, SPAN = 128, 2.5
# least rows of a run of equal values that is stuck, and their least ratio to the longest of at
# least `FEWEST` other runs; the ratio is ten times as large where the others vary more than by
# chance (noise below the quantisation step)
LEAST_STUCK, STUCK_FACTOR, COARSE, FEWEST = 10, 5, 10, 50
# quantisation steps to a value that is far away; rows of equal values between such are a flat top
FAR_STEPS, FLAT_TOP = 8, 3
# least ratio of the square of the rows at a saturated end of the range to the rows at the next
# level: with noise of 0.55 steps or more the chance of no row beyond is e^-11
CUT_TAIL = 300
# steps to the ends of 16 bits, which two rows saturate
RAILS = (2**15 - 1, 2**15)
# a value between far ones is a failed read in this share of the rows: at random it comes to a
# seventh at most, p (1 - p)^2
OFTEN = 0.2
# least rows of a value that is held
LEAST_HELD = 1.25
# share that is nearly all: of the range, which an integer jumps that wraps around; of the runs of a
# value that is held; of the quieter half of the blocks, in which a silent axis never changes
MOST = 0.9


def blocks(x):
    """Return samples, (n,), in blocks, (n // BLOCK, BLOCK)."""
    return x[: len(x) // BLOCK * BLOCK].reshape(-1, BLOCK)


def least_stuck(counts):
    """Return the least length of runs that is too long for chance, from their `counts` by length.

    It is more than the number of all rows if no run is too long.
    """
    length = np.flatnonzero(counts)
    count, rows = np.cumsum([counts[length], counts[length] * length], axis=1)
    most = rows[-1]
    count, rows = count[:-1], rows[:-1]
    # the longest run of n with a mean m has about m ln n rows by chance
    by_chance = length[:-1] <= 1 + 3 * rows / count * np.log(count)
    least = STUCK_FACTOR * np.where(by_chance, 1, COARSE) * length[:-1]
    long = (length[1:] >= np.maximum(LEAST_STUCK, least)) & (count >= FEWEST)
    return length[1:][long].min(initial=most + 1)


@dataclass
class Channel:
    """The samples of a channel, (n,) SI, and what runs of equal values among them show.

    `width` is the range of values in each block, and `changed` tells which rows differ from the one
    before, (n - 1,).
    `step` is the quantisation step, 0 if it is not known, `low` and `high` are the ends of its
    range. `is_fine` tells whether noise spans the step in half of the blocks that change. `stuck`
    are first row and rows of the runs that are too long for chance, and `tops` the values of flat
    tops. `failed_reads` is the number of rows that hold one value again and again, far from the
    rows around them.
    """

    x: np.ndarray
    step: float
    low: float
    high: float

    def __post_init__(self):
        self.width, self.changed = np.ptp(blocks(self.x), axis=1), self.x[1:] != self.x[:-1]
        changing = np.count_nonzero(self.width)
        self.is_fine = np.count_nonzero(self.width > SPAN * self.step) >= changing / 2 > 0
        # first row and number of rows of the runs of two equal values and more
        edges = np.flatnonzero(np.diff(self.changed, prepend=True, append=True))
        first, lengths = edges[::2], edges[1::2] - edges[::2] + 1
        counts = np.bincount(lengths, minlength=2)
        counts[1] = np.count_nonzero(self.changed) + 1 - len(first)
        long = lengths >= (least_stuck(counts) if self.is_fine else len(self.x) + 1)
        self.stuck = list(zip(first[long].tolist(), lengths[long].tolist(), strict=True))
        far = np.abs(np.diff(self.x)) > FAR_STEPS * self.step
        inner = (lengths >= FLAT_TOP) & (first > 0) & (first + lengths < len(self.x))
        first, last = first[inner], (first + lengths - 1)[inner]
        tops = self.x[first[far[first - 1] & far[last]]]
        # values that are held have flat tops everywhere
        self.tops = tops if np.isin(tops, (self.low, self.high)).all() else tops[:0]
        alone, often = self.x[1:-1][far[:-1] & far[1:]], OFTEN * len(self.x)
        rows = 0
        if self.step and len(alone) > often:
            rows = np.count_nonzero(alone == pd.Series(alone[:1000]).mode()[0])
        self.failed_reads = rows if rows > often else 0

    def wraps(self):
        """Return the rows before jumps from one end of the range to the other that stay there.

        A value that swings from end to end changes more next to the jump. One that saturates is
        held at an end. One that is switched on goes from zero to an end.
        """
        span = self.high - self.low
        bits = np.log2(max(span, 1))
        whole = self.low >= 0 and bits > 11 and 2 ** (np.ceil(bits) - bits) <= 1 / MOST
        if not (whole or abs(self.low + self.high) / 2 <= (1 - MOST) * span):
            return np.empty(0, dtype=int)
        size = np.abs(np.diff(self.x))
        rows = np.flatnonzero(size[1:-1] >= MOST * span) + 1
        before, after = size[rows - 1], size[rows + 1]
        from_end, to_end = (np.isin(self.x[rows + k], (self.low, self.high)) for k in (0, 1))
        held = ((before == 0) & from_end) | ((after == 0) & to_end)
        beside = np.maximum(before, after)
        return rows[(0 < beside) & (2 * beside < (1 - MOST) * span) & ~held]


def saturation(channels, rate):
    """Return the ends of the range that channels of a sensor keep to: {name: {"values", "rows"}}.

    An end is saturated if many rows are there and few at the next levels, or if it is reached
    in flat tops, which no smooth motion has. Ends of equal size are one end, as each axis may reach
    it for a few rows only. A single run of a second or more is a stuck value, unless other ends of
    this size are saturated. `rate` is in Hz.
    """
    ends, found = [], {name: {"values": [], "rows": 0} for name in channels}
    for name, c in channels.items():
        width = c.step or np.finfo(float).tiny
        for value in sorted({c.low, c.high} - {0.0}) if c.low < c.high else ():
            away = np.abs(c.x - value)
            rows = np.count_nonzero(away < 0.5 * width)
            beside = np.count_nonzero(away < 1.5 * width) - rows
            here = [length for start, length in c.stuck if c.x[start] == value]
            flat = np.count_nonzero(c.tops == value)
            flat += rows > 1 and c.step > 0 and round(abs(value) / c.step) in RAILS
            lone = len(here) == 1 and here[0] >= max(rate, MOST * rows)
            if c.is_fine or flat:
                ends.append((name, value, rows, beside, flat, width, lone))
    for name, value, rows, *_, width, _ in ends:
        same = [e for e in ends if abs(abs(e[1]) - abs(value)) <= 1.01 * width and not e[6]]
        total, beside, flat = (sum(e[k] for e in same) for k in (2, 3, 4))
        if flat or total**2 > CUT_TAIL * max(beside, 1):
            found[name]["values"].append(value)
            found[name]["rows"] += int(rows)
    return found


def silent(channels, force):
    """Return the names of channels that never change in most of the quiet blocks.

    `force` are the samples of the accelerometer's channels, (n,) each, whose variance tells which
    half is quiet.
    """
    if all(c.width.all() for c in channels.values()):
        return []
    power = sum(np.var(blocks(x), axis=1) for x in force)
    if not len(power):
        return []
    quiet = power <= np.median(power)
    return [
        name
        for name, c in channels.items()
        # a channel that is stuck once or twice has a fault of a moment
        if c.low < c.high and len(c.stuck) not in (1, 2)
        if np.mean(c.width[quiet] == 0) > MOST
    ]


def rows_a_value(channels):
    """Return the number of rows for which a sensor's channels hold a value, 1 if they do not."""
    changed = np.any([c.changed for c in channels], axis=0)
    # nine in ten runs of a held value have at least this mean length
    if np.count_nonzero(changed) * MOST * LEAST_HELD > len(changed):
        return 1.0
    lengths = np.diff(np.flatnonzero(changed))
    if len(lengths) < FEWEST:
        return 1.0
    usual = np.median(lengths)
    near = lengths[np.abs(lengths - usual) <= max(1.0, 0.15 * usual)]
    held = len(near) >= MOST * len(lengths) and near.mean() >= LEAST_HELD
    return float(near.mean()) if held else 1.0
