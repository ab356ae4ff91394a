"""One channel of a log: values that repeat, that stay at an end of the range, or that jump.

A *run* is a stretch of rows with one value. Long runs are stuck values, runs at the ends of the
range are saturation, runs of one row that come back to one value are failed reads, and equal runs
are values that are held.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from imuloop.ingest.spikes import count_jumps

# rows of a block; and a channel is fine if its values span more than `SPAN` quantisation steps in a
# block: values within two steps may come from noise below the step
BLOCK, SPAN = 128, 2.5
# a run is stuck if it has at least `STUCK_FACTOR` times the rows of the next shorter run, and if
# there are at least `FEWEST` shorter runs, which show the usual length
STUCK_FACTOR, FEWEST = 10, 50
# a value is far away if it differs by more than `FAR_STEPS` quantisation steps; a run of at least
# `FLAT_TOP` rows is a flat top if the values before and after it are far away
FAR_STEPS, FLAT_TOP = 8, 3
# an end of the range is saturated if the square of the number of rows there exceeds the number of
# rows at the next level by this factor: noise of 0.55 steps or more does so with a probability of
# e^-11
CUT_TAIL = 300
# ends of 16 bits, in quantisation steps: such an end is saturated if two rows are there
RAILS = (2**15 - 1, 2**15)
# a value is a failed read if it stands alone in more than this share of the rows: a value that
# comes at random, with probability p, stands alone in a share p (1 - p)^2, a seventh at most
OFTEN = 0.2
# a sensor holds its values if each lasts for at least this mean number of rows
LEAST_HELD = 1.25
# a larger share than this counts as nearly all
MOST = 0.9


def blocks(x):
    """Return samples, (n,), as blocks, (n // BLOCK, BLOCK), without the last, incomplete one."""
    return x[: len(x) // BLOCK * BLOCK].reshape(-1, BLOCK)


def jump_sizes(x):
    """Return the size of the change from each sample of x, (n,), to the next one, (n - 1,)."""
    size = np.diff(x)
    return np.abs(size, out=size)


def least_stuck(counts):
    """Return the least number of rows of a stuck run.

    Element k of `counts` is the number of runs of k rows. If no run is stuck, the result is more
    than the number of all rows.
    """
    length = np.flatnonzero(counts)
    shorter = np.cumsum(counts[length])[:-1]
    long = length[1:] >= STUCK_FACTOR * length[:-1]
    return length[1:][long & (shorter >= FEWEST)].min(initial=counts @ np.arange(len(counts)) + 1)


@dataclass
class Channel:
    """The samples of a channel, (n,) SI, and what its runs show.

    `step` is the quantisation step, 0 if it is unknown. `low` and `high` are the ends of the range
    of the samples. `width` is the range of values in each block, and `changed` tells which rows
    differ from the row before, (n - 1,). `is_fine` tells whether noise spans the step in half of
    the blocks that change.
    `stuck` are the stuck runs, (first row, rows), and `tops` the values of flat tops.
    `failed_reads` is the number of rows with the value of failed reads, which are far from the rows
    before and after. `jumps` is the number of samples that jump far away and back again. `wraps`
    are the rows before an integer wraps around, (k,).
    """

    x: np.ndarray
    step: float
    low: float
    high: float

    def __post_init__(self):
        self.width, self.changed = np.ptp(blocks(self.x), axis=1), self.x[1:] != self.x[:-1]
        changing = np.count_nonzero(self.width)
        self.is_fine = np.count_nonzero(self.width > SPAN * self.step) >= changing / 2 > 0
        # first row and number of rows of the runs of two rows and more
        edges = np.flatnonzero(np.diff(self.changed, prepend=True, append=True))
        first, lengths = edges[::2], edges[1::2] - edges[::2] + 1
        counts = np.bincount(lengths, minlength=2)
        counts[1] = np.count_nonzero(self.changed) + 1 - len(first)
        long = lengths >= (least_stuck(counts) if self.is_fine else len(self.x) + 1)
        self.stuck = list(zip(first[long].tolist(), lengths[long].tolist(), strict=True))
        size = jump_sizes(self.x)
        far = size > FAR_STEPS * self.step
        inner = (lengths >= FLAT_TOP) & (first > 0) & (first + lengths < len(self.x))
        first, last = first[inner], (first + lengths - 1)[inner]
        tops = self.x[first[far[first - 1] & far[last]]]
        # flat tops also at other values show a sensor that holds its values
        self.tops = tops if np.isin(tops, (self.low, self.high)).all() else tops[:0]
        alone, often = self.x[1:-1][far[:-1] & far[1:]], OFTEN * len(self.x)
        self.failed_reads = 0
        if self.step and len(alone) > often:
            rows = np.count_nonzero(alone == pd.Series(alone[:1000]).mode()[0])
            self.failed_reads = rows if rows > often else 0
        self.jumps, self.wraps = count_jumps(self.x, self.step, size), self._wraps(size)

    def _wraps(self, size):
        """Return the rows after which an integer wraps around, (k,) of int.

        It then jumps from one end of its range to the other. `size`, (n - 1,), are the sizes of the
        jumps from row to row. Three other causes are excluded: a range whose ends are not of
        opposite sign and about equal size; a value that swings from end to end, which also makes
        large steps just before or after; and a value that saturates, which stays at an end.
        """
        span, most = self.high - self.low, (1 - MOST) * (self.high - self.low)
        if not abs(self.low + self.high) <= 2 * most:
            return np.empty(0, dtype=int)
        rows = np.flatnonzero(size[1:-1] >= MOST * span) + 1
        before, after = size[rows - 1], size[rows + 1]
        from_end, to_end = (np.isin(self.x[rows + k], (self.low, self.high)) for k in (0, 1))
        held = ((before == 0) & from_end) | ((after == 0) & to_end)
        change = np.maximum(before, after)
        return rows[(0 < change) & (2 * change < most) & ~held]


def saturation(channels, rate):
    """Return the saturated ends of the range of each channel: {name: {"values", "rows"}}.

    "values" are the ends, SI, a list, and "rows" is the number of rows there. An end is saturated
    if many rows are there and few at the next level, or if it is reached in flat tops, which no
    smooth motion has. Each axis may reach an end for a few rows only, so the rows of all ends of
    equal size are added up. A single run of a second or more is a stuck value, unless
    other ends of this size are saturated.

    Parameters
    ----------
    channels : dict of str to Channel
        Channels of the sensor by name.
    rate : float
        Samples per second, Hz.
    """
    ends, found = [], {name: {"values": [], "rows": 0} for name in channels}
    for name, c in channels.items():
        width = c.step or np.finfo(float).tiny
        for value in sorted({c.low, c.high} - {0.0}) if c.low < c.high else ():
            # only rows within two steps of the end are looked at: most rows are not
            near = c.x <= value + 2 * width if value == c.low else c.x >= value - 2 * width
            away = np.abs(c.x[near] - value)
            rows = np.count_nonzero(away < 0.5 * width)
            beside = np.count_nonzero(away < 1.5 * width) - rows
            runs = [length for start, length in c.stuck if c.x[start] == value]
            flat = np.count_nonzero(c.tops == value)
            flat += rows > 1 and c.step > 0 and round(abs(value) / c.step) in RAILS
            single = len(runs) == 1 and runs[0] >= max(rate, MOST * rows)
            if c.is_fine or flat:
                ends.append((name, value, rows, beside, flat, width, single))
    for name, value, rows, *_, width, _ in ends:
        same = [e for e in ends if abs(abs(e[1]) - abs(value)) <= 1.01 * width and not e[6]]
        total, near, flat = (sum(e[k] for e in same) for k in (2, 3, 4))
        if flat or total**2 > CUT_TAIL * max(near, 1):
            found[name]["values"].append(value)
            found[name]["rows"] += int(rows)
    return found


def silent(channels, force):
    """Return the names of channels that never change in nearly all quiet blocks.

    `channels` are the Channels of a sensor by name. `force` are the samples of the three axes of
    the accelerometer, (n,) each. A block is quiet if the variance of the force in it is at most the
    median of all blocks.
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
        # a channel that is stuck only once or twice is not silent
        if c.low < c.high and len(c.stuck) not in (1, 2)
        if np.mean(c.width[quiet] == 0) > MOST
    ]


def rows_a_value(channels):
    """Return the number of rows for which a sensor holds each value, 1 if it does not hold them.

    `channels` is the list of the Channels of the sensor.
    """
    changed = np.any([c.changed for c in channels], axis=0)
    # there are too many changes: nine in ten values would have to last for `LEAST_HELD` rows
    if np.count_nonzero(changed) * MOST * LEAST_HELD > len(changed):
        return 1.0
    lengths = np.diff(np.flatnonzero(changed))
    if len(lengths) < FEWEST:
        return 1.0
    usual = np.median(lengths)
    near = lengths[np.abs(lengths - usual) <= max(1.0, 0.15 * usual)]
    held = len(near) >= MOST * len(lengths) and near.mean() >= LEAST_HELD
    return float(near.mean()) if held else 1.0
