"""Spikes: single samples that no motion of the device makes.

A rotation is smooth, and a knock has several samples or shows on several axes. So a sample is a
spike if it is far from its neighbours, these agree with each other, and no other channel moves. If
other channels move, it is a spike of a wire or a bus only if it is three times as far away.
"""

import numpy as np

from imuloop.core.samples import CHANNELS, OWN_TIME, SENSORS, TIME
from imuloop.ingest.channel import new_rows, quantisation_step

# number of samples on each side for the fit of a cubic, and number on each side that show the noise
NEAR, REACH = 4, 16
# least distance of a spike from the cubic, as a multiple of the largest distance of a neighbour,
# and as a multiple of the noise; jumps of good sensors reach 10
OF_NEIGHBOURS, OF_NOISE = 10.0, 15.0
# another channel moves if its distance from its own cubic exceeds this multiple of its noise, and
# this share of the spike's own multiple: 6 happens by chance now and then. Among 169 knocks of a
# single sample in 3.3 million measured rows each moves another channel by 7 or more
MOVES, MOVES_SHARE = 6.0, 0.01
# number of searches: the larger of two spikes near to each other hides the smaller one until it is
# replaced
PASSES = 3

_BESIDE = np.r_[-NEAR:0, 1 : NEAR + 1]
_POWERS = np.vander(_BESIDE, 4, increasing=True).astype(float)
# matrices from the neighbours to their cubic's value at the sample and their distances from it
_LEVEL = np.linalg.pinv(_POWERS)[0]
_AWAY = np.eye(2 * NEAR) - _POWERS @ np.linalg.pinv(_POWERS)
# the first and the last samples, which have too few neighbours, are not looked at
_EDGE = REACH + 2
# number of rows that are searched at once
_PART = 1 << 14
_WITHIN = np.arange(-_EDGE, _EDGE + 1)
# indices of the distances that show the noise, as they do not depend on the sample itself, and of
# those that depend on it
_AROUND, _NEXT = np.r_[: REACH - 2, REACH + 3 : 2 * REACH + 1], np.r_[REACH - 1 : REACH + 2]


# values of a damaged file can be of any size
@np.errstate(all="ignore")
def without_spikes(samples):
    """Return samples without the rows of spikes on a single channel, and the numbers of spikes.

    A spike of a sensor with a slower clock counts in all rows that repeat it.

    Parameters
    ----------
    samples : dict of str to array
        Columns of shape (n,) by name.

    Returns
    -------
    samples : dict of str to array
        Columns of shape (m,) by name, of which m <= n rows are left.
    single, shared : dict of str to int
        Numbers of spikes by channel: spikes on a single channel, whose rows are left out, and
        spikes on several channels, whose rows stay.
    """
    count, groups = len(samples[TIME]), [CHANNELS]
    if {*OWN_TIME.values()} & {*samples}:
        # rows of the two sensors cannot be compared
        groups = SENSORS.values()
    keep, single, shared = np.ones(count, dtype=bool), {}, {}
    for names in groups:
        first = np.arange(count)[new_rows(samples, names)]
        lengths, is_spike = np.diff(first, append=count), np.zeros(len(first), dtype=bool)
        x = [samples[name][new_rows(samples, names)] for name in names]
        spikes = find_spikes(x, [*map(quantisation_step, x)])
        for numbers, (channels, rows) in zip((single, shared), spikes, strict=True):
            totals = np.bincount(channels, lengths[rows], len(names)).astype(int).tolist()
            numbers |= dict(zip(names, totals, strict=True))
        is_spike[spikes[0][1]] = True
        keep &= ~np.repeat(is_spike, lengths)
    if not keep.all():
        samples = {name: x[keep] for name, x in samples.items()}
    return samples, single, shared


def find_spikes(x, steps):
    """Return the spikes on a single channel, (2, k) of int, and on several channels, (2, l) of int.

    Each of the k or l spikes is a column of two: number of the channel, number of the row. A sample
    v is a spike if

        |v - c| > max(OF_NEIGHBOURS d, OF_NOISE s, OF_NOISE q).

    c is the value of the cubic fitted to NEAR samples on each side, and d the largest distance of
    these samples from the cubic. s is the standard deviation of the noise: each sample within REACH
    has a distance from the cubic through two samples on each side of it, and s is the median of
    these distances over 0.6745. q is the quantisation step. If other channels move in the same row,
    the spike is on several channels, and |v - c| has to exceed 3 OF_NEIGHBOURS d, too.

    Parameters
    ----------
    x : list of array
        Samples of m channels, (n,) each.
    steps : array_like, shape (m,)
        Quantisation steps of the channels, 0 if a step is not known.
    """
    x, steps, spikes = [*x], np.array(steps, dtype=float), [np.empty((2, 0), dtype=int)]
    shared = spikes[0]
    for _ in range(PASSES if len(x[0]) > 2 * _EDGE else 0):
        candidates = [_candidates(values, step) for values, step in zip(x, steps, strict=True)]
        channels = np.repeat(np.arange(len(x)), [candidate.shape[1] for candidate in candidates])
        rows, level, far, factor = np.concatenate(candidates, axis=1)
        rows = rows.astype(int)
        around = _distance(np.array([values[rows[:, None] + _WITHIN] for values in x]))
        # the median of |e| is 0.6745 of the standard deviation of a normal e
        noise = np.maximum(np.median(around[..., _AROUND], axis=2) / 0.6745, steps[:, None])
        spike = channels, np.arange(len(rows))
        multiple = far / noise[spike]
        moves = around[..., _NEXT].max(axis=2) > np.maximum(MOVES, MOVES_SHARE * multiple) * noise
        moves[spike] = False
        off, moves = multiple > OF_NOISE, moves.any(axis=0)
        single, far_off = off & ~moves, off & moves & (factor > 3 * OF_NEIGHBOURS)
        spikes.append(np.array([channels[single], rows[single]]))
        shared = np.array([channels[far_off], rows[far_off]])
        if not single.any():
            break
        for k in {*channels[single]}:
            x[k], here = x[k].copy(), single & (channels == k)
            x[k][rows[here]] = level[here]
    return np.concatenate(spikes, axis=1), shared


def _candidates(x, step):
    """Return the k samples of a channel that may be spikes, (4, k).

    `x` are the n samples of the channel, (n,), and `step` is its quantisation step. A cheap test
    excludes most samples: the distance of a sample from the cubic through two samples on each side
    has to exceed `OF_NOISE` steps and twice the distances of the samples three and five rows away.
    The first row of the result has the number of the row of each candidate. The second has the
    value c there of the cubic fitted to its neighbours, NEAR samples on each side. The third has
    the distance of the sample from c. The fourth has this distance over the largest distance of a
    neighbour from the cubic; samples with at most `OF_NEIGHBOURS` there are left out.
    """
    parts = []
    # the arrays of a part stay in the processor's cache
    for first in range(0, len(x) - 2 * _EDGE, _PART):
        distance = _distance(x[first : first + _PART + 2 * _EDGE])
        inner, twice = distance[REACH:-REACH], 2 * distance
        candidate = inner > OF_NOISE * step
        for d in (-5, -3, 3, 5):
            candidate &= inner > twice[REACH + d : len(distance) - REACH + d]
        parts.append(np.flatnonzero(candidate) + first + _EDGE)
    rows = np.concatenate(parts)
    near = x[rows[:, None] + _BESIDE]
    level = near @ _LEVEL
    far = np.abs(x[rows] - level)
    factor = far / np.abs(near @ _AWAY).max(axis=1)
    return np.array([rows, level, far, factor])[:, factor > OF_NEIGHBOURS]


def _distance(x):
    """Return the distances of samples from the cubic through two samples on each side.

    `x` are the samples, (..., n): the last axis is n rows, and all other axes are kept. The result,
    (..., n - 4), lacks two samples at each end.
    """
    sums = 4 * (x[..., 1:-3] + x[..., 3:-1]) - x[..., :-4] - x[..., 4:]
    return np.abs(x[..., 2:-2] - sums / 6)
