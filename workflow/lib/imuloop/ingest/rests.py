"""The rests of a log: specific force and attitudes while the device is still, and moves between.

A *window* is half a second. A *stop* is a few neighbouring windows that are quiet and have one
attitude. A *move* lies between two stops. It turns gravity in the axes of the device from the
direction u₁ at the first stop to u₂ at the second one. With the angular rate r as logged, its bias
b and its scale k, which is 1 in a good log,

    u₂ = ∏ exp(-[(r - b) dt / k]×) u₁.

The device rests where a move begins and ends, so no acceleration by the hand enters.
"""

from itertools import pairwise

import numpy as np

from imuloop.core.rotation import exponential, matrix, prefix_product
from imuloop.core.samples import CHANNELS, sums_over
from imuloop.core.sphere import count_attitudes
from imuloop.core.stretches import stretches_of
from imuloop.ingest.axes import AGREEMENT, KEPT, fit_axes

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
# least angle between two attitudes, rad
APART = 0.17
# the force jumps between two windows of stops if at most this number of windows lies between them,
# and if it changes by more than this multiple of the change that the angular rate explains
WINDOWS_BETWEEN, UNTURNED = 3, 5.0


def measure_turns(x, rate, t, gaps=()):
    """Return the figures `axes` and `rests` in quality.schema.yaml.

    The first is about the axes of the sensors, the second about the stops. `x` are the channels,
    (n,) by name, `rate` is their rate, Hz, `t` are the times of the rows, s, (n,), and `gaps` are
    the rows before gaps.
    """
    rows = max(round(FINE * rate), 1)
    parts = [x[name][: len(t) // rows * rows].reshape(-1, rows) for name in CHANNELS]
    means = np.array([np.einsum("ij->i", part) / rows for part in parts])
    axes = fit_axes(means, rows / rate)
    guess = axes["ratio"] if axes and axes["best"] > AGREEMENT else None
    return axes, measure_rests(means, rows, rows / rate, t, gaps, guess)


def angle_between(u, v):
    """Return the angle between unit vectors, (3,) or (3, n), rad."""
    return np.arccos(np.clip((u * v).sum(axis=0), -1.0, 1.0))


def measure_rests(means, rows, step, t, gaps, guess=None):
    """Return the figures of the stops, `rests` in quality.schema.yaml; None if there is no stop.

    Parameters
    ----------
    means : array, shape (6, m)
        Specific force, m/s^2, and angular rate, rad/s, as means of `rows` rows, `step` s each.
    t : array_like, shape (n,)
        Time of each row, s.
    gaps : array_like of int
        The rows before gaps.
    guess : float, optional
        Scale of the angular rate, estimated from turns inside moves.
    """
    fine = max(round(WINDOW / step), 4)
    count, width = means.shape[1] // fine, fine * rows
    force, rate = means[:, : count * fine].reshape(2, 3, count, fine)
    centre, turning = force.mean(axis=2), rate.mean(axis=2)
    spread, size = force.var(axis=2).sum(axis=0) * fine, np.linalg.norm(centre, axis=0)
    known = np.isfinite(spread) & np.isfinite(turning.sum(axis=0)) & (size > 0)
    if count < 2 or not known.any():
        return None
    # by rounding, the variance of a constant force is small, not zero
    floor = 1e-20 * (size[known] ** 2).min()
    quiet = known & (spread <= QUIET * max(np.quantile(spread[known], 0.05), floor))
    u = centre / np.where(known, size, 1.0)
    together = quiet[1:] & quiet[:-1] & (np.linalg.norm(np.diff(u, axis=1), axis=0) < STILL)
    rests = stretches_of(together) + np.array([0, 1])
    if not len(rests):
        return None
    # indices of the windows in stops
    at = np.flatnonzero(np.append(together, False) | np.append(False, together))
    bias = np.median(turning[:, at], axis=1)

    def has_gap(i, j):
        """Return whether there is a gap in the windows from i to j."""
        return np.searchsorted(gaps, i * width) < np.searchsorted(gaps, (j + 1) * width)

    moves, half = [], fine // 2
    for (_, a), (b, _) in pairwise(rests):
        far = angle_between(u[:, a - 1], u[:, b]) > LEAST_TURN
        if far and not has_gap(a - 1, b) and (b - a) * fine * step < LONGEST_MOVE:
            rates = rate[:, a - 1 : b + 1].reshape(3, -1)[:, half : half - fine]
            moves.append((u[:, a - 1], u[:, b], (rates.T - bias) * step))
    ratio = turn_ratio(moves[:: len(moves) // MOST_MOVES + 1], NEAR * (guess or 1.0))
    scale = ratio["value"] if ratio else guess or 1.0

    # pairs of a window of a stop and the next such window, if it is near
    i, j = at[:-1], at[1:]
    i, j = i[j - i <= WINDOWS_BETWEEN + 1], j[j - i <= WINDOWS_BETWEEN + 1]
    speed = np.linalg.norm(turning - bias[:, None], axis=0) * fine * step / scale
    turned = sums_over(speed, np.column_stack([i, j + 1])) * size[i]
    jump = np.linalg.norm(centre[:, j] - centre[:, i], axis=0)
    jump[has_gap(i, j) | (jump <= UNTURNED * turned)] = 0.0
    both = known[1:] & known[:-1]
    change, white = np.median(_changes(rate, turning)[:, both], axis=1)

    force, v = np.sort(size[at]), u[:, at]
    usual = v[:, np.linalg.norm(v - np.median(v, axis=1, keepdims=True), axis=0).argmin()]
    return {
        "share": len(at) / int(known.sum()),
        "force": [float(force[int(q * len(at))]) for q in (0.05, 0.5, 0.95)],
        "attitudes": count_attitudes(v.T[:: len(at) // KEPT + 1], APART),
        "turned": float(angle_between(v, usual[:, None]).max()),
        "turn_ratio": ratio,
        "jump_m_s2": float(jump.max()),
        "jump_s": float(t[j[jump.argmax()] * width]),
        "change": float(np.sqrt(change)),
        "change_share": float(change / white) if white > 0 else None,
    }


def turn_ratio(moves, scales):
    """Return the ratio of turns by the angular rate to turns of gravity over moves.

    Parameters
    ----------
    moves : list of tuple
        Directions of gravity before and after the move, (3,), and the rotation vectors between
        them, rad, (n, 3).
    scales : array_like, shape (s,)
        Scales that are tried.

    Returns
    -------
    dict or None
        `value`, the median of the scales of the moves, its standard error `std`, and the number
        `moves` of moves with a scale. None if too few moves have one.
    """
    found = np.log([k for move in moves if (k := _scale(*move, scales))])
    if len(found) < max(LEAST_MOVES, len(moves) / 2):
        return None
    middle = np.median(found)
    value = float(np.exp(middle))
    # 1.4826 median distances from the median are the standard deviation of a normal distribution,
    # and the median has 1.2533 times the standard error of the mean
    spread = 1.4826 * 1.2533 * np.median(np.abs(found - middle))
    return {"value": value, "std": float(value * spread / np.sqrt(len(found))), "moves": len(found)}


def _scale(before, after, steps, scales):
    """Return the scale with which a move turns gravity from `before` to `after`, or None.

    `before` and `after` are directions of gravity, (3,). `steps` are the rotation vectors between
    them, rad, (n, 3). `scales` are the scales that are tried, (s,). The result is None if the best
    of these is the first or last one, or leaves more than `MOST_LEFT` of the turn.
    """
    turn = prefix_product(exponential(steps / scales[:, None, None]))[:, -1]
    left = np.arccos(np.clip(before @ matrix(turn) @ after, -1.0, 1.0)) ** 2
    i = int(np.argmin(left))
    most = (MOST_LEFT * angle_between(before, after)) ** 2
    if not 0 < i < len(scales) - 1 or not left[i] < most:
        return None
    # the square of the remaining angle is a parabola about its minimum
    below, at, above = left[i - 1 : i + 2]
    bend = below - 2 * at + above
    away = 0.5 * (below - above) / bend if bend > 0 else 0.0
    return scales[i] * (scales[1] / scales[0]) ** away


def _changes(rate, turning):
    """Return the squared change of the mean rate from window to window, and its noise, (2, n).

    `rate` are the k means within each window, (3, n + 1, k), and `turning` their means, (3, n + 1).
    White noise of variance v gives the mean of k values the variance v / k, and a difference of two
    such means twice that. v is half the mean square of the difference of neighbouring values.
    """
    white = (np.diff(rate, axis=2) ** 2).mean(axis=2).sum(axis=0) / rate.shape[2]
    return np.array([(np.diff(turning, axis=1) ** 2).sum(axis=0), white[1:]])
