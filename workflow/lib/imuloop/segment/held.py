"""Rests in the hand: the device keeps its attitude except for tremor and sway."""

import numpy as np

from imuloop.core.stretches import lengths, stretches_of
from imuloop.segment.static_detector import long_enough
from imuloop.segment.windows import sliding_statistics

# a tremor, 6 Hz and more, takes itself out of a mean rate over so long, s
WINDOW = 0.5
# mean rate up to which a hand holds a device, rad/s
HOLDS = 0.03
# a hand that pauses amid a turn is no rest, s
SHORTEST = 2.0
# share of such a rest from which on its parts that lie still are all there is to it
MOST = 0.8


def held_rests(w, stretches, step, bias, shortest):
    """Return the stretches in which a hand holds the device, (m, 2).

    There the mean rate over `WINDOW`, less the bias, (3,), is up to `HOLDS`. None is shorter than
    `SHORTEST` and `shortest`, s. Takes angular rate, rad/s, (3, n), the stretches between long
    gaps, and the step of time, s.
    """
    width, rests = max(2, round(WINDOW / step)), [np.empty((0, 2), dtype=int)]
    for i, j in stretches[lengths(stretches) >= width]:
        mean, _ = sliding_statistics(w[:, i:j].T, width)
        rests.append(i + stretches_of(np.linalg.norm(mean - bias, axis=1) <= HOLDS))
    rests = np.concatenate(rests)
    return rests[long_enough(rests, max(SHORTEST, shortest), step)]


def united(still, held):
    """Return rests on a support and in the hand in order, (m, 2), and which are in the hand, (m,).

    One in the hand takes the place of rests that are a part of it, unless they are most of it.
    """
    ends, starts = (
        pick(still[:, None, k], held[:, k]) for pick, k in ((np.minimum, 1), (np.maximum, 0))
    )
    shared = np.maximum(ends - starts, 0)
    reaches_out = (shared > 0) & (2 * shared < lengths(still)[:, None])
    taken = (shared.sum(axis=0) < MOST * lengths(held)) & ~reaches_out.any(axis=0)
    kept = ~shared[:, taken].any(axis=1)
    rests = np.concatenate([still[kept], held[taken]])
    order = np.argsort(rests[:, 0])
    return rests[order], (np.arange(len(rests)) >= kept.sum())[order]


def sways(w, rests, bias, step):
    """Return the root mean square of the turns from the mean attitude of each rest, rad, (m,).

    About all axes: one about the vertical does not tilt, but looks like a bias as well. Arguments
    as in `held_rests`, and ranges of samples, (m, 2).
    """
    turned = (np.cumsum((w[:, i:j].T - bias) * step, axis=0) for i, j in rests)
    return np.array([np.sqrt(x.var(axis=0).sum()) for x in turned])
