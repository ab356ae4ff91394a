"""Stretches: samples that follow each other, as half-open ranges of indices, shape (k, 2)."""

import numpy as np

from imuloop.core.gaps import LONG_GAP_STEPS, gap_limit
from imuloop.core.samples import TIME


def stretches_of(mask):
    """Return the stretches in which a mask, shape (n,), is true, shape (k, 2)."""
    edges = np.flatnonzero(np.diff(np.asarray(mask, dtype=int), prepend=0, append=0))
    return edges.reshape(-1, 2)


def unbroken(rows):
    """Return the stretches of `Samples` between long gaps (`core.gaps`), and the median step, s.

    A log of fewer than two samples has no step; one second stands in.
    """
    step = rows.interval
    if step is None:
        return np.array([[0, len(rows)]])[: len(rows)], 1.0
    cuts = 1 + np.flatnonzero(np.diff(rows[TIME]) > gap_limit(step, LONG_GAP_STEPS))
    edges = np.concatenate([[0], cuts, [len(rows)]])
    return np.column_stack([edges[:-1], edges[1:]]), step


def lengths(ranges):
    """Return the number of samples in each range."""
    return np.diff(ranges, axis=1).ravel()


def merged(ranges):
    """Return ranges, at least one, in order, with overlapping or touching ones merged."""
    first, last = ranges[np.argsort(ranges[:, 0])].T
    reached = np.maximum.accumulate(last)
    apart = first[1:] > reached[:-1]
    return np.column_stack([first[np.append(True, apart)], reached[np.append(apart, True)]])


def without(ranges, cuts):
    """Return ranges, in order, less the cuts, which are as `merged` returns them."""
    parts = [np.empty((0, 2), dtype=int)]
    for i, j in ranges:
        low, high = np.searchsorted(cuts[:, 1], i, side="right"), np.searchsorted(cuts[:, 0], j)
        edges = np.concatenate([[i], cuts[low:high].ravel(), [j]]).reshape(-1, 2)
        parts.append(edges[edges[:, 1] > edges[:, 0]])
    return np.concatenate(parts)


def divided(first, last, count):
    """Return a range in so many even parts, at least one, (k, 2)."""
    edges = np.linspace(first, last, max(count, 1) + 1).astype(int)
    return np.column_stack([edges[:-1], edges[1:]])
