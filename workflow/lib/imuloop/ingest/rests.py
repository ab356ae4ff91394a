"""What rests and turns of a log show of both sensors together.

A *window* is half a second; a *stop* a few neighbouring windows that are quiet and hold one
attitude; a *move* what lies between two stops. Over a move the gyroscope has to turn gravity from
where the one stop has it to where the other has it: with the rate r as logged, its bias b and a
scale k that is one in a good log,

    u₂ = ∏ exp(-[(r - b) dt / k]×) u₁.

Where a move begins and ends the device rests, so no acceleration of the hand enters.

While a device turns, the direction u of gravity in its axes obeys ``du/dt = u × ω``. Over two
neighbouring windows of T seconds, whose means are u₁ and u₂, this is without approximation

    u₂ - u₁ = ∫ w u × P (r - b) dt

with w rising from 0 to 1 over the first window and falling over the second, and P one of the 48
signed permutations of the axes: the identity in a good log. Gravity tells P alone: which of the two
sensors is at fault it cannot tell, nor whether the accelerometer's three signs are all wrong.

A gyroscope at rest shows its bias and Earth's rotation, and its noise has power at all low
frequencies. Firmware or a logger that follows the mean at rest and takes it away leaves neither:
the mean of W seconds is then smaller than noise of the level found within a second lets it be, or
smaller than Earth's rate. A bias makes both only larger, flicker and drift as well.
"""

from itertools import pairwise, permutations, product

import numpy as np
from scipy.special import chdtr, chdtri

from imuloop.core.gravity import EARTH_RATE
from imuloop.core.rotation import exponential, matrix, prefix_product
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS

# windows of stops and of turns, of averages over at least so long, s
WINDOW, TURN_WINDOW, FINE = 0.5, 0.25, 0.04
# a quiet window varies at most so many times as much as the quietest twentieth of a row group
QUIET = 10.0
# gravity's direction in two windows of a stop differs by less, rad; a stop holds so many at most
STILL, LONGEST_STOP = 0.02, 10
# a move turns gravity by at least so much, rad, and lasts no longer, s; so many give a scale
LEAST_TURN, LONGEST_MOVE, LEAST_MOVES = 0.35, 20.0, 3
# of a log at most twice so many stops, moves, windows, and steps of turns are kept, evenly spread
KEPT_STOPS, KEPT_MOVES, KEPT_WINDOWS, KEPT = 4096, 64, 4096, 4096
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
# a step of a turn turns gravity by at least so much, rad; its force is gravity's within this share
LEAST_STEP, MOST_SHAKEN = 0.1, 0.3
# of a row group about so many steps are used, and so many rests for the bias
TURNS, RESTS = 1024, 256
# steps in which a mapping has to beat the identity, and how many for each that says otherwise
LEAST_STEPS, STEPS_AGAINST = 3, 4
# agreement that a mapping needs, its lead, and the lead that leaves another one possible
AGREEMENT, LEAD, NEAR_BEST = 0.8, 0.05, 0.03
# signed permutations, the identity first
MAPPINGS = np.array(
    [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
    ]
)
# u × r as a sum of products
CROSS = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(2, 0, 1)
# means at rest are of blocks of at least so long (s) and so many rows, of so many parts that tell
# the noise; of so many blocks, a day and a half
BLOCK_TIME, BLOCK_ROWS, PARTS, MOST_BLOCKS = 1.0, 16, 4, 1 << 17
# a block rests where its variances are below so many times those of the quietest quarter
QUIET_BLOCK = 4.0
# what firmware needs until it has the mean does not count: this part of all rests, the first, and
# so many blocks of each
SETTLED, SETTLING = 0.25, 1
# noise of a row spans at least this part of a step, else a mean says little
LEAST_NOISE = 0.5
# power of the means is lacking where chance makes it as small so seldom, with so much room for an
# error of the noise level, and it is below this share
LEAST_CHANCE, ROOM, MOST_SHARE = 1e-5, 1.25, 0.5
# means and pairs of them needed; for Earth's rate, standard errors below a part of it
LEAST_MEANS, LEAST_PAIRS, SIGMAS, EARTH_PART = 24, 32, 6.0, 0.5


class EvenSubsample:
    """Rows of arrays evenly spread over all that were added, at most twice `kept`."""

    def __init__(self, kept):
        self.kept, self.stride, self.seen, self.parts, self.count = kept, 1, 0, [], 0

    def add(self, rows):
        """Take in rows, shape (n, k) or (n,)."""
        # a copy, so that few rows do not hold all others
        self.parts.append(rows[-self.seen % self.stride :: self.stride].copy())
        self.seen, self.count = self.seen + len(rows), self.count + len(self.parts[-1])
        while self.count > 2 * self.kept:
            self.parts, self.stride = [self.rows()[::2]], 2 * self.stride
            self.count = len(self.parts[0])

    def rows(self):
        """Return those kept, in order, as one array."""
        return np.concatenate(self.parts) if self.count else np.empty((0, 0))


def _means(x, rows):
    """Return means of blocks of a few rows: sums of strides, numpy is slow on short axes."""
    return sum(x[..., i::rows] for i in range(rows)) / rows


def _length(v):
    """Return the length of vectors, (3, …)."""
    return np.sqrt((v**2).sum(axis=0))


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
        self.stops, self.changes = EvenSubsample(KEPT_STOPS), EvenSubsample(KEPT_WINDOWS)
        self.moves = EvenSubsample(KEPT_MOVES)
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
            np.array([_means(x[name][: n * width], self.rows) for name in axes]).reshape(3, n, -1)
            for axes in (ACCELERATION, ANGULAR_RATE)
        )
        centre, turning = force.mean(axis=2), rate.mean(axis=2)
        spread, size = _length(force - centre[:, :, None]), _length(centre)
        spread = (spread**2).sum(axis=1)
        known = np.isfinite(spread) & np.isfinite(turning.sum(axis=0)) & (size > 0)
        self.windows += int(known.sum())
        if not known.any():
            return
        self.changes.add(_changes(rate, turning)[known[:-1] & known[1:]])
        # what rounding leaves of a force that does not change is as quiet as nothing
        floor = 1e-20 * (size[known] ** 2).min()
        quiet = known & (spread <= QUIET * max(np.quantile(spread[known], 0.05), floor))
        u = centre / np.where(known, size, 1.0)
        together = quiet[1:] & quiet[:-1] & (_length(np.diff(u, axis=1)) < STILL)
        # runs of windows of one attitude; a window alone is no stop
        edges = np.flatnonzero(np.diff(np.concatenate([[0], together, [0]])))
        runs = edges.reshape(-1, 2) + np.array([0, 1])
        self.still += int(np.diff(runs, axis=1).sum())
        stops = [
            (a, min(a + LONGEST_STOP, end))
            for start, end in runs
            for a in range(start, end, LONGEST_STOP)
        ]
        rows = [
            [first + a * width, b - a, *centre[:, a:b].mean(1), *turning[:, a:b].mean(1)]
            for a, b in stops
        ]
        self.stops.add(np.array(rows).reshape(-1, 8))
        bias = np.median(np.array(rows).reshape(-1, 8)[:, 5:], axis=0) if rows else None
        for (_, a), (b, _) in pairwise(stops):
            # from the last window to the first one: within a stop a hand may turn slowly
            if b - a <= MAX_WINDOWS_BETWEEN_STOPS:
                self._judge(a - 1, b, u, centre, turning, bias, first)
        half = self.fine // 2
        for (_, a), (b, _) in pairwise(runs):
            turn, gap = _angle(u[:, a - 1], u[:, b]), self._gap(first, a - 1, b)
            if gap is None and turn > LEAST_TURN and (b - a) * self.fine * self.dt < LONGEST_MOVE:
                bias = (turning[:, a - 1] + turning[:, b]) / 2
                steps = rate[:, a - 1 : b + 1].reshape(3, -1)[:, half : half - self.fine]
                move = np.empty(1, dtype=object)
                move[0] = u[:, a - 1], u[:, b], (steps.T - bias) * self.dt
                self.moves.add(move)

    def _gap(self, first, i, j):
        """Return the last row before a gap from window i to window j, or None."""
        start, end = first + i * self.width, first + (j + 1) * self.width
        found = self.gaps[np.searchsorted(self.gaps, start) :][:1]
        return int(found[0]) if len(found) and found[0] < end else None

    def _judge(self, i, j, u, centre, turning, bias, first):
        """Keep the largest change of the force from stop to stop that no rate goes with."""
        if (gap := self._gap(first, i, j)) is not None:
            self.gap_turn = max(self.gap_turn, (float(_angle(u[:, i], u[:, j])), gap), key=_first)
            return
        change = _length(centre[:, j] - centre[:, i])
        # with the bias of all stops, as of two of them alone a slow turn would pass for it
        angle = _length(turning[:, i : j + 1] - bias[:, None]).sum() * self.fine * self.dt
        if change > max(self.jump[0], UNTURNED * angle * _length(centre[:, i])):
            self.jump = (float(change), first + int(j) * self.width, float(angle))

    def figures(self, guess=None):
        """Return what the stops show, as `rests` in quality.schema.yaml, None without any.

        `guess` is the scale of the angular rate, as turns inside the moves have it; one if None.
        In place of `jump_s` and `gap_s` are their rows.
        """
        stops = self.stops.rows()
        if not len(stops):
            return None
        force, weight = stops[:, 2:5], stops[:, 1]
        size = _length(force.T)
        order = np.argsort(size)
        share = np.cumsum(weight[order]) / weight.sum()
        u = force / size[:, None]
        usual = u[np.argmin(_length((u - np.median(u, axis=0)).T))]
        apart = 2 * np.arcsin(np.minimum(_length((u - usual).T) / 2, 1))
        changes = np.median(self.changes.rows(), axis=0) if self.changes.count else [0.0, 0.0]
        turn_ratio = self.scale(guess)
        jump, row, angle = self.jump
        # a scale that is too small makes turns look as if there were none
        scale = turn_ratio["value"] if turn_ratio else guess or 1.0
        return {
            "share": self.still / self.windows,
            "force": [float(size[order][np.searchsorted(share, q)]) for q in (0.05, 0.5, 0.95)],
            "attitudes": _attitudes(u),
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
        found = np.log([k for move in self.moves.rows() if (k := _scale(*move, near))])
        if len(found) < max(LEAST_MOVES, self.moves.count / 2):
            return None
        middle = np.median(found)
        value = float(np.exp(middle))
        spread = MAD * np.median(np.abs(found - middle))
        std = float(value * OF_MEDIAN * spread / np.sqrt(len(found)))
        return {"value": value, "std": std, "moves": len(found)}


def _first(pair):
    return pair[0]


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


def _attitudes(u):
    """Return how many of the directions differ by more than `APART`."""
    held = u[:1]
    for each in u[1:]:
        if (held @ each).max() < np.cos(APART):
            held = np.concatenate([held, each[None]])
    return len(held)


class Axes:
    """How well each mapping of the angular rate's axes explains how gravity turns, over a log."""

    def __init__(self, rate):
        self.rows = max(round(FINE * rate), 1)
        self.fine = max(round(TURN_WINDOW * rate / self.rows), 1)
        self.dt = self.rows / rate
        # du, ∫ w u, ∫ w u r of a step; rate of a rest
        self.steps, self.rests = EvenSubsample(KEPT), EvenSubsample(KEPT)
        self.gravity = None

    def add(self, x):
        """Take in a row group."""
        width = self.rows * self.fine
        n = len(x["ax"]) // width
        if n < 2:
            return
        force = np.array([_means(x[name][: n * width], self.rows) for name in ACCELERATION])
        size = _length(force)
        known = size[np.isfinite(size)]
        self.gravity = self.gravity or (np.median(known) if len(known) else None)
        if not self.gravity:
            return
        calm = (np.abs(size / self.gravity - 1) < MOST_SHAKEN).reshape(n, -1).all(axis=1)
        u = (force / np.where(size > 0, size, 1.0)).reshape(3, n, -1)
        change = np.diff(u.mean(axis=2), axis=1)
        angle, calm = _length(change), calm[1:] & calm[:-1]
        rests = _some(np.flatnonzero(calm & (angle < LEAST_STEP / 4)), RESTS)
        turns = _some(np.flatnonzero(calm & (angle > LEAST_STEP)), TURNS)
        rate = [x[name][: n * width].reshape(n, width) for name in ANGULAR_RATE]
        self.rests.add(_finite(np.array([r[rests].mean(axis=1) for r in rate]).T))
        # both windows of a step, one after the other
        both = np.array([np.concatenate([r[turns], r[turns + 1]], axis=1) for r in rate])
        rise = (np.arange(self.fine) + 0.5) / self.fine * self.dt
        weighted = np.concatenate([u[:, turns], u[:, turns + 1]], axis=2)
        weighted *= np.concatenate([rise, rise[::-1]])
        moment = np.einsum("int,jnt->nij", weighted, _means(both, self.rows)).reshape(-1, 9)
        self.steps.add(_finite(np.hstack([change[:, turns].T, weighted.sum(axis=2).T, moment])))

    def fit(self):
        """Return how well the axes fit, as `axes` in quality.schema.yaml; None of too few turns."""
        steps, rests = self.steps.rows(), self.rests.rows()
        if len(steps) < LEAST_STEPS:
            return None
        change = steps[:, :3]
        bias = np.median(rests, axis=0) if len(rests) else np.zeros(3)
        # ∫ w u (r - b), then its share by the cross product for each mapping
        moment = steps[:, 6:].reshape(-1, 3, 3) - steps[:, 3:6, None] * bias
        by_axis = np.einsum("ijk,njl->nkli", CROSS, moment)
        turned = np.einsum("pkl,nkli->pni", MAPPINGS, by_axis)
        size = np.sqrt((turned**2).sum(axis=2))
        # what hardly turns gravity says nothing of the direction
        size = np.maximum(size, 0.1 * np.median(size[0]) + 1e-12) * _length(change.T)
        # a damaged file may hold 1e306
        cosine = np.nan_to_num((turned * change).sum(axis=2) / size)
        agreement = cosine.mean(axis=1)
        best = int(np.argmax(agreement))
        lead = cosine[best] - cosine[0]
        favour, against = int((lead > 0.2).sum()), int((lead < -0.2).sum())
        power, common = (turned[best] ** 2).sum(), (turned[best] * change).sum()
        ratio = np.divide(power, common)
        possible = agreement > agreement[best] - NEAR_BEST
        sure = agreement[best] > AGREEMENT and lead.mean() > LEAD
        fits = None
        if sure and favour >= max(LEAST_STEPS, STEPS_AGAINST * against) and not possible[0]:
            same = (MAPPINGS[possible] == MAPPINGS[best]).all(axis=(0, 2))
            fits = [int(v) for v in (MAPPINGS[best] @ [1, 2, 3]) * same]
        return {
            "agreement": float(agreement[0]),
            "best": float(agreement[best]),
            "ratio": float(ratio) if common > 0 and np.isfinite(ratio) else None,
            "steps": [favour, against],
            "steps_used": len(steps),
            "mapping": fits if fits and any(fits) else None,
        }


def _finite(rows):
    """Return the rows that are finite."""
    return rows[np.isfinite(rows).all(axis=1)]


def _some(at, n):
    """Return n to 2 n of the places, evenly spread."""
    return at[:: max(len(at) // n, 1)]


class RestMeans:
    """Means of the angular rate in blocks of about a second, over a log."""

    def __init__(self, rate):
        part = max(round(BLOCK_TIME * rate), BLOCK_ROWS) // PARTS
        self.rows, self.block_s = part * PARTS, part * PARTS / rate
        # per block: variance of the force; of each rate the variance and the mean of each part
        self.blocks, self.held = [], 0

    def add(self, x):
        """Take in a row group."""
        n = len(x["ax"]) // self.rows
        if not n or self.held >= MOST_BLOCKS:
            return
        columns, force = [], np.zeros(n)
        for name in CHANNELS:
            block = x[name][: n * self.rows].reshape(n, PARTS, -1)
            means, power = block.mean(axis=2), (block**2).mean(axis=(1, 2))
            spread = power - means.mean(axis=1) ** 2
            # what rounding leaves of a channel that does not change
            spread[spread < 1e-12 * power] = 0.0
            if name in ACCELERATION:
                force += spread
            else:
                columns += [spread, means]
        self.blocks.append(np.column_stack([force, *columns]))
        self.held += n

    def figures(self, steps):
        """Return the mean rate at rest beside noise and Earth, as in quality.schema.yaml.

        `steps` are the quantisation steps of the three axes, rad/s, or None. Mean rate and bound
        are None where the rests are too short, all is None where there are none, or no noise.
        """
        if not self.blocks:
            return None
        blocks = np.concatenate(self.blocks)
        force, rates = blocks[:, 0], blocks[:, 1:].reshape(-1, 3, 1 + PARTS)
        spread, parts = rates[:, :, 0], rates[:, :, 1:]
        live = np.isfinite(blocks).all(axis=1) & (spread > 0).all(axis=1)
        if live.sum() < LEAST_PAIRS:
            return None
        rests = live & (force <= QUIET_BLOCK * np.quantile(force[live], 0.25))
        rests &= (spread <= QUIET_BLOCK * np.quantile(spread[live], 0.25, axis=0)).all(axis=1)
        noise = _white(parts[rests], self.block_s)
        least = [(LEAST_NOISE * (step or 0.0)) ** 2 for step in steps]
        coarse = not rests.any() or (np.median(spread[rests], axis=0) < least).any()
        if coarse or not (noise > 0).all():
            return None
        rests[: np.flatnonzero(rests)[int(SETTLED * rests.sum())]] = False
        edges = np.flatnonzero(np.diff(np.concatenate([[0], rests, [0]])))
        runs = [parts[a + SETTLING : b].mean(axis=2) for a, b in edges.reshape(-1, 2)]
        found = {"rate": None, "upper": None, "window_s": None, "noise_share": None}
        tracked, size = False, 1
        while any(len(run) >= size for run in runs):
            means = [r[: len(r) // size * size].reshape(-1, size, 3).mean(axis=1) for r in runs]
            every, window = np.concatenate(means), size * self.block_s
            power, n = (every**2 / noise).sum() * window, every.size
            if n >= LEAST_MEANS:
                found["noise_share"] = min(found["noise_share"] or np.inf, float(power / n))
                tracked |= power < MOST_SHARE * n and chdtr(n, ROOM * power) < LEAST_CHANCE
            # noise of neighbours is not the same, bias and Earth's rate are
            pairs = [m[: len(m) // 2 * 2].reshape(-1, 2, 3) for m in means]
            power = np.concatenate(pairs).prod(axis=1).sum(axis=1)
            if len(power) >= LEAST_PAIRS:
                upper = power.mean() + SIGMAS * power.std(ddof=1) / np.sqrt(len(power))
                rates = np.sqrt(np.maximum([power.mean(), upper], 0.0)).tolist()
                found |= {"rate": rates[0], "upper": rates[1], "window_s": window}
            size *= 2
        if found["upper"] is not None:
            tracked |= found["upper"] < EARTH_PART * EARTH_RATE
        return {**found, "tracked": bool(tracked)}


def _white(parts, block_s):
    """Return the white noise of each axis, (rad/s)^2/Hz: the least of two near averaging times."""
    if not len(parts):
        return np.zeros(3)
    halves = parts.reshape(*parts.shape[:2], 2, -1).mean(axis=3)
    # of a difference of two means the variance is twice theirs; medians pass over knocks
    return np.min(
        [
            np.median(np.diff(means, axis=2) ** 2, axis=(0, 2)) * block_s / means.shape[2]
            for means in (parts, halves)
        ],
        axis=0,
    ) / (2 * chdtri(1, 0.5))
