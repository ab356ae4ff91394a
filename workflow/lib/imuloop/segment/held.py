"""Rests in the hand: the device keeps its attitude except for tremor and sway."""

import numpy as np

from imuloop.core.stretches import lengths, stretches_of
from imuloop.segment.static_detector import long_enough
from imuloop.segment.windows import sliding_statistics

# length of a mean angular rate, s: a tremor of 6 Hz or more averages out
WINDOW = 0.5
# largest mean angular rate of a device that a hand holds, rad/s
HOLDS = 0.03
# shortest rest in the hand, s: a shorter one may be a pause within a turn
SHORTEST = 2.0
# if this share of a rest in the hand lies still on a support, only the part on the support is used
MOST = 0.8


def held_rests(w, stretches, step, bias, shortest):
    """Return the rests in which a hand holds the device in one attitude, ranges of samples, (m, 2).

    In such a range of samples the norm of the difference between the bias and the mean angular rate
    over `WINDOW` seconds is at most `HOLDS`; the mean removes the tremor. The range lasts at least
    `SHORTEST` and at least `shortest` seconds.

    Parameters
    ----------
    w : ndarray, shape (3, n)
        Angular rate, rad/s.
    stretches : ndarray of int, shape (k, 2)
        Half-open ranges of samples between long gaps, which are searched.
    step : float
        Median time step, s.
    bias : ndarray, shape (3,)
        Bias of the gyroscope, rad/s.
    shortest : float
        Shortest rest of the settings, s.
    """
    width, rests = max(2, round(WINDOW / step)), [np.empty((0, 2), dtype=int)]
    for i, j in stretches[lengths(stretches) >= width]:
        mean, _ = sliding_statistics(w[:, i:j].T, width)
        rests.append(i + stretches_of(np.linalg.norm(mean - bias, axis=1) <= HOLDS))
    rests = np.concatenate(rests)
    return rests[long_enough(rests, max(SHORTEST, shortest), step)]


def unite(still, by_hand):
    """Return m rests, on a support or in the hand, (m, 2), and a mask of those in the hand, (m,).

    The rests are half-open ranges of samples in order of time. A rest in the hand replaces the
    rests on a support that overlap with it. A rest in the hand is left out instead in two cases:
    rests on a support take at least the share `MOST` of its samples; or its overlap with a rest on
    a support is less than half of that rest.

    Parameters
    ----------
    still : ndarray of int, shape (k, 2)
        Ranges of samples of the rests on a support.
    by_hand : ndarray of int, shape (l, 2)
        Ranges of samples of the rests in the hand.
    """
    # number of samples that each pair of rests shares, (k, l)
    ends = np.minimum(still[:, None, 1], by_hand[:, 1])
    shared = np.maximum(ends - np.maximum(still[:, None, 0], by_hand[:, 0]), 0)
    reaches_out = (shared > 0) & (2 * shared < lengths(still)[:, None])
    used = (shared.sum(axis=0) < MOST * lengths(by_hand)) & ~reaches_out.any(axis=0)
    kept = ~shared[:, used].any(axis=1)
    rests = np.concatenate([still[kept], by_hand[used]])
    in_hand = np.arange(len(rests)) >= kept.sum()
    order = np.argsort(rests[:, 0])
    return rests[order], in_hand[order]


def sways(w, rests, bias, step):
    """Return the size of the sway of the device in each of m rests in the hand, rad, (m,).

    The sway is the rotation from the mean attitude of the rest, root mean square. It includes a
    rotation about the vertical, although an error of `bias` looks the same.

    Parameters
    ----------
    w : ndarray, shape (3, n)
        Angular rate, rad/s.
    rests : ndarray of int, shape (m, 2)
        Ranges of samples of the rests.
    bias : ndarray, shape (3,)
        Bias of the gyroscope, rad/s.
    step : float
        Median time step, s.
    """
    rotations = (np.cumsum((w[:, i:j].T - bias) * step, axis=0) for i, j in rests)
    return np.array([np.sqrt(rotation.var(axis=0).sum()) for rotation in rotations])
