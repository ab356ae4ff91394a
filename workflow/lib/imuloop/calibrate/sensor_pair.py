"""Both sensors of a device, at its poses and in the moves between: one model, noise and fit."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.accelerometer import AccelerometerModel
from imuloop.calibrate.determined import (
    accelerometer_lost,
    accelerometer_undetermined,
    gyroscope_lost,
    gyroscope_undetermined,
)
from imuloop.calibrate.gyroscope import GyroscopeModel, cross_matrix, tangents
from imuloop.calibrate.least_squares import Solution, fit
from imuloop.calibrate.noise_components import Component, likely_sizes, total
from imuloop.calibrate.raw_units import as_logged, in_raw_units
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import Effect, effect_design
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.rotation import matrix
from imuloop.core.samples import ANGULAR_RATE, CHANNELS, SENSORS

# parameters of both base models, the accelerometer's first
BASES = {"accelerometer": accelerometer.NAMES, "gyroscope": gyroscope.NAMES}
FORCE = len(accelerometer.NAMES)
COUNT = FORCE + len(gyroscope.NAMES)
# kinds of residuals: SI unit, components, and the sensor whose they are
KINDS = {
    "gravity_norm": ("m/s^2", 1),
    "pose_rate": ("rad/s", 3),
    "rotation": ("rad", 2),
    "velocity_vertical": ("m/s", 1),
    "velocity_horizontal": ("m/s", 2),
}
OF_SENSOR = {"accelerometer": ("gravity_norm",), "gyroscope": ("pose_rate", "rotation")}
VELOCITY = ("velocity_vertical", "velocity_horizontal")
# standard deviation of the error that is foreseen of turns that were sampled too slowly, over it
ALIASED_TO = 0.2


@dataclass(frozen=True)
class Kind:
    """A kind of effect, a class of the library, on one sensor."""

    cls: type
    sensor: str

    def __getattr__(self, name):
        """Return an attribute of the class: its name, its limit, what hides it."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.cls, name)


@dataclass(frozen=True)
class OfSensor:
    """An effect of one of two sensors, which are fitted together and may both have it."""

    effect: Effect
    sensor: str

    def __getattr__(self, name):
        """Return an attribute of the effect: its name, its parameters, what it needs."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.effect, name)

    @property
    def kind(self):
        """The class of the effect, of this sensor."""
        return Kind(type(self.effect), self.sensor)

    def moved(self, factor):
        """Return the same of the effect that is moved."""
        return replace(self, effect=self.effect.moved(factor))


@dataclass(frozen=True)
class PairModel:
    """Residuals of both sensors at n poses, and of the m moves between them.

    Of the accelerometer the norm of gravity at each pose, of the gyroscope the rate there and
    gravity's direction, which a rotation carries from one pose to the next. With C the attitude by
    the gyroscope, C = 1 at the start of a move of length L, f the specific force and u gravity's
    direction at the pose before, the velocity of a move is

        v = ∫ C f dt - g L u,

    zero where the model is right. Its vertical component, along u, feels an error of attitude to
    second order alone; of the horizontal ones g times that error is the integrand. The residual is
    what is left of a velocity by what the move's own error of rotation lets expect.
    """

    force: AccelerometerModel
    turn: GyroscopeModel | None  # None of an accelerometer alone
    # where in all parameters those of each sensor are
    own: dict
    base: np.ndarray  # all base parameters; those that are not free have these values
    free: np.ndarray  # places of what is estimated among all parameters
    # specific force along the moves, m/s² as logged, (m, k, 3), and the derivative of e there; None
    # where velocities do not count
    y: np.ndarray | None = None
    design: np.ndarray | None = None
    counted: np.ndarray | None = None  # which of all residuals count, (N,)
    # velocity that a move's own error of rotation lets expect, per rad, (m, 3, 2)
    of_rotation: np.ndarray | None = None

    def all(self, x):
        """Return all parameters: those that are estimated, x, and the others."""
        found = np.append(self.base, np.zeros(sum(map(len, self.own.values())) - COUNT))
        found[self.free] = x
        return found

    def at(self, x):
        """Return the parameters of each sensor, and the gyroscope's model with its directions."""
        x = self.all(x)
        of_force, of_turn = x[self.own["accelerometer"]], x[self.own["gyroscope"]]
        force = self.force.force(of_force)
        directions = force / np.linalg.norm(force, axis=1, keepdims=True)
        return of_force, of_turn, self.turn and replace(self.turn, directions=directions)

    def residuals(self, x):
        """Return all residuals in one vector, in the order of `KINDS`, and their derivative."""
        of_force, of_turn, turn = self.at(x)
        norm, of_norm = self.force.residuals(of_force)
        parts = [(norm, of_norm, None)]
        if turn:
            first, path = turn.rotations.first, turn.path(of_turn)
            rates, of_rates = turn.pose_rates(of_turn)
            errors, of_errors = turn.rotation_errors(of_turn)
            change = self.directions_change(of_force)
            carried = turn.plane @ path.last.swapaxes(1, 2)
            tilts = carried @ change[first] - turn.plane @ change[first + 1]
            parts += [(rates, None, of_rates), (errors, tilts, of_errors)]
        if self.y is not None:
            velocity, *slopes = self._velocities(of_force, of_turn, turn, change)
            frame = self.frame(turn)
            v, by_force, by_turn = (frame @ each for each in (velocity[..., None], *slopes))
            parts += [(v[:, own], by_force[:, own], by_turn[:, own]) for own in ([0], [1, 2])]
        values = np.concatenate([value.ravel() for value, *_ in parts])
        jacobian, row = np.zeros((len(values), sum(map(len, self.own.values())))), 0
        for value, *slopes in parts:
            rows = slice(row, row + value.size)
            for at, slope in zip(self.own.values(), slopes, strict=True):
                if slope is not None:
                    jacobian[rows, at] = slope.reshape(value.size, len(at))
            row = rows.stop
        jacobian = jacobian[:, self.free]
        if self.y is not None:
            values, jacobian = (
                self.given_rotation(values[:, None])[:, 0],
                self.given_rotation(jacobian),
            )
        return values[self.counted], jacobian[self.counted]

    @cached_property
    def moves(self):
        """Rows of each move among all residuals, (m, 2 or 5): rotation, vertical, horizontal."""
        n, m = len(self.force.y), len(self.turn.rotations)
        blocks = [(4 * n, 2)] + [(4 * n + 2 * m, 1), (4 * n + 3 * m, 2)] * (self.y is not None)
        return np.concatenate([s + np.arange(w * m).reshape(m, w) for s, w in blocks], axis=1)

    def given_rotation(self, rows):
        """Return rows, (N, k), with velocities less what the rotation of the same move says."""
        rows, moves = np.array(rows), self.moves
        rows[moves[:, 2:]] -= self.of_rotation @ rows[moves[:, :2]]
        return rows

    def directions_change(self, of_force):
        """Return the derivative of gravity's direction at the poses, (n, 3, 9 + p)."""
        return self.across(of_force) @ self.force.derivative(of_force)

    def across(self, of_force):
        """Return what takes a change of specific force at the poses to one of its direction."""
        force = self.force.force(of_force)
        norm = np.linalg.norm(force, axis=1)[:, None, None]
        u = force[:, :, None] / norm
        return (np.eye(3) - u * u.swapaxes(1, 2)) / norm

    def frame(self, turn):
        """Return the axes of each move's velocity: gravity's direction, and two square to it."""
        u = turn.departures
        return np.concatenate([u[:, None], tangents(u)], axis=1)

    @cached_property
    def weights(self):
        """Weight of each sample in an integral by trapezoids, s, (m, k); `∫ dt` is their sum."""
        steps = self.turn.rotations.steps
        return (np.pad(steps, ((0, 0), (1, 0))) + np.pad(steps, ((0, 0), (0, 1)))) / 2

    def attitudes(self, path):
        """Return C at the samples, (m, k, 3, 3)."""
        start = np.tile(np.eye(3), (len(path.after), 1, 1, 1))
        return np.concatenate([start, matrix(path.after)], axis=1)

    def output(self, of_force):
        """Return ``K (y - b) - e`` along the moves, (m, k, 3)."""
        _, K, b = accelerometer.unpack(of_force)
        return K * (self.y - b) - self.design @ of_force[FORCE:]

    def levers(self, of_force, path):
        """Return what takes a turn in the middle of each step to velocity, (m, k - 1, 3, 3).

        A turn φ of all that follows adds ``φ × v``, with v the velocity that is to come.
        """
        T, _, _ = accelerometer.unpack(of_force)
        force = self.output(of_force) @ T.T
        pushed = (self.attitudes(path) @ force[..., None])[..., 0]
        gained = gyroscope.midpoints(pushed) * path.steps[..., None]
        to_come = gained[:, ::-1].cumsum(axis=1)[:, ::-1] - gained / 2
        return -cross_matrix(to_come.reshape(-1, 3)).reshape(*to_come.shape, 3)

    def _velocities(self, of_force, of_turn, turn, change):
        """Return the velocity of each move, (m, 3), and its derivative by each sensor's x."""
        T, K, b = accelerometer.unpack(of_force)
        path, first = turn.path(of_turn), turn.rotations.first
        C = self.attitudes(path) * self.weights[..., None, None]
        output, raw = self.output(of_force), self.y - b
        pull = self.force.gravity * self.weights.sum(axis=1)[:, None, None]
        # one product of matrices instead of one per sample
        pushed = np.tensordot(C, T, 1).swapaxes(1, 2).reshape(len(C), 3, -1)
        velocity = (pushed @ output.reshape(len(C), -1, 1))[..., 0]
        velocity = velocity - pull[..., 0] * turn.departures
        of_output = np.einsum("mkai,mkj->maij", C, output, optimize=True)
        of_raw = np.einsum("mkai,mkj->maij", C, raw, optimize=True)
        rows, columns = accelerometer.UPPER
        parts = [
            of_output[:, :, rows, columns],
            np.einsum("maij,ij->maj", of_raw, T),
            -C.sum(axis=1) @ (T * K),
            -pushed @ self.design.reshape(*pushed.shape[::2], self.design.shape[-1]),
        ]
        by_force = np.concatenate(parts, axis=2) - pull * change[first]
        by_turn = turn.summed(self.levers(of_force, path) @ path.middle, of_turn)
        return velocity, by_force, by_turn


class PairCovariance:
    """The covariance of the residuals of a PairModel that the noise predicts.

    Every channel has means at the poses and a mean over each move; what each makes of a residual is
    the gain. What a move has of slow noise the poses beside it have too; noise of different runs is
    independent. White noise within a move, and errors of its time stamps, enter its rotation and
    its velocity alike.
    """

    def __init__(self, x, model, recording):
        self.model, self.poses = model, recording.poses
        self.of_force, self.of_turn, self.turn = model.at(x)
        self.rotations = self.turn.rotations if self.turn else recording.rotations.select([])
        if self.turn:
            self._along_moves()
        self.gains = self._gains()
        if model.y is not None:
            self.gains = np.array([model.given_rotation(gain) for gain in self.gains])

    def by(self, noise):
        """Return the covariance of the residuals that count by a noise model, shape (N, N)."""
        found = 0.0
        for gain, axis in zip(self.gains, range(6), strict=True):
            found = found + gain @ self._of_means(noise, axis) @ gain.T
        if self.turn and len(self.rotations):
            white = [noise.axes[name].N.square for name in CHANNELS]
            at = self.model.moves
            found[at[:, :, None], at[:, None]] += np.tensordot(white, self.within, 1) + self.added
            for axis, columns in zip(ANGULAR_RATE, self.tilted, strict=True):
                found += noise.axes[axis].N.square * (columns @ columns.T)
        return self._counted(found)

    def component(self, axis, term):
        """Return that of flicker, 'B', or walk, 'K', of one channel alone, of size one."""
        one = AxisNoise(**{term: Coefficient(1.0)})
        gain, means = self.gains[CHANNELS.index(axis)], np.zeros((self.gains.shape[2],) * 2)
        for own, windows, _, _ in self._runs:
            means[np.ix_(own, own)] = one.mean_covariance(windows)
        return self._counted(gain @ self._about_mean(means) @ gain.T)

    def _about_mean(self, means):
        """Return a covariance of means less the mean over all rests: the bias is that mean."""
        share = np.zeros(len(means))
        share[: len(self.poses)] = self.poses.duration_s / self.poses.duration_s.sum()
        left = means - share @ means
        return left - (left @ share)[:, None]

    def _counted(self, covariance):
        counted = self.model.counted
        return covariance if counted.all() else covariance[np.ix_(counted, counted)]

    @cached_property
    def _runs(self):
        """Of each run the places of its means, their windows, its poses and its moves."""
        poses, found = self.poses, []
        ends = np.column_stack([self.rotations.start_s, self.rotations.end_s])
        of_run = poses.run[self.rotations.first]
        for run in np.unique(poses.run):
            at, moves = np.flatnonzero(poses.run == run), np.flatnonzero(of_run == run)
            windows = np.concatenate([poses.windows[at], ends[moves]])
            found.append((np.append(at, len(poses) + moves), windows, at, moves))
        return found

    def _of_means(self, noise, axis):
        """Return the covariance of one channel's means at the poses and over the moves."""
        poses, model = self.poses, noise.axes[CHANNELS[axis]]
        fast = replace(model, B=Coefficient(), K=Coefficient(), gauss_markov=())
        means, slow = np.zeros((2, *(self.gains.shape[2],) * 2))
        for own, windows, at, moves in self._runs:
            whole, quick = (each.mean_covariance(windows) for each in (model, fast))
            rest, turned = np.arange(len(at)), len(at) + np.arange(len(moves))
            slow[np.ix_(own, own)] = whole - quick
            if whole.any():
                # white noise within a move does not act as its mean does
                quick[turned, turned] -= model.N.square / np.diff(windows[len(at) :])[:, 0]
                if poses.added is not None:
                    quick[rest, rest] += poses.added[at, axis]
            else:
                # of a channel without noise the poses' own variance is known
                quick[rest, rest] = poses.variance[at, axis] / poses.n[at]
            means[np.ix_(own, own)] = quick
        return means + self._about_mean(slow)

    def _along_moves(self):
        """Find what turns in the middle of each step, white noise and stamps make of residuals."""
        model, turn, rotations = self.model, self.turn, self.rotations
        self.path = path = turn.path(self.of_turn)
        self.carried = turn.plane @ path.last.swapaxes(1, 2)
        # error of each move per turn on the axes at its start, in the middle of each step
        per_turn = (self.carried @ cross_matrix(turn.departures))[:, None]
        T, K, _ = accelerometer.unpack(self.of_force)
        m, steps = path.steps.shape
        per_turn = np.broadcast_to(per_turn, (m, steps, 2, 3))
        if model.y is not None:
            self.frame = model.frame(turn)
            levers = self.frame[:, None] @ model.levers(self.of_force, path)
            levers = levers - model.of_rotation[:, None] @ per_turn
            per_turn = np.concatenate([per_turn, levers], axis=2)
        turned = per_turn @ path.middle
        self.turned = (turned * path.steps[..., None, None]).sum(axis=1)
        width = per_turn.shape[2]
        self.within, self.added = np.zeros((6, m, width, width)), np.zeros((m, width, width))
        for axis in range(3):
            own = turned[..., axis]
            self.within[3 + axis] = (own * path.steps[..., None]).swapaxes(1, 2) @ own
            if model.y is not None:
                pushed = (self.frame[:, None] @ model.attitudes(path) @ (T * K))[..., axis]
                own = np.pad(pushed, ((0, 0), (0, 0), (2, 0)))
                self.within[axis] = (own * model.weights[..., None]).swapaxes(1, 2) @ own
        if rotations.added is not None:
            at = np.arange(m)[:, None], rotations.added_at
            gain = turned[at]
            self.added = (gain @ rotations.added @ gain.swapaxes(2, 3)).sum(axis=1)

    @cached_property
    def tilted(self):
        """What white noise of each rate makes of residuals where a rest tilts, (3, N, k).

        A direction at a tilted pose is turned by the gyroscope to where its rotation starts or
        ends; the mean of a walk over T, from either end, has a third of the variance at T.
        """
        poses, first = self.poses, self.rotations.first
        found = []
        for k in np.flatnonzero(poses.tilt > 0 if poses.tilt is not None else []):
            own = np.zeros((self.gains.shape[1], 3))
            leaving, arriving = np.flatnonzero(first == k), np.flatnonzero(first + 1 == k)
            rows = self.model.moves[:, :2]
            for move in leaving:
                own[rows[move]] += self.carried[move]
            for move in arriving:
                own[rows[move]] -= self.turn.plane[move]
            crossed = np.cross(np.eye(3), self.turn.directions[k])
            found.append(np.sqrt(poses.duration_s[k] / 3) * own @ crossed)
        if self.model.y is not None:
            found = [self.model.given_rotation(columns) for columns in found]
        return np.array(found).reshape(-1, self.gains.shape[1], 3).transpose(2, 1, 0)

    def _gains(self):
        """Return what each channel's mean at a pose or over a move adds, (6, N, n + m)."""
        model, turn, n, m = self.model, self.turn, len(self.poses), len(self.rotations)
        T, K, _ = accelerometer.unpack(self.of_force)
        force = model.force.force(self.of_force)
        norm = (force / np.linalg.norm(force, axis=1)[:, None]) @ T * K
        rows = n + (3 * n + (5 if model.y is not None else 2) * m if turn else 0)
        gains, poses = np.zeros((6, rows, n + m)), np.arange(n)
        for axis in range(3):
            gains[axis, poses, poses] = norm[:, axis]
        if not turn:
            return gains
        first, moves, move = turn.rotations.first, n + np.arange(m), model.moves
        across = model.across(self.of_force) @ (T * K)
        begun, ended = self.carried @ across[first], -turn.plane @ across[first + 1]
        if model.y is not None:
            pull = model.force.gravity * model.weights.sum(axis=1)[:, None, None]
            weighted = model.attitudes(self.path) * model.weights[..., None, None]
            pushed = self.frame @ weighted.sum(axis=1) @ (T * K)
            begun = np.concatenate([begun, -pull * self.frame @ across[first]], axis=1)
        # the turned means of velocities are already less what the rotation says
        turned = self.turned.copy()
        if model.y is not None:
            turned[:, 2:] += model.of_rotation @ turned[:, :2]
        for axis in range(3):
            gain = gains[axis]
            gain[move, first[:, None]] += begun[:, :, axis]
            gain[move[:, :2], first[:, None] + 1] += ended[:, :, axis]
            if model.y is not None:
                gain[move[:, 2:], moves[:, None]] = pushed[:, :, axis]
            gain = gains[3 + axis]
            gain[n + 3 * poses + axis, poses] = 1.0
            gain[move, moves[:, None]] = turned[:, :, axis]
        return gains


@dataclass(frozen=True)
class SensorPair:
    """Both sensors of a device as they are fitted to a recording.

    Attributes
    ----------
    noise : NoiseModel
        Of the device.
    gravity : float
        Local gravity, m/s^2.
    units : dict of str to RawUnit
        Of each sensor.
    settings : CalibrateSettings
        Settings.
    estimated : tuple of str
        The sensors whose base parameters the recording determines.
    base : ndarray, shape (21,)
        All base parameters to start from, SI as logged; those that are not estimated stay.
    given : SensorCalibration or None
        Of an accelerometer that is not estimated: where it is known, its parameters are fitted with
        what is known of them.
    turns : (ndarray, ndarray) or None
        Rows R, (k, 12), and z of what known turns say of the gyroscope: ``R x - z`` has variance
        one.
    bias : (ndarray, ndarray) or None
        Bias of the gyroscope and its variance, SI as logged, where it is held.
    quiet : ndarray of bool, shape (m,), or None
        Whether the velocity of a move counts; None where none does.
    of_rotation : ndarray or None
        Of PairModel.
    """

    noise: NoiseModel
    gravity: float
    units: dict
    settings: CalibrateSettings
    estimated: tuple
    base: np.ndarray
    given: SensorCalibration | None = None
    turns: tuple | None = None
    bias: tuple | None = None
    quiet: np.ndarray | None = None
    of_rotation: np.ndarray | None = None

    @cached_property
    def free(self):
        """Places of the base parameters that are estimated, among all."""
        free = np.zeros(COUNT, dtype=bool)
        free[:FORCE] = "accelerometer" in self.estimated or self._given_to_errors
        free[FORCE:] = "gyroscope" in self.estimated
        if self.bias is not None:
            free[-3:] = False
        return np.flatnonzero(free)

    @property
    def _given_to_errors(self):
        """Whether all base parameters of a given accelerometer have a covariance."""
        return self.given is not None and self.given.names[:FORCE] == accelerometer.NAMES

    @cached_property
    def names(self):
        """Names of the base parameters that are estimated."""
        every = [f"{sensor}.{name}" for sensor, names in BASES.items() for name in names]
        return tuple(every[k] for k in self.free)

    @cached_property
    def kinds(self):
        """Kinds of residuals that count, with SI unit and number of components."""
        own = [kind for sensor in self.estimated for kind in OF_SENSOR[sensor]]
        own += VELOCITY if self.quiet is not None else ()
        return {kind: KINDS[kind] for kind in KINDS if kind in own}

    @property
    def _seen(self):
        """The sensors whose noise the residuals have: gravity's direction is the accelerometer's."""
        return tuple(SENSORS) if "gyroscope" in self.estimated else self.estimated

    def rows(self, recording):
        """Return the poses where each residual starts and ends, (N, 2), and its kind, (N,)."""
        poses, first = np.arange(len(recording.poses)), recording.rotations.first
        starts = {"gravity_norm": poses, "pose_rate": poses}
        starts |= dict.fromkeys(("rotation", *VELOCITY), first)
        ends, kinds = [], []
        for k, (kind, (_, width)) in enumerate(self.kinds.items()):
            start = starts[kind][self.quiet] if kind in VELOCITY else starts[kind]
            start = np.repeat(start, width)
            ends.append(np.column_stack([start, start + (starts[kind] is first)]))
            kinds.append(np.full(len(start), k))
        return np.concatenate(ends), np.concatenate(kinds)

    def counted(self, recording):
        """Return which of all residuals of a PairModel count, (N,)."""
        n, m = len(recording.poses), len(recording.rotations)
        found = [np.full(n, "accelerometer" in self.estimated)]
        if "gyroscope" in self.estimated:
            found.append(np.ones(3 * n + 2 * m, dtype=bool))
        if self.quiet is not None:
            found += [self.quiet, np.repeat(self.quiet, 2)]
        return np.concatenate(found)

    def prior_rows(self):
        """Return rows R, (k, p), and z of what is known of the base parameters beforehand."""
        rows, z = np.zeros((0, COUNT)), np.zeros(0)
        if "accelerometer" not in self.estimated and self._given_to_errors:
            factor = np.repeat([1.0, 1 / self.given.raw_unit.scale, self.given.raw_unit.scale], 3)
            own = self.given.covariance[:FORCE, :FORCE] * np.outer(factor, factor)
            root = np.linalg.inv(np.linalg.cholesky(own))
            rows = np.pad(root, ((0, 0), (0, COUNT - FORCE)))
            z = root @ as_logged(self.given, accelerometer.NAMES)
        if "gyroscope" in self.estimated and self.turns is not None:
            rows = np.vstack([rows, np.pad(self.turns[0], ((0, 0), (FORCE, 0)))])
            z = np.append(z, self.turns[1])
        fixed = np.delete(np.arange(COUNT), self.free)
        return rows[:, self.free], z - rows[:, fixed] @ self.base[fixed]

    def model_at(self, x, recording, effects=()):
        """Return the PairModel of a recording, effects seen with parameters x, or the start."""
        every = {sensor: [*places] for sensor, places in _places().items()}
        sets, place = {sensor: [] for sensor in SENSORS}, COUNT
        for effect in effects:
            count = len(effect.parameters)
            every[effect.sensor] += range(place, place + count)
            sets[effect.sensor].append(effect)
            place += count
        own = {sensor: np.array(places) for sensor, places in every.items()}
        values = np.append(self.base, np.zeros(place - COUNT))
        free = np.append(self.free, np.arange(COUNT, place))
        if x is not None:
            values[free[: len(x)]] = x
        of_force, of_turn = values[own["accelerometer"]], values[own["gyroscope"]]
        Ta, Ka, ba = accelerometer.unpack(of_force)
        Tg, Kg, bg = gyroscope.unpack(of_turn)
        poses, rotations = recording.poses, recording.rotations

        def output(f):
            return Ka * (f - ba)

        def aligned(f):
            return output(f) @ Ta.T

        def rate(w):
            return (Kg * (w - bg)) @ Tg.T

        found = sets["accelerometer"]
        channels = recording.pose_channels("accelerometer", output, rate(poses.w), rate)
        at_rest = effect_design(found, channels, of_force[FORCE:])
        force = AccelerometerModel(poses.f, at_rest, self.gravity)
        if "gyroscope" not in self.estimated:
            counted = self.counted(recording)
            return PairModel(force, None, own, self.base, free, counted=counted)
        turn = gyroscope.gyroscope_model(recording, aligned, of_turn, sets["gyroscope"])
        y = along = None
        if self.quiet is not None:
            y = rotations.f
            seen = recording.rotation_channels("accelerometer", output, rate(rotations.w), rate)
            along = effect_design(found, seen, of_force[FORCE:])
            along = along.reshape(*y.shape, at_rest.shape[2])
        return PairModel(
            force,
            turn,
            own,
            self.base,
            free,
            y,
            along,
            self.counted(recording),
            self.of_rotation if self.of_rotation is not None else np.zeros((len(rotations), 3, 2)),
        )

    def model(self, solution, recording, shapes=()):
        """Return the model of any recording about a solution, with more effects."""
        return self.model_at(solution.fit.x, recording, (*solution.effects, *shapes))

    def covariances(self, solution, recording):
        """Return what gives the covariance of the residuals of a recording by a noise model."""
        return PairCovariance(solution.fit.x, self.model(solution, recording), recording).by

    def given_rotation(self, recording, effects, x):
        """Return the same, its velocities less what the noise has in common with rotations.

        Takes the effects, and the parameters at which that is found.
        """
        model = replace(self, of_rotation=None).model_at(x, recording, effects)
        model = replace(model, counted=np.ones(len(model.counted), dtype=bool))
        covariance, at = PairCovariance(x, model, recording).by(self.noise), model.moves
        own = covariance[at[:, :, None], at[:, None]]
        shared = np.linalg.solve(own[:, :2, :2], own[:, :2, 2:]).swapaxes(1, 2)
        return replace(self, of_rotation=shared)

    def covariance_at(self, x, recording, effects=()):
        """Return the PairCovariance of a recording with parameters x."""
        return PairCovariance(x, self.model_at(x, recording, effects), recording)

    def noise_components(self, x, recording, effects=()):
        """Return the covariance of the noise that is known, (N, N), and Components of the rest.

        First flicker and walk of each channel as far as they are known, and what turns lose between
        two samples; then of each kind of residual an excess that is even: the residual of what a
        model lacks, or of a hand, is no smaller where a rest is long.
        """
        noise, channels = self.noise, [c for s in self._seen for c in SENSORS[s]]
        terms = {(c, term): noise.known(c, term) for c in channels for term in "BK"}
        loose = {term: known for term, known in terms.items() if known[1] > 0}
        without = noise.with_sizes(dict.fromkeys(loose, 0.0))
        covariance = self.covariance_at(x, recording, effects)
        fixed = covariance.by(without)
        slow = [
            Component(spread**2 * covariance.component(*term), size / spread, 1.0)
            for term, (size, spread) in loose.items()
        ]
        if "gyroscope" in self.estimated and recording.rotations.aliased is not None:
            whole, even = fixed, recording.without_aliasing()
            fixed = self.covariance_at(x, even, effects).by(without)
            slow.append(Component(whole - fixed, 1.0, ALIASED_TO))
        expected = np.diag(total(fixed, slow, [part.size for part in slow]))
        kinds, missing = self.rows(recording)[1], []
        for at in (kinds == k for k in range(len(self.kinds))):
            if at.any():
                missing.append(Component(np.diag(at * np.median(expected[at]))))
        return fixed, slow, missing

    def fit(self, recording, effects=(), start=None, prior=None):
        """Return the Solution for a recording: generalised least squares of all residuals.

        The weights are those of the noise as residuals make it likeliest, within what is known of
        it. `start` are parameters of a fit with fewer effects; `prior` are rows R and z of what is
        known of the parameters, ``R x - z`` of variance one, by default `prior_rows`.

        References
        ----------
        Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration
        without external equipments", ICRA 2014, section IV.
        """
        count = len(self.names) + sum(len(e.parameters) for e in effects)
        x = self.base[self.free] if start is None else start
        x = np.append(x, np.zeros(count - len(x)))
        known, z = self.prior_rows() if prior is None else prior
        known = np.pad(known, ((0, 0), (0, count - known.shape[1])))
        # weights and effects depend on the calibrated output, which the start gives to 1 %
        for _ in range(3 if start is None else 2):
            model = self.model_at(x, recording, effects)
            fixed, slow, missing = self.noise_components(x, recording, effects)
            r, jacobian = model.residuals(x)
            estimated = total(fixed, slow, [part.size for part in slow])
            sizes = likely_sizes(r, jacobian, estimated, missing, (known, known @ x - z))
            found = fit(model.residuals, x, total(estimated, missing, sizes), (known, z))
            x = found.x
        return Solution(tuple(effects), found)

    def calibrations(self, solution, covariance=None):
        """Return the SensorCalibration of each estimated sensor; a given one as it is.

        Without a covariance that of the fit, grown with what it leaves unexplained.
        """
        found, made = solution.fit, {}
        covariance = found.scaled_covariance if covariance is None else covariance
        places = np.append(self.free, np.arange(COUNT, COUNT + len(found.x) - len(self.free)))
        every, whole = np.append(self.base, np.zeros(len(found.x) - len(self.free))), None
        every[places] = found.x
        whole = np.zeros((len(every),) * 2)
        whole[np.ix_(places, places)] = covariance
        if self.bias is not None:
            whole[range(COUNT - 3, COUNT), range(COUNT - 3, COUNT)] = self.bias[1]
        for sensor in self.estimated:
            at, place, effects = [*_places()[sensor]], COUNT, []
            for effect in solution.effects:
                if effect.sensor == sensor:
                    at += range(place, place + len(effect.parameters))
                    effects.append(effect.effect)
                place += len(effect.parameters)
            made[sensor] = in_raw_units(
                self.units[sensor],
                BASES[sensor],
                every[at],
                whole[np.ix_(at, at)],
                method="multi_position",
                effects=effects,
                reduced_chi2=found.reduced_chi2,
            )
        return made

    def lost(self, solution, recording):
        """Return why a fit is none, or None if it is one, by the first sensor that has none."""
        reasons = (self.lost_by(sensor, solution, recording) for sensor in self.estimated)
        return next(filter(None, reasons), None)

    def lost_by(self, sensor, solution, recording):
        """Return why the fit of one sensor is none, or None if it is one."""
        found, largest = solution.fit, self.settings.largest_condition
        kinds = self.rows(recording)[1]
        at = [k for k, name in enumerate(self.names) if name.startswith(sensor)]
        rows = kinds == list(self.kinds).index(OF_SENSOR[sensor][-1])
        jacobian = found.jacobian[rows]
        if sensor == "accelerometer":
            return accelerometer_lost(jacobian[:, at], found.x[at], self.gravity, largest)
        at = at[:9]
        covariance = found.covariance[np.ix_(at, at)]
        white = found.white[: len(rows)][rows]
        return gyroscope_lost(jacobian[:, at], white, covariance, found.x[at[6:]], largest)

    def undetermined(self, sensor, recording, keeps):
        """Return for each mask of poses whether these alone determine no calibration of a sensor."""
        largest = self.settings.largest_condition
        if sensor == "accelerometer":
            poses = (recording.poses.select(keep) for keep in keeps)
            each = (accelerometer_undetermined(p, self.gravity, largest) for p in poses)
        else:
            # the design, but for what the parameters of a part differ by
            jacobian, first = self.turns_derivative(recording), recording.rotations.first
            parts = (jacobian[keep[first] & keep[first + 1]] for keep in keeps)
            each = (gyroscope_undetermined(part, largest) for part in parts)
        return [reason is not None for reason in each]

    def turns_derivative(self, recording):
        """Return the derivative of the rotations' errors at the start of a fit, (m, 2, 12)."""
        if not len(recording.rotations):
            return np.zeros((0, 2, 12))
        pair = replace(self, estimated=tuple(SENSORS), quiet=None)
        _, of_turn, turn = pair.model_at(None, recording).at(self.base[pair.free])
        return turn.rotation_errors(of_turn)[1]


def _places():
    return {"accelerometer": range(FORCE), "gyroscope": range(FORCE, COUNT)}
