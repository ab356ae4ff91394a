"""Rests in the hand: the device keeps its attitude except for tremor and sway."""

import numpy as np

from imuloop.core.stretches import lengths, stretches_of
from imuloop.segment.static_detector import long_enough
from imuloop.segment.windows import sliding_statistics

# a tremor, 6 Hz and more, takes itself out of a mean rate over so long, s
WINDOW = 0.5
# mean rate below which a hand holds a device, and rates up to which it sways in between, rad/s
HOLDS, SWAYS = 0.03, (0.08, 0.03)
# a hand that pauses amid a turn is no rest, s
SHORTEST = 2.0
# share of such a rest from which on its parts that lie still are all there is to it
MOST = 0.8


def held_rests(w, stretches, step, bias, sway, shortest):
    """Return the stretches in which a hand holds the device, (m, 2).

    By the mean rate over `WINDOW`, less the bias, (3,): from where it is first below `HOLDS` to
    where it is for the last time before it rises above `sway`, rad/s. None is shorter than
    `SHORTEST` and `shortest`, s. Takes angular rate, rad/s, (3, n), the stretches between long
    gaps, and the step of time, s.
    """
    width, rests = max(2, round(WINDOW / step)), []
    for i, j in stretches:
        if j - i < width:
            continue
        mean, _ = sliding_statistics(w[:, i:j].T, width)
        rate = np.linalg.norm(mean - bias, axis=1)
        for a, b in stretches_of(rate <= sway):
            holds = a + np.flatnonzero(rate[a:b] <= HOLDS)
            if len(holds):
                rests.append([i + holds[0], i + holds[-1] + 1])
    rests = np.array(rests, dtype=int).reshape(-1, 2)
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
