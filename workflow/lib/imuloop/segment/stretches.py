"""Stretches: runs of samples, as half-open ranges of indices."""

import numpy as np


def runs(mask):
    """Return the runs of true values of a mask as index pairs, shape (k, 2), half-open."""
    edges = np.diff(np.concatenate([[0], np.asarray(mask, dtype=np.int8), [0]]))
    return np.column_stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)])


def unbroken(t, gap_factor):
    """Return the stretches without a gap, index pairs of shape (k, 2), and the median step, s.

    A gap is a step of time longer than `gap_factor` times the median step. A log of fewer than
    two samples has no step; one second stands in.
    """
    t = np.asarray(t)
    if len(t) < 2:
        return np.array([[0, len(t)]])[: len(t)], 1.0
    steps = np.diff(t)
    step = float(np.median(steps))
    cuts = np.flatnonzero(steps > gap_factor * step) + 1
    return np.column_stack([np.append(0, cuts), np.append(cuts, len(t))]), step
