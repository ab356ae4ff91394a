"""Faults of one channel of a log: stuck, saturated, held or missing values, and wraps of integers.

A *run* is a stretch of rows with one value. Very long runs are stuck values. Runs at an end of the
range are saturation. Many runs of one row with the same far value are failed reads. Runs of equal
length are values that are held.
"""

import numpy as np
import pandas as pd

from imuloop.core.samples import OWN_TIME, ROWS, SENSORS, own_rows

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
# a value is a failed read if it stands alone in more than this share of the rows: a value that
# comes at random, with probability p, stands alone in a share p (1 - p)^2, a seventh at most
OFTEN = 0.2
# a sensor holds its values if each lasts for at least this mean number of rows
LEAST_HELD = 1.25
# a larger share than this counts as nearly all
MOST = 0.9


def new_rows(samples, names):
    """Return the rows in which a sensor has a new sample, an index array, (k,), or a slice of all.

    `samples` are the columns of a log by name, and `names` the channels of the sensor. If two
    sensors have different clocks, the rows repeat samples of the slower one; these repetitions are
    left out of the result.
    """
    stamps = {axes: OWN_TIME[sensor] for sensor, axes in SENSORS.items()}.get(tuple(names))
    return own_rows(samples[stamps]) if stamps in samples else slice(None)


def quantisation_step(x):
    """Return the quantisation step of a channel, the smallest difference between two of its values.

    `x` are the samples of the channel, (n,). Differences as small as the rounding errors of the
    conversion to SI are ignored. The result is 0 if more than half of the samples have distinct
    values: then the step cannot be known.
    """
    # only the first part of a long log is used
    x = x[:ROWS][np.isfinite(x[:ROWS])]
    levels = np.sort(pd.unique(x))
    steps = np.diff(levels)
    # values that differ by the rounding of the conversion to SI are the same value
    steps = steps[steps > 1e-12 * np.abs(levels).max(initial=0.0)]
    return float(steps.min()) if len(steps) and len(levels) <= len(x) / 2 else 0.0


def blocks(x):
    """Return n samples cut into blocks of `BLOCK` rows, (n // BLOCK, BLOCK).

    `x` are the samples, (n,). Rows at the end that do not fill a block are left out.
    """
    return x[: len(x) // BLOCK * BLOCK].reshape(-1, BLOCK)


def least_stuck(lengths):
    """Return the number of rows from which on a run of one value is a stuck value, not chance.

    A run is a number of successive rows with one value. `lengths` are the numbers of rows of all m
    runs of a channel, (m,). In order of length, the first run is stuck that is at least
    `STUCK_FACTOR` times as long as the run before it, and so are all longer ones. The `FEWEST`
    shortest runs are never stuck. The result is infinite if no run is stuck.
    """
    ordered = np.sort(lengths)
    longer = ordered[FEWEST:]
    stuck = longer[longer >= STUCK_FACTOR * ordered[FEWEST - 1 : -1]]
    return stuck[0] if len(stuck) else np.inf


class Channel:
    """The n samples of a channel, and their faults.

    A run is a number of successive rows with one value.

    Attributes
    ----------
    x, step : array of shape (n,), float
        The samples, SI, and their quantisation step, 0 if it is unknown.
    low, high : float
        Least and largest sample.
    width : array, shape (n // BLOCK,)
        Largest minus least value in each block of `BLOCK` rows.
    changed : array of bool, shape (n - 1,)
        Whether each row but the first differs from the row before.
    is_fine : bool
        Whether the values span more than `SPAN` steps in at least half of the blocks that change.
    stuck : list of tuple of int
        First row and number of rows of each run that is too long for chance.
    tops : array
        Values of flat tops: runs at an end of the range, far from the values before and after.
    failed_reads : int
        Number of rows with the value of failed reads, which are far from the rows before and after.
    ends : dict of float to int
        Number of rows at each saturated end of the range, SI.
    wraps : array of int
        Rows before an integer wraps around from one end of its range to the other.
    """

    def __init__(self, x, step):
        self.x, self.step = x, step
        self.low, self.high = np.fmin.reduce(x), np.fmax.reduce(x)
        self.width, self.changed = np.ptp(blocks(x), axis=1), x[1:] != x[:-1]
        changing = np.count_nonzero(self.width)
        self.is_fine = np.count_nonzero(self.width > SPAN * step) >= changing / 2 > 0
        first = np.flatnonzero(np.append(True, self.changed))
        lengths = np.diff(first, append=len(x))
        long = lengths >= (least_stuck(lengths) if self.is_fine else np.inf)
        self.stuck = [*zip(first[long].tolist(), lengths[long].tolist(), strict=True)]
        # inner runs that are far from the run before and the run after
        far = np.abs(np.diff(x[first])) > FAR_STEPS * step
        lengths, values = lengths[1:-1][far[:-1] & far[1:]], x[first[1:-1][far[:-1] & far[1:]]]
        tops, alone = values[lengths >= FLAT_TOP], values[lengths == 1]
        # flat tops also at other values show a sensor that holds its values
        self.tops = tops if np.isin(tops, (self.low, self.high)).all() else tops[:0]
        # the first thousand show the commonest value; to count all values takes long
        same = np.count_nonzero(alone == pd.Series(alone[:1000]).mode()[0]) if len(alone) else 0
        self.failed_reads = same if same > OFTEN * len(x) else 0
        self.ends, self.wraps = self._saturated_ends(), self._wraps()

    @property
    def is_silent(self):
        """Whether the channel changes, but is constant in most blocks of `BLOCK` rows.

        A silent channel shows no noise at rest: its quantisation step is too coarse, or the
        firmware holds values. Exception: a channel with one or two stuck runs is not silent,
        because its sensor failed for a time.
        """
        is_still = self.low < self.high and np.count_nonzero(self.width) < len(self.width) / 2
        return is_still and len(self.stuck) not in (1, 2)

    def _saturated_ends(self):
        """Return the number of rows at each saturated end of the range, a dict by value, SI.

        An end is the least or the largest sample. It is saturated if many rows are there and few at
        the next quantisation step, or if it is reached in flat tops, which no smooth motion has.
        Exception: an end is stuck, not saturated, if at least the share `MOST` of its rows lies in
        one run that lasts to the end of the log.
        """
        ends, width = {}, self.step or np.finfo(float).tiny
        for value in sorted({self.low, self.high} - {0.0}) if self.low < self.high else ():
            # most samples are far from the end
            inner = value + 2 * width if value == self.low else value - 2 * width
            near = self.x <= inner if value == self.low else self.x >= inner
            away = np.abs(self.x[near] - value)
            rows = np.count_nonzero(away < 0.5 * width)
            beside = np.count_nonzero(away < 1.5 * width) - rows
            is_cut = self.is_fine and rows**2 > CUT_TAIL * max(beside, 1)
            start, count = self.stuck[-1] if self.stuck else (0, 0)
            to_end = self.x[start] == value and start + count == len(self.x)
            is_stuck = to_end and count >= MOST * rows
            if not is_stuck and (is_cut or (self.tops == value).any()):
                ends[float(value)] = rows
        return ends

    def _wraps(self):
        """Return the rows after which an integer wraps around, (k,) of int.

        A wrap is a jump from one end of the integer's range to the other. A jump does not count if
        the ends differ in size by more than a fifth of the range, because the range of an integer
        is symmetric to zero. It does not count either if the steps just before or after it are
        large (a value swings from end to end), or if the value stays at an end (it saturates). The
        k rows are numbers from 0.
        """
        size, span = np.abs(np.diff(self.x)), self.high - self.low
        rows = np.flatnonzero(size[1:-1] >= MOST * span) + 1
        before, after = size[rows - 1], size[rows + 1]
        at_end = np.isin(self.x, (self.low, self.high))
        saturates = ((before == 0) & at_end[rows]) | ((after == 0) & at_end[rows + 1])
        change, most = np.maximum(before, after), (1 - MOST) * span
        jumps = (0 < change) & (2 * change < most) & ~saturates
        return rows[jumps] if abs(self.low + self.high) <= 2 * most else rows[:0]


def rows_a_value(channels):
    """Return the mean number of rows for which a sensor holds a value; 1 if it holds none.

    A sensor that is read faster than it samples holds each value for about the same number of rows.
    `channels` is the list of the Channels of the sensor.
    """
    lengths = np.diff(np.flatnonzero(np.any([c.changed for c in channels], axis=0)))
    if len(lengths) < FEWEST:
        return 1.0
    usual = np.median(lengths)
    near = lengths[np.abs(lengths - usual) <= max(1.0, 0.15 * usual)]
    is_held = len(near) >= MOST * len(lengths) and near.mean() >= LEAST_HELD
    return float(near.mean()) if is_held else 1.0


def count_alone(mask):
    """Return the number of rows in which `mask` is true, but false in the rows before and after.

    `mask` has n rows, (n,) of bool. If `mask` tells in which rows all axes of a sensor are zero,
    the counted rows are failed reads. The result is 0 if they are at most the share `OFTEN` of all
    rows, as by chance.
    """
    alone = int(np.count_nonzero(mask[1:-1] & ~mask[:-2] & ~mask[2:]))
    return alone if alone > OFTEN * len(mask) else 0
