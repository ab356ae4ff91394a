"""Spikes: single samples that no motion of the device makes.

A rotation is smooth, and a knock has several samples or shows on several axes. So a sample is a
spike if it is far from its neighbours, these agree with each other, and no other channel moves.
"""

import numpy as np

# number of samples on each side for the fit of a cubic, and number on each side that show the noise
NEAR, REACH = 4, 16
# least distance of a spike from the cubic, as a multiple of the largest distance of a neighbour,
# and as a multiple of the noise; jumps of good sensors reach 10
OF_NEIGHBOURS, OF_NOISE = 10.0, 15.0
# another channel moves if its distance from its own cubic exceeds this multiple of its noise, and
# this share of the spike's own multiple: 6 happens by chance now and then. Among 169 knocks of a
# single sample in 3.3 million measured rows each moves another channel by 7 or more
MOVES, MOVES_SHARE = 6.0, 0.01
# a spike on several channels jumps by more than this multiple of the jumps near it; a knock reaches
# 17
FAR_JUMP = 20.0
# number of rows that are searched at once
_PART = 1 << 14
# number of searches: the larger of two spikes near to each other hides the smaller one until it is
# replaced
PASSES = 3

_BESIDE = np.r_[-NEAR:0, 1 : NEAR + 1]
_POWERS = np.vander(_BESIDE, 4, increasing=True).astype(float)
# matrices from the neighbours to their cubic's value at the sample and their distances from it
_LEVEL = np.linalg.pinv(_POWERS)[0]
_AWAY = np.eye(2 * NEAR) - _POWERS @ np.linalg.pinv(_POWERS)
# the first and the last samples, which have too few neighbours, are not judged
_EDGE = REACH + 2
_WITHIN = np.arange(-_EDGE, _EDGE + 1)
# indices of the distances that show the noise, as they do not depend on the sample itself, and of
# those that depend on it
_AROUND, _NEXT = np.r_[: REACH - 2, REACH + 3 : 2 * REACH + 1], np.r_[REACH - 1 : REACH + 2]


def isolated(x, steps):
    """Return the rows and the channel numbers of k spikes on a single channel, (2, k) of int.

    A sample v is a spike if no other channel moves, and

        |v - c| > max(OF_NEIGHBOURS d, OF_NOISE s, OF_NOISE q).

    c is the value of the cubic through NEAR samples on each side, and d the largest distance of
    these from the cubic. s is the standard deviation of the noise: the median distance, within
    REACH, of samples from the cubic through two samples on each side, over 0.6745. q is the
    quantisation step.

    Parameters
    ----------
    x : array_like, shape (m, n)
        Samples of m channels.
    steps : array_like, shape (m,)
        Quantisation steps of the channels, 0 if a step is not known.
    """
    x, steps, found = list(x), np.asarray(steps), []
    for _ in range(PASSES if len(x[0]) > 2 * _EDGE else 0):
        judged = []
        for k, (values, step) in enumerate(zip(x, steps, strict=True)):
            at = _candidates(values, step)
            near = values[at[:, None] + _BESIDE]
            far = np.abs(values[at] - near @ _LEVEL)
            out = far > OF_NEIGHBOURS * np.abs(near @ _AWAY).max(axis=1)
            judged.append((at[out], np.full(out.sum(), k), near[out] @ _LEVEL, far[out]))
        at, k, level, far = map(np.concatenate, zip(*judged, strict=True))
        around = _distance(np.array([values[at[:, None] + _WITHIN] for values in x]))
        # the median of |e| is 0.6745 of the standard deviation of a normal e
        noise = np.maximum(np.median(around[..., _AROUND], axis=2) / 0.6745, steps[:, None])
        spike = k, np.arange(len(k))
        multiple = far / noise[spike]
        moves = around[..., _NEXT].max(axis=2) > np.maximum(MOVES, MOVES_SHARE * multiple) * noise
        moves[spike] = False
        alone = (multiple > OF_NOISE) & ~moves.any(axis=0)
        found += zip(at[alone], k[alone], strict=True)
        if not alone.any():
            break
        for j in set(k[alone]):
            x[j] = x[j].copy()
            x[j][at[alone & (k == j)]] = level[alone & (k == j)]
    return np.array(sorted(found, key=lambda each: each[::-1]), dtype=int).reshape(-1, 2).T


def _candidates(x, step):
    """Return the rows of a channel x, (n,), that are farther from their cubic than rows near by.

    Such a row is farther than twice the distances three and five rows away, and than `OF_NOISE`
    times the quantisation `step`. Most samples are not.
    """
    found = []
    # the arrays of a part stay in the processor's cache
    for first in range(0, len(x) - 2 * _EDGE, _PART):
        distance = _distance(x[first : first + _PART + 2 * _EDGE])
        inner = distance[REACH:-REACH]
        candidate, twice = inner > OF_NOISE * step, 2 * distance
        for d in (-5, -3, 3, 5):
            candidate &= inner > twice[REACH + d : len(distance) - REACH + d]
        found.append(np.flatnonzero(candidate) + first + _EDGE)
    return np.concatenate(found)


def _distance(x):
    """Return the distances of samples, (..., n), from the cubic through two samples on each side.

    The result, (..., n - 4), lacks two samples at each end.
    """
    sums = 4 * (x[..., 1:-3] + x[..., 3:-1]) - x[..., :-4] - x[..., 4:]
    return np.abs(x[..., 2:-2] - sums / 6)


def count_jumps(x, step, size):
    """Return the number of samples of a channel, (n,), that jump far away and back again.

    Both jumps exceed `FAR_JUMP` times the quantisation `step` and all jumps within half of REACH.
    `size` are the sizes of the jumps from sample to sample, (n - 1,).
    """
    up, reach = x[1:] > x[:-1], REACH // 2
    far = size > FAR_JUMP * max(step, np.median(size[::REACH])) if len(x) > REACH else size < 0
    at = np.flatnonzero(far[1:] & far[:-1] & (up[1:] != up[:-1])) + 1
    at = at[(at > reach) & (at < len(x) - reach - 1)]
    near = np.r_[-reach - 1 : -1, 1 : reach + 1]
    jump = np.minimum(size[at - 1], size[at])
    return int(np.count_nonzero(jump > FAR_JUMP * size[at[:, None] + near].max(axis=1, initial=0)))
