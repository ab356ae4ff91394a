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
# the first and the last values that are not judged: those with too few each side
EDGE = REACH + 2
_WITHIN = np.arange(-EDGE, EDGE + 1)
# of the distances within REACH; what a value adds to the cubics of the two samples each side is no
# noise of theirs
_AROUND, _NEXT = np.r_[: REACH - 2, REACH + 3 : 2 * REACH + 1], np.r_[REACH - 1 : REACH + 2]


# a damaged file may hold 1e306
@np.errstate(over="ignore", invalid="ignore")
def isolated(x, steps):
    """Return which values of channels are single ones that no body makes, (c, n) as x.

    With r the distance of a value from the cubic through two samples each side,

        |x - cubic through NEAR each side| > max(OF_NEIGHBOURS d, OF_NOISE s, OF_NOISE q),

    d the largest distance of these neighbours from their cubic, s the median of ``|r|`` within
    REACH, as a standard deviation, q the resolution; and at the value and beside it the ``|r|`` of
    every other channel is below MOVES times its own s or q, or MOVES_SHARE of what the spike is.
    The first and the last EDGE values count as none.
    """
    found = np.zeros(x.shape, dtype=bool)
    if x.shape[1] <= 2 * EDGE:
        return found
    for _ in range(PASSES):
        filled = []
        for k, values in enumerate(x):
            # most are none by those next to them already
            size = _distance(values)
            half = size[REACH:-REACH] / 2
            may = half > OF_NOISE * steps[k] / 2
            for d in (-5, -3, 3, 5):
                may &= half > size[REACH + d : len(size) - REACH + d]
            at = np.flatnonzero(may) + EDGE
            near = values[at[:, None] + _BESIDE]
            # nor are those of the rest that are as near as their neighbours, one of these or all
            for rest in (_AWAY[:, :1], _AWAY):
                far = np.abs(values[at] - near @ _LEVEL)
                out = far > OF_NEIGHBOURS * np.abs(near @ rest).max(axis=1)
                at, near, far = at[out], near[out], far[out]
            around = _distance(x[:, at[:, None] + _WITHIN])
            # of a normal e the median of |e| is 0.6745 of its deviation
            noise = np.median(around[..., _AROUND], axis=2) / 0.6745
            noise = np.maximum(noise, steps[:, None])
            own = np.divide(far, noise[k], out=np.zeros_like(far), where=noise[k] > 0)
            moves = around[..., _NEXT].max(axis=2) > np.maximum(MOVES, MOVES_SHARE * own) * noise
            alone = (far > OF_NOISE * noise[k]) & ~np.delete(moves, k, 0).any(axis=0)
            filled.append((k, at[alone], near[alone] @ _LEVEL))
        if not any(len(at) for _, at, _ in filled):
            break
        # seen by the next pass alone
        x = x.copy()
        for k, at, level in filled:
            found[k, at], x[k, at] = True, level
    return found


def _distance(x):
    """Return how far values are from the cubic through two each side, but for two at each end."""
    sums = 4 * (x[..., 1:-3] + x[..., 3:-1]) - x[..., :-4] - x[..., 4:]
    return np.abs(x[..., 2:-2] - sums / 6)
