"""Stretches: consecutive samples, as half-open ranges of indices, (k, 2)."""

import numpy as np

from imuloop.core.gaps import LONG_GAP_STEPS, gap_limit
from imuloop.core.samples import TIME


def stretches_of(mask):
    """Return the stretches, (k, 2), in which a mask, (n,), is true."""
    edges = np.flatnonzero(np.diff(np.asarray(mask, dtype=int), prepend=0, append=0))
    return edges.reshape(-1, 2)


def unbroken(rows):
    """Return the stretches of Samples between long gaps, (k, 2), and the median time step, s.

    The step is 1 s if there are fewer than two samples.
    """
    step = 1.0 if rows.interval is None else rows.interval
    cuts = 1 + np.flatnonzero(np.diff(rows[TIME]) > gap_limit(step, LONG_GAP_STEPS))
    edges = np.concatenate([[0], cuts, [len(rows)]])
    return np.column_stack([edges[:-1], edges[1:]])[: len(rows)], step


def lengths(ranges):
    """Return the number of samples in each range, (k,)."""
    return np.diff(ranges, axis=1).ravel()


def merged(ranges):
    """Return ranges, (k, 2), in order, with overlapping and touching ones merged."""
    first, last = ranges[np.argsort(ranges[:, 0])].T
    # the end of all ranges so far; a range that starts after it is apart from them
    reached = np.maximum.accumulate(last)
    apart = np.append(True, first[1:] > reached[:-1])[: len(first)]
    return np.column_stack([first[apart], reached[np.roll(apart, -1)]])


def without(ranges, cuts):
    """Return the parts of ranges, (m, 2), in order, that lie outside cuts, (k, 2).

    The cuts are ranges, too; they are in order and do not overlap or touch.
    """
    parts = [np.empty((0, 2), dtype=int)]
    for i, j in ranges:
        low, high = np.searchsorted(cuts[:, 1], i, side="right"), np.searchsorted(cuts[:, 0], j)
        # the parts lie between the start, the ends of the cuts within, and the end
        edges = np.concatenate([[i], cuts[low:high].ravel(), [j]]).reshape(-1, 2)
        parts.append(edges[edges[:, 1] > edges[:, 0]])
    return np.concatenate(parts)


def divided(first, last, count):
    """Return a range cut into `count` parts of nearly equal length, (count, 2).

    The range goes from `first` to before `last`. A count below one counts as one.
    """
    edges = np.linspace(first, last, max(count, 1) + 1).astype(int)
    return np.column_stack([edges[:-1], edges[1:]])
