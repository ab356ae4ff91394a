"""What a log holds while it is held still: specific force, attitudes, and the moves between.

A *window* is half a second; a *stop* a few neighbouring windows that are quiet and hold one
attitude; a *move* what lies between two stops. Over a move the gyroscope has to turn gravity from
where the one stop has it to where the other has it: with the rate r as logged, its bias b and a
scale k that is one in a good log,

    u₂ = ∏ exp(-[(r - b) dt / k]×) u₁.

Where a move begins and ends the device rests, so no acceleration of the hand enters.
"""

from itertools import pairwise

import numpy as np

from imuloop.core.rotation import exponential, matrix, prefix_product
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, sums_over
from imuloop.core.sphere import count_attitudes
from imuloop.core.stretches import stretches_of
from imuloop.ingest.thinning import means, thinned

# windows, of averages over at least so long, s
WINDOW, FINE = 0.5, 0.04
# of a log at most twice so many stops, moves and windows are kept, evenly spread
KEPT_STOPS, KEPT_MOVES, KEPT_WINDOWS = 4096, 64, 4096

# a quiet window varies at most so many times as much as the quietest twentieth of a row group
QUIET = 10.0
# gravity's direction in two windows of a stop differs by less, rad; a stop holds so many at most
STILL, LONGEST_STOP = 0.02, 10
# a move turns gravity by at least so much, rad, and lasts no longer, s; so many give a scale
LEAST_TURN, LONGEST_MOVE, LEAST_MOVES = 0.35, 20.0, 3
# the scale is looked for within this factor of what the turns inside the moves say; a move whose
# best scale leaves more of gravity's turn than this share says nothing
NEAR, MOST_LEFT = np.geomspace(0.7, 1.4, 15), 0.25
# standard deviation of a normal distribution, of its median absolute deviation; and of a median,
# of that of a mean
MAD, OF_MEDIAN = 1.4826, 1.2533
# attitudes differ by more than this, rad
APART = 0.17
# windows between two stops at most, and how much farther the force moves, of gravity, than what
# the angular rate turns it, to be a jump
MAX_WINDOWS_BETWEEN_STOPS, UNTURNED = 3, 5.0


def _angle(u, v):
    """Return the angle between unit vectors, rad."""
    return np.arccos(np.clip(u @ v, -1.0, 1.0))


class Stops:
    """Stops and moves of a log, added row group by row group; `gaps` are the rows before a gap."""

    def __init__(self, rate, gaps=()):
        self.gaps = np.asarray(gaps, dtype=int)
        self.rows = max(round(FINE * rate), 1)
        self.fine = max(round(WINDOW * rate / self.rows), 4)
        self.width, self.dt = self.rows * self.fine, self.rows / rate
        # per stop: first row, windows, force, rate; per window: change of the mean rate to the next
        # one and of the fine means, squared
        self.stops, self.changes, self.moves = [np.empty((0, 8))], [np.empty((0, 2))], []
        # largest change of the force without a turn, m/s^2, its row, and the angle that the rate
        # turns meanwhile, rad; largest turn of gravity over a gap, rad, and the row before the gap
        self.jump, self.gap_turn = (0.0, 0, 0.0), (0.0, None)
        self.row = self.windows = self.still = 0

    # a damaged file may hold 1e306
    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def add(self, x):
        """Take in a row group."""
        first, width = self.row, self.width
        self.row += len(x["ax"])
        n = len(x["ax"]) // width
        if n < 2:
            return
        force, rate = (
            np.array([means(x[name][: n * width], self.rows) for name in axes]).reshape(3, n, -1)
            for axes in (ACCELERATION, ANGULAR_RATE)
        )
        centre, turning = force.mean(axis=2), rate.mean(axis=2)
        spread = ((force - centre[:, :, None]) ** 2).sum(axis=(0, 2))
        size = np.linalg.norm(centre, axis=0)
        known = np.isfinite(spread) & np.isfinite(turning.sum(axis=0)) & (size > 0)
        self.windows += int(known.sum())
        if not known.any():
            return
        self.changes.append(_changes(rate, turning)[known[:-1] & known[1:]])
        # what rounding leaves of a force that does not change is as quiet as nothing
        floor = 1e-20 * (size[known] ** 2).min()
        quiet = known & (spread <= QUIET * max(np.quantile(spread[known], 0.05), floor))
        u = centre / np.where(known, size, 1.0)
        together = quiet[1:] & quiet[:-1] & (np.linalg.norm(np.diff(u, axis=1), axis=0) < STILL)
        # windows of one attitude that follow each other; a window alone is no stop
        rests = stretches_of(together) + np.array([0, 1])
        self.still += int(np.diff(rests, axis=1).sum())
        starts = [np.arange(a, b, LONGEST_STOP) for a, b in rests]
        ends = [np.minimum(at + LONGEST_STOP, b) for at, (_, b) in zip(starts, rests, strict=True)]
        if not len(rests):
            return
        stops = np.column_stack([np.concatenate(starts), np.concatenate(ends)])
        windows = np.diff(stops, axis=1)
        both = sums_over(np.vstack([centre, turning]).T, stops) / windows
        self.stops.append(np.hstack([first + stops[:, :1] * width, windows, both]))
        # as of two stops alone a slow turn would pass for it
        bias = np.median(both[:, 3:], axis=0)
        self._judge(stops, u, centre, turning, bias, first)
        half = self.fine // 2
        for (_, a), (b, _) in pairwise(rests):
            turn, gap = _angle(u[:, a - 1], u[:, b]), self._gaps(first, a - 1, b)
            if gap < 0 and turn > LEAST_TURN and (b - a) * self.fine * self.dt < LONGEST_MOVE:
                steps = rate[:, a - 1 : b + 1].reshape(3, -1)[:, half : half - self.fine]
                self.moves.append((u[:, a - 1], u[:, b], (steps.T - bias) * self.dt))

    def _gaps(self, first, i, j):
        """Return the last rows before gaps from windows i to windows j, -1 where there is none."""
        at = np.searchsorted(self.gaps, first + i * self.width)
        rows = np.append(self.gaps, -1)[at]
        return np.where(rows < first + (j + 1) * self.width, rows, -1)

    def _judge(self, stops, u, centre, turning, bias, first):
        """Keep the largest change of the force from stop to stop that no rate goes with."""
        # from the last window to the first one: within a stop a hand may turn slowly
        i, j = stops[:-1, 1] - 1, stops[1:, 0]
        near = j - i <= MAX_WINDOWS_BETWEEN_STOPS + 1
        i, j = i[near], j[near]
        gaps = self._gaps(first, i, j)
        for k in np.flatnonzero(gaps >= 0):
            turn = float(_angle(u[:, i[k]], u[:, j[k]]))
            if turn > self.gap_turn[0]:
                self.gap_turn = turn, int(gaps[k])
        i, j = i[gaps < 0], j[gaps < 0]
        change = np.linalg.norm(centre[:, j] - centre[:, i], axis=0)
        speed = np.linalg.norm(turning - bias[:, None], axis=0)
        angle = sums_over(speed, np.column_stack([i, j + 1])) * self.fine * self.dt
        change[change <= UNTURNED * angle * np.linalg.norm(centre[:, i], axis=0)] = 0.0
        if len(change) and change.max() > self.jump[0]:
            k = change.argmax()
            self.jump = float(change[k]), first + int(j[k]) * self.width, float(angle[k])

    def figures(self, guess=None):
        """Return what the stops show, as `rests` in quality.schema.yaml, None without any.

        `guess` is the scale of the angular rate, as turns inside the moves have it; one if None.
        In place of `jump_s` and `gap_s` are their rows.
        """
        stops = thinned(np.concatenate(self.stops), KEPT_STOPS)
        if not len(stops):
            return None
        force, weight = stops[:, 2:5], stops[:, 1]
        size = np.linalg.norm(force.T, axis=0)
        order = np.argsort(size)
        share = np.cumsum(weight[order]) / weight.sum()
        u = force / size[:, None]
        usual = u[np.argmin(np.linalg.norm((u - np.median(u, axis=0)).T, axis=0))]
        apart = 2 * np.arcsin(np.minimum(np.linalg.norm((u - usual).T, axis=0) / 2, 1))
        changes = thinned(np.concatenate(self.changes), KEPT_WINDOWS)
        changes = np.median(changes, axis=0) if len(changes) else [0.0, 0.0]
        turn_ratio = self.scale(guess)
        jump, row, angle = self.jump
        # a scale that is too small makes turns look as if there were none
        scale = turn_ratio["value"] if turn_ratio else guess or 1.0
        return {
            "share": self.still / self.windows,
            "force": [float(size[order][np.searchsorted(share, q)]) for q in (0.05, 0.5, 0.95)],
            "attitudes": count_attitudes(u, APART),
            "turned": float(apart.max()),
            "turn_ratio": turn_ratio,
            "jump_m_s2": jump if jump > UNTURNED * angle / scale * size.max() else 0.0,
            "jump_row": row,
            "gap_turn": self.gap_turn[0],
            "gap_row": self.gap_turn[1],
            "change": float(np.sqrt(changes[0])),
            "change_share": float(changes[0] / changes[1]) if changes[1] > 0 else None,
        }

    def scale(self, guess=None):
        """Return how far the angular rate turns the device over the moves, beside gravity.

        Near to `guess`: `value`, the median of the moves, its standard error `std`, and `moves`,
        their number. None where too few moves can be explained by any scale.
        """
        near = NEAR * (guess or 1.0)
        moves = thinned(self.moves, KEPT_MOVES)
        found = np.log([k for move in moves if (k := _scale(*move, near))])
        if len(found) < max(LEAST_MOVES, len(moves) / 2):
            return None
        middle = np.median(found)
        value = float(np.exp(middle))
        spread = MAD * np.median(np.abs(found - middle))
        std = float(value * OF_MEDIAN * spread / np.sqrt(len(found)))
        return {"value": value, "std": std, "moves": len(found)}


def _scale(before, after, steps, near):
    """Return the scale that turns gravity over a move from before to after; None if none does."""
    turn = prefix_product(exponential(steps / near[:, None, None]))[:, -1]
    left = np.arccos(np.clip(before @ matrix(turn) @ after, -1.0, 1.0)) ** 2
    i = int(np.argmin(left))
    if not 0 < i < len(near) - 1 or not left[i] < (MOST_LEFT * _angle(before, after)) ** 2:
        return None
    # the square of the angle left is a parabola about the least
    below, at, above = left[i - 1 : i + 2]
    bend = below - 2 * at + above
    away = 0.5 * (below - above) / bend if bend > 0 else 0.0
    return near[i] * (near[1] / near[0]) ** away


def _changes(rate, turning):
    """Return the change of the mean rate to the next window, squared, and what white noise gives.

    White noise gives the mean of n independent values a variance of theirs over n, and twice that
    to a difference; theirs is half the mean square of the difference of neighbours.
    """
    white = (np.diff(rate, axis=2) ** 2).mean(axis=2).sum(axis=0) / rate.shape[2]
    return np.column_stack([(np.diff(turning, axis=1) ** 2).sum(axis=0), white[1:]])
