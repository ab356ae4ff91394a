"""Single samples that no body makes: a fault of the wire or the logger, dropped as lost samples.

A turn is smooth, and a knock has several samples or shows on several axes: a value counts where its
neighbours agree with each other, it is far from them, and no other channel moves beside it.
"""

import numpy as np

# samples each side that a cubic is laid through, and that the local noise is of
NEAR, REACH = 4, 16
# how many times farther from the cubic than any neighbour, and how many times the noise there, or
# steps of resolution: jumps of good sensors come to 10
OF_NEIGHBOURS, OF_NOISE = 10.0, 15.0
# a value is judged by as many samples each side, and these by their own neighbours
HALO = 2 * REACH
# another channel moves where it is so many times its noise from its neighbours' cubic (beside 169
# knocks of a single sample, of 3.3 million measured rows, one comes to 7 at least), and at least
# this share of what the spike is times its own: chance alone comes to 7 now and then
MOVES, MOVES_SHARE = 6.0, 0.01
# of values near to each other the larger hides the smaller until it is filled
PASSES = 3

_BESIDE = np.r_[-NEAR:0, 1 : NEAR + 1]
_POWERS = np.vander(_BESIDE, 4, increasing=True).astype(float)
# takes neighbours to where their cubic is at the value, and to how far they are from it
_LEVEL = np.linalg.pinv(_POWERS)[0]
_AWAY = np.eye(2 * NEAR) - _POWERS @ np.linalg.pinv(_POWERS)
# what a value adds to the cubics of the two samples each side is no noise of theirs
_AROUND = np.r_[-REACH:-2, 3 : REACH + 1]


# a damaged file may hold 1e306
@np.errstate(over="ignore", invalid="ignore")
def isolated(x, steps):
    """Return which values of channels are single ones that no body makes, (c, n) as x.

    With r the distance of a value from the cubic through two samples each side,

        |x - cubic through NEAR each side| > max(OF_NEIGHBOURS d, OF_NOISE s, OF_NOISE q),

    d the largest distance of these neighbours from their cubic, s the median of ``|r|`` within
    REACH, as a standard deviation, q the resolution; and at the value and beside it the ``|r|`` of
    every other channel is below MOVES times its own s or q, or MOVES_SHARE of what the spike is.
    The first and the last REACH values count as none.
    """
    x, found = np.array(x, dtype=float), np.zeros(np.shape(x), dtype=bool)
    n = x.shape[1]
    if n <= 2 * REACH:
        return found
    for _ in range(PASSES):
        before = found.sum()
        away = np.zeros(x.shape)
        for each, values in zip(away, x, strict=True):
            sums = 4 * (values[1:-3] + values[3:-1]) - values[:-4] - values[4:]
            np.abs(values[2:-2] - sums / 6, out=each[2:-2])
        for k, values in enumerate(x):
            # most are none by those next to them already
            half = away[k, REACH : n - REACH] / 2
            may = half > OF_NOISE * steps[k] / 2
            for d in (-5, -3, 3, 5):
                may &= half > away[k, REACH + d : n - REACH + d]
            at = np.flatnonzero(may) + REACH
            near = values[at[:, None] + _BESIDE]
            level = near @ _LEVEL
            far = np.abs(values[at] - level)
            # nor are those of the rest that are as near as their neighbours
            out = far > OF_NEIGHBOURS * np.abs(near @ _AWAY).max(axis=1)
            at, far, level = at[out], far[out], level[out]
            # of a normal e the median of |e| is 0.6745 of its deviation
            noise = np.median(away[:, at[:, None] + _AROUND], axis=2) / 0.6745
            noise = np.maximum(noise, steps[:, None])
            beside = away[:, at[:, None] + np.r_[-1:2]].max(axis=2)
            own = np.divide(far, noise[k], out=np.zeros_like(far), where=noise[k] > 0)
            others = np.delete(beside > np.maximum(MOVES, MOVES_SHARE * own) * noise, k, 0)
            alone = (far > OF_NOISE * noise[k]) & ~others.any(axis=0)
            found[k, at[alone]] = True
            # seen by the next pass alone
            values[at[alone]] = level[alone]
        if found.sum() == before:
            break
    return found
