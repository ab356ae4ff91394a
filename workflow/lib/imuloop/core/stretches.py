"""Stretches of consecutive samples: half-open ranges of indices, (k, 2)."""

import numpy as np

from imuloop.core.gaps import LONG_GAP_STEPS, gap_limit
from imuloop.core.samples import TIME


def stretches_of(mask):
    """Return the stretches in which a mask is true, half-open ranges of indices, (k, 2).

    `mask`, (n,), is true or false for each of n samples.
    """
    edges = np.flatnonzero(np.diff(np.asarray(mask, dtype=int), prepend=0, append=0))
    return edges.reshape(-1, 2)


def unbroken(rows):
    """Return the unbroken stretches, between long gaps, (k, 2), and the median time step, s.

    A stretch is a half-open range of rows; a long gap is a step of more than `LONG_GAP_STEPS`
    median steps. `rows` are Samples. Exceptions: with fewer than two samples the step is given as 1
    s, and without samples the array of stretches is empty.
    """
    step = 1.0 if rows.interval is None else rows.interval
    cuts = 1 + np.flatnonzero(np.diff(rows[TIME]) > gap_limit(step, LONG_GAP_STEPS))
    edges = np.concatenate([[0], cuts, [len(rows)]])
    stretches = np.column_stack([edges[:-1], edges[1:]])
    return stretches if len(rows) else stretches[:0], step


def lengths(ranges):
    """Return the number of samples in each of k half-open ranges of samples, (k,), int.

    `ranges`, (k, 2), has the first sample of each range and the one after its last.
    """
    return np.diff(ranges, axis=1).ravel()


def merged(ranges):
    """Return ranges of samples in order, (k, 2), of which those that overlap or touch are merged.

    `ranges`, (m, 2), are half-open and in any order.
    """
    if not len(ranges):
        return ranges
    first, last = ranges[np.argsort(ranges[:, 0])].T
    # a range that starts after the end of all ranges before is apart from them
    reached = np.maximum.accumulate(last)
    is_apart = first[1:] > reached[:-1]
    return np.column_stack([first[np.append(True, is_apart)], reached[np.append(is_apart, True)]])


def without(ranges, cuts):
    """Return ranges of samples, (l, 2), without the parts that lie in other ranges, the cuts.

    All ranges are half-open. `ranges`, (m, 2), are in order. `cuts`, (k, 2), are in order and do
    not overlap or touch.
    """
    parts = [np.empty((0, 2), dtype=int)]
    for i, j in ranges:
        # cuts that overlap with the range: each part starts at the range's start or the end of a
        # cut, and ends at the start of the next cut or the range's end
        low, high = np.searchsorted(cuts[:, 1], i, side="right"), np.searchsorted(cuts[:, 0], j)
        edges = np.concatenate([[i], cuts[low:high].ravel(), [j]]).reshape(-1, 2)
        parts.append(edges[edges[:, 1] > edges[:, 0]])
    return np.concatenate(parts)


def divided(first, last, count):
    """Return a range of samples cut into `count` parts of nearly equal length, (count, 2).

    `first` is the first sample of the range, and `last` the one after its last sample. The parts
    are half-open ranges. A count below one counts as one.
    """
    edges = np.linspace(first, last, max(count, 1) + 1).astype(int)
    return np.column_stack([edges[:-1], edges[1:]])
