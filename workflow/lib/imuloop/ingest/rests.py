"""The rests of a log and the moves between them, for the checks of its units.

A *window* is half a second. A *stop* is a few neighbouring windows that are quiet and have one
attitude. A *move* lies between two stops. It turns gravity on the axes of the device from the
direction u₁ at the first stop to u₂ at the second one. With the angular rate r as logged, its bias
b and its scale k, which is 1 in a good log, the product over the steps dt of the move is

    u₂ = ∏ exp(-[(r - b) dt / k]×) u₁.

The device rests where a move begins and ends, so no acceleration by the hand enters.
"""

from itertools import pairwise

import numpy as np

from imuloop.core.gaps import gap_limit
from imuloop.core.rotation import exponential, matrix, prefix_product
from imuloop.core.samples import CHANNELS
from imuloop.core.stretches import stretches_of
from imuloop.ingest.axes import TURN_WINDOW, fit_axes

# length of a window, and length of the means in it, s
WINDOW, FINE = 0.5, 0.04
# a window is quiet if its variance is at most this multiple of the 5 % quantile of all variances
QUIET = 10.0
# largest turn of gravity from window to window of a stop, rad
STILL = 0.02
# least turn of gravity in a move, rad, and longest move, s
LEAST_TURN, LONGEST_MOVE = 0.35, 20.0
# least number of moves for a scale, and most moves of a long log that are used
LEAST_MOVES, MOST_MOVES = 3, 64
# scales that are tried, as multiples of a guess; a move is left out if with its best scale the
# residual exceeds this share of its turn
NEAR, MOST_LEFT = np.geomspace(0.7, 1.4, 15), 0.25


def measure_turns(x, t):
    """Return the entries ``axes`` and ``rests`` of quality.json, a dict or None each.

    They are the results of `fit_axes`, whether both sensors have the same axes, and of
    `measure_rests`, figures of the rests. `x` are the channels of n rows, SI, (n,) by name, and `t`
    are the times of the rows, s, (n,).
    """
    steps = np.diff(t)
    # in a longer gap the device may be turned; shorter ones make the rate less than the usual step
    gaps = np.flatnonzero(steps > max(gap_limit(np.median(steps)), TURN_WINDOW))
    rate = (len(steps) - len(gaps)) / (steps.sum() - steps[gaps].sum())
    rows = max(round(FINE * rate), 1)
    count = len(t) // rows
    means = np.array([x[name][: count * rows].reshape(-1, rows).mean(axis=1) for name in CHANNELS])
    means[:, gaps[gaps < count * rows] // rows] = np.nan
    axes = fit_axes(means, rows / rate)
    return axes, measure_rests(means, rows / rate, axes and axes["ratio"])


def angle_between(u, v):
    """Return the angles between unit vectors, rad, a float or (n,).

    `u` and `v` are the vectors, (3,) for one, or (3, n) for n of them.
    """
    return np.arccos(np.clip((u * v).sum(axis=0), -1.0, 1.0))


def measure_rests(means, step, guess=None):
    """Return figures of the stops, the entry ``rests`` of quality.json; None if there is no stop.

    A stop is a few neighbouring windows of `WINDOW` s that are quiet and have one attitude.

    Parameters
    ----------
    means : array, shape (6, m)
        Specific force x, y, z, m/s^2, and angular rate x, y, z, rad/s: m successive means.
        Not-a-number at a gap.
    step : float
        Time over which each mean is taken, s.
    guess : float, optional
        First estimate of the scale k of the angular rate, by `fit_axes`.

    Returns
    -------
    dict or None
        ``share`` is the share of the windows that lie in stops. ``force`` has the quantiles 0.05,
        0.5 and 0.95 of the size of the specific force in these windows, m/s^2. ``turned`` is the
        largest angle between gravity in one of them and its usual direction in the log, rad.
        ``turn_ratio`` is the result of `turn_ratio`. ``change`` is the median change of the mean
        rate from window to window, rad/s, and ``change_share`` its square over the part that white
        noise causes, or None if this part is zero.
    """
    fine = max(round(WINDOW / step), 4)
    count = means.shape[1] // fine
    force, rate = means[:, : count * fine].reshape(2, 3, count, fine)
    centre, turning = force.mean(axis=2), rate.mean(axis=2)
    spread, size = force.var(axis=2).sum(axis=0) * fine, np.linalg.norm(centre, axis=0)
    whole = np.isfinite(spread) & np.isfinite(turning.sum(axis=0)) & (size > 0)
    if count < 2 or not whole.any():
        return None
    # by rounding, the variance of a constant force is small, not zero
    most = QUIET * np.quantile(spread[whole], 0.05) + 1e-20 * size**2
    quiet = whole & (spread <= most)
    u = centre / size
    together = quiet[1:] & quiet[:-1] & (np.linalg.norm(np.diff(u, axis=1), axis=0) < STILL)
    stops = stretches_of(together) + np.array([0, 1])
    if not len(stops):
        return None
    # indices of the windows in stops
    at = np.flatnonzero(np.append(together, False) | np.append(False, together))
    bias = np.median(turning[:, at], axis=1)
    moves, half = [], fine // 2
    for (_, a), (b, _) in pairwise(stops):
        rates = rate[:, a - 1 : b + 1].reshape(3, -1)[:, half : half - fine]
        far = angle_between(u[:, a - 1], u[:, b]) > LEAST_TURN
        if far and (b - a) * fine * step < LONGEST_MOVE and np.isfinite(rates).all():
            moves.append((u[:, a - 1], u[:, b], (rates.T - bias) * step))
    change, white = np.median(_changes(rate, turning)[:, whole[1:] & whole[:-1]], axis=1)
    force, v = np.sort(size[at]), u[:, at]
    usual = v[:, np.linalg.norm(v - np.median(v, axis=1, keepdims=True), axis=0).argmin()]
    return {
        "share": len(at) / int(whole.sum()),
        "force": [float(force[int(q * len(at))]) for q in (0.05, 0.5, 0.95)],
        "turned": float(angle_between(v, usual[:, None]).max()),
        "turn_ratio": turn_ratio(moves[:: len(moves) // MOST_MOVES + 1], NEAR * (guess or 1.0)),
        "change": float(np.sqrt(change)),
        "change_share": float(change / white) if white > 0 else None,
    }


def turn_ratio(moves, scales):
    """Return the scale of the angular rate by moves: turns by it over turns of gravity, or None.

    A move is a motion from one rest to the next.

    Parameters
    ----------
    moves : list of tuple
        For each move, the directions of gravity before and after it, (3,) each, and the rotation
        vectors of the n steps between, rad, (n, 3).
    scales : array_like, shape (s,)
        The s scales that are tried for each move.

    Returns
    -------
    dict or None
        `value`, the median of the scales of the moves, its standard error `std`, and the number
        `moves` of moves with a scale. None if too few moves have one.
    """
    logs = np.log([scale for move in moves if (scale := _scale(*move, scales))])
    if len(logs) < max(LEAST_MOVES, len(moves) / 2):
        return None
    middle = np.median(logs)
    value = float(np.exp(middle))
    # 1.4826 median distances from the median are the standard deviation of a normal distribution,
    # and the median has 1.2533 times the standard error of the mean
    spread = 1.4826 * 1.2533 * np.median(np.abs(logs - middle))
    return {"value": value, "std": float(value * spread / np.sqrt(len(logs))), "moves": len(logs)}


def _scale(before, after, steps, scales):
    """Return the scale k of the angular rate with which a move turns gravity as it did, or None.

    `before` and `after` are the directions of gravity, on axes of the device, at the start and the
    end of the move, unit vectors (3,). `steps` are the rotation vectors of the n steps of the move,
    rad, (n, 3); they are divided by k. `scales` are the s values of k that are tried, (s,); the
    result is interpolated between them. It is None if the best of them is the first or the last. It
    is None, too, if with the best one gravity ends off `after` by more than the share `MOST_LEFT`
    of the angle from `before` to `after`.
    """
    turn = prefix_product(exponential(steps / scales[:, None, None]))[:, -1]
    rest = np.arccos(np.clip(before @ matrix(turn) @ after, -1.0, 1.0)) ** 2
    i = int(np.argmin(rest))
    most = (MOST_LEFT * angle_between(before, after)) ** 2
    if not 0 < i < len(scales) - 1 or not rest[i] < most:
        return None
    # the square of the remaining angle is a parabola about its minimum
    below, at, above = rest[i - 1 : i + 2]
    bend = below - 2 * at + above
    away = 0.5 * (below - above) / bend if bend > 0 else 0.0
    return scales[i] * (scales[1] / scales[0]) ** away


def _changes(rate, turning):
    """Return the squared changes of the mean rate between windows, and their part by noise, (2, n).

    The first row has the n squared changes between n + 1 successive windows, (rad/s)². The second
    has the part of each that white noise causes on average. `rate` has the k angular rates of the
    three axes in each window, rad/s, (3, n + 1, k), and `turning` their means, (3, n + 1). White
    noise of variance v gives the mean of k values the variance v/k, and the difference of two such
    means twice that. v is half the mean square of the differences between neighbouring values.
    """
    white = (np.diff(rate, axis=2) ** 2).mean(axis=2).sum(axis=0) / rate.shape[2]
    return np.array([(np.diff(turning, axis=1) ** 2).sum(axis=0), white[1:]])
