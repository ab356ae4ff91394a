"""Spikes: single samples that no motion of the device makes.

A turn is smooth, and a knock has several samples or shows on several axes. So a sample is a spike
where its neighbours agree with each other, it is far from them, and no other channel moves there.
"""

import numpy as np

# samples on each side that a cubic is laid through, and samples on each side that show the noise
NEAR, REACH = 4, 16
# a spike is so many times farther from the cubic than any neighbour, and so many times the noise;
# jumps of good sensors come to 10
OF_NEIGHBOURS, OF_NOISE = 10.0, 15.0
# another channel moves where it is off its own cubic by so many times its noise (beside 169 knocks
# of a single sample in 3.3 million measured rows one comes to 7 at least), and by this share of
# the spike's own multiple, as chance alone now and then comes to 7
MOVES, MOVES_SHARE = 6.0, 0.01
# a spike on several channels at once jumps so many times as far as any sample near it: a knock on
# the table comes to 17
FAR_JUMP = 20.0
# of two spikes near to each other the larger hides the smaller until it is replaced
PASSES = 3

_BESIDE = np.r_[-NEAR:0, 1 : NEAR + 1]
_POWERS = np.vander(_BESIDE, 4, increasing=True).astype(float)
# from neighbours to the value of their cubic at the sample, and to their distances from the cubic
_LEVEL = np.linalg.pinv(_POWERS)[0]
_AWAY = np.eye(2 * NEAR) - _POWERS @ np.linalg.pinv(_POWERS)
# the first and the last samples, which have too few neighbours, are not judged
_EDGE = REACH + 2
_WITHIN = np.arange(-_EDGE, _EDGE + 1)
# distances that show the noise, without those that the sample itself enters; and those beside it
_AROUND, _NEXT = np.r_[: REACH - 2, REACH + 3 : 2 * REACH + 1], np.r_[REACH - 1 : REACH + 2]


def isolated(x, steps):
    """Return the rows and the channels of spikes that are on one channel alone, two (k,) of int.

    With r the distance of a sample from the cubic through two samples on each side, a spike has

        |x - cubic through NEAR on each side| > max(OF_NEIGHBOURS d, OF_NOISE s, OF_NOISE q),

    d the largest distance of these neighbours from their cubic, s the standard deviation that the
    median of ``|r|`` within REACH gives, and q the quantisation step; and no other channel moves.

    Parameters
    ----------
    x : array_like, shape (c, n)
        Channels, or a list of c of them.
    steps : array_like, shape (c,)
        Quantisation steps, 0 where a channel has none.
    """
    x, steps, found = list(x), np.asarray(steps), []
    for _ in range(PASSES if len(x[0]) > 2 * _EDGE else 0):
        rows, level, judged = [], [], []
        for values, step in zip(x, steps, strict=True):
            # most samples are none already beside the samples three and five from them
            size = _distance(values)
            candidate = size[REACH:-REACH] > OF_NOISE * step
            for d in (-5, -3, 3, 5):
                candidate &= size[REACH:-REACH] > 2 * size[REACH + d : len(size) - REACH + d]
            at = np.flatnonzero(candidate) + _EDGE
            near = values[at[:, None] + _BESIDE]
            far = np.abs(values[at] - near @ _LEVEL)
            out = far > OF_NEIGHBOURS * np.abs(near @ _AWAY).max(axis=1)
            rows.append(at[out])
            level.append(near[out] @ _LEVEL)
            judged.append(far[out])
        k = np.repeat(np.arange(len(x)), [len(at) for at in rows])
        at, level, far = map(np.concatenate, (rows, level, judged))
        around = _distance(np.array([values[at[:, None] + _WITHIN] for values in x]))
        # the median of |e| is 0.6745 of the standard deviation of a normal e
        noise = np.maximum(np.median(around[..., _AROUND], axis=2) / 0.6745, steps[:, None])
        own = noise[k, np.arange(len(k))]
        moves = around[..., _NEXT].max(axis=2) > np.maximum(MOVES, MOVES_SHARE * far / own) * noise
        moves[k, np.arange(len(k))] = False
        alone = (far > OF_NOISE * own) & ~moves.any(axis=0)
        found += zip(at[alone], k[alone], strict=True)
        if not alone.any():
            break
        for j in set(k[alone]):
            x[j] = x[j].copy()
            x[j][at[alone & (k == j)]] = level[alone & (k == j)]
    return np.array(sorted(found, key=lambda each: each[::-1]), dtype=int).reshape(-1, 2).T


def _distance(x):
    """Return how far samples, without two at each end, are from the cubic through two beside."""
    sums = 4 * (x[..., 1:-3] + x[..., 3:-1]) - x[..., :-4] - x[..., 4:]
    return np.abs(x[..., 2:-2] - sums / 6)


def count_jumps(x, step):
    """Return the number of samples of a channel, (n,), that jump far away and back again.

    The jumps are `FAR_JUMP` times the largest of those within half of REACH samples and the step.
    """
    size, up, reach = np.abs(np.diff(x)), x[1:] > x[:-1], REACH // 2
    far = size > FAR_JUMP * max(step, np.median(size[::REACH])) if len(x) > REACH else size < 0
    at = np.flatnonzero(far[1:] & far[:-1] & (up[1:] != up[:-1])) + 1
    at = at[(at > reach) & (at < len(x) - reach - 1)]
    near = np.r_[-reach - 1 : -1, 1 : reach + 1]
    jump = np.minimum(size[at - 1], size[at])
    return int(np.count_nonzero(jump > FAR_JUMP * size[at[:, None] + near].max(axis=1, initial=0)))
