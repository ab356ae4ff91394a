"""Both sensors between their rests: a move begins and ends without velocity."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.accelerometer import AccelerometerModel
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.gyroscope import GyroscopeModel, cross_matrix, slow_covariance, tangents
from imuloop.calibrate.pose_fits import SensorPoses
from imuloop.core.effect import Effect, effect_design
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.rotation import matrix
from imuloop.core.samples import CHANNELS, SENSORS

# parameters of the accelerometer's base model, before those of the gyroscope's
FORCE = len(accelerometer.NAMES)
COUNT = FORCE + len(gyroscope.NAMES)


@dataclass(frozen=True)
class OfSensor:
    """An effect of one of two sensors that are fitted together, and may both have it."""

    effect: Effect
    sensor: str

    @property
    def name(self):
        """Name of the effect."""
        return self.effect.name

    @property
    def sensors(self):
        """The sensor alone."""
        return (self.sensor,)

    @property
    def parameters(self):
        """Names and units of the effect."""
        return self.effect.parameters

    def moved(self, factor):
        """Return the same of the effect that is moved."""
        return replace(self, effect=self.effect.moved(factor))

    def design_at(self, channels, values):
        """Return that of the effect."""
        return self.effect.design_at(channels, values)


@dataclass(frozen=True)
class MotionModel:
    """Residuals of both sensors at n poses, and of the m moves between them.

    With C the attitude by the gyroscope, C = 1 at the start of a move of length L, f the specific
    force and u gravity's direction at the pose before, the velocity of a move is

        v = ∫ C f dt - g L u,

    zero where the model is right. Its vertical component, along u, feels an error of attitude to
    second order alone; of the horizontal ones g times that error is the integrand. The residual is
    what is left of a velocity by what the move's own error of rotation lets expect.
    """

    force: AccelerometerModel
    turn: GyroscopeModel  # its directions are those of `force`
    # specific force along the moves, m/s² as logged, (m, k, 3), and the derivative of e there
    y: np.ndarray
    design: np.ndarray
    # where in the parameters those of each sensor are
    own: dict
    counted: np.ndarray  # which of all residuals count, (N,)
    # velocity that a move's own error of rotation lets expect, per rad, (m, 3, 2)
    of_rotation: np.ndarray

    def start(self):
        """Return parameters to start from: as logged."""
        x = np.zeros(sum(map(len, self.own.values())))
        x[self.own["accelerometer"]] = self.force.start()
        x[self.own["gyroscope"]] = self.turn.start()
        return x

    def at(self, x):
        """Return the parameters of each sensor, and the gyroscope's model with its directions."""
        of_force, of_turn = x[self.own["accelerometer"]], x[self.own["gyroscope"]]
        force = self.force.force(of_force)
        directions = force / np.linalg.norm(force, axis=1, keepdims=True)
        return of_force, of_turn, replace(self.turn, directions=directions)

    def residuals(self, x):
        """Return all residuals in one vector, in the order of `MotionPoses.kinds`, and derivative.

        Gravity norm, pose rates, errors of the rotations, then velocities: vertical, horizontal.
        """
        of_force, of_turn, turn = self.at(x)
        first, path = turn.rotations.first, turn.path(of_turn)
        norm, of_norm = self.force.residuals(of_force)
        rates, of_rates = turn.pose_rates(of_turn)
        errors, of_errors = turn.rotation_errors(of_turn)
        change = self.directions_change(of_force)
        carried = turn.plane @ path.last.swapaxes(1, 2)
        tilts = carried @ change[first] - turn.plane @ change[first + 1]
        velocity, by_force, by_turn = self._velocities(of_force, of_turn, turn, change)
        frame = self.frame(turn)
        v, by_force, by_turn = (frame @ each for each in (velocity[..., None], by_force, by_turn))
        values = [norm, rates, errors, v[:, :1], v[:, 1:]]
        parts = [
            (of_norm, None),
            (None, of_rates),
            (tilts, of_errors),
            (by_force[:, :1], by_turn[:, :1]),
            (by_force[:, 1:], by_turn[:, 1:]),
        ]
        jacobian = []
        for value, pair in zip(values, parts, strict=True):
            rows = np.zeros((value.size, len(x)))
            for at, part in zip(self.own.values(), pair, strict=True):
                if part is not None:
                    rows[:, at] = part.reshape(value.size, len(at))
            jacobian.append(rows)
        values = self.given_rotation(np.concatenate([v.ravel() for v in values])[:, None])
        jacobian = self.given_rotation(np.concatenate(jacobian))
        return values[self.counted, 0], jacobian[self.counted]

    @cached_property
    def moves(self):
        """Rows of each move among all residuals, (m, 5): rotation, vertical, horizontal."""
        n, m = len(self.force.y), len(self.y)
        starts, widths = 4 * n + m * np.array([0, 2, 3]), (2, 1, 2)
        each = zip(starts, widths, strict=True)
        return np.concatenate([s + np.arange(w * m).reshape(m, w) for s, w in each], axis=1)

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


@dataclass(frozen=True)
class MotionPoses(SensorPoses):
    """Both sensors of a device at the poses and in the moves between, as one problem.

    Its parameters are those of the accelerometer's base model, of the gyroscope's, and of the
    effects of either; of each `effect.sensors` gives the sensor first.
    """

    noise: NoiseModel
    # the calibrations to start from, and what these are parameters of, SI as logged
    accelerometer: SensorCalibration
    x: np.ndarray
    gravity: float
    quiet: np.ndarray  # (m,): whether the velocity of a move counts
    of_rotation: np.ndarray | float = 0.0  # of MotionModel
    names = (
        *(f"accelerometer.{name}" for name in accelerometer.NAMES),
        *(f"gyroscope.{name}" for name in gyroscope.NAMES),
    )
    # what is not known of slow noise is in the excess of each kind
    axes = ()
    kinds: ClassVar = {
        "gravity_norm": ("m/s^2", 1),
        "pose_rate": ("rad/s", 3),
        "rotation": ("rad", 2),
        "velocity_vertical": ("m/s", 1),
        "velocity_horizontal": ("m/s", 2),
    }

    def rows(self, recording):
        """Return the move that each residual is of, (N, 2), -1 for none, and its kind, (N,)."""
        poses, moves = np.full(len(recording.poses), -1), np.arange(len(recording.rotations))
        own, widths = (poses, poses, moves, moves, moves), (k for _, k in self.kinds.values())
        each = [np.repeat(e, k) for e, k in zip(own, widths, strict=True)]
        kinds = np.repeat(np.arange(len(each)), [len(e) for e in each])
        counted = self.counted(recording)
        ends = np.concatenate(each)[counted]
        return np.column_stack([ends, ends]), kinds[counted]

    def counted(self, recording):
        """Return which of all residuals count, (N,)."""
        n = 4 * len(recording.poses) + 2 * len(recording.rotations)
        return np.concatenate([np.ones(n, bool), self.quiet, np.repeat(self.quiet, 2)])

    def model_at(self, x, recording, effects):
        """Return the MotionModel of a recording, effects seen with parameters x."""
        own, sets = {}, {}
        ends = COUNT + np.cumsum([0, *(len(e.parameters) for e in effects)])
        x = self.x if x is None else x
        x = np.append(x, np.zeros(max(ends[-1] - len(x), 0)))
        for sensor, base in zip(SENSORS, (range(FORCE), range(FORCE, COUNT)), strict=True):
            at = [k for k, e in enumerate(effects) if e.sensors[0] == sensor]
            own[sensor] = np.array([*base, *(i for k in at for i in range(ends[k], ends[k + 1]))])
            sets[sensor] = [effects[k] for k in at]
        _, K, b = accelerometer.unpack(x)
        Tg, Kg, bg = gyroscope.unpack(x[FORCE:])
        force = calibrated_force(self.accelerometer, recording, self.noise)

        def output(y):
            return K * (y - b)

        def rate(w):
            return (Kg * (w - bg)) @ Tg.T

        found, shape = sets["accelerometer"], recording.rotations.f.shape
        at_poses, in_moves = rate(recording.poses.w), rate(recording.rotations.w)
        poses = recording.pose_channels("accelerometer", output, at_poses, rate)
        along = recording.rotation_channels("accelerometer", output, in_moves, rate)
        of_force = x[own["accelerometer"]]
        at_rest = effect_design(found, poses, of_force[FORCE:])
        turn = gyroscope.gyroscope_model(recording, force, x[own["gyroscope"]], sets["gyroscope"])
        return MotionModel(
            AccelerometerModel(recording.poses.f, at_rest, self.gravity),
            turn,
            recording.rotations.f,
            effect_design(found, along, of_force[FORCE:]).reshape(*shape, at_rest.shape[2]),
            own,
            self.counted(recording),
            np.broadcast_to(self.of_rotation, (len(recording.rotations), 3, 2)),
        )

    def given_rotation(self, recording, effects):
        """Return the same, its velocities less what the noise has in common with rotations.

        The effects are those of the parameters to start from.
        """
        model = self.model_at(None, recording, effects)
        covariance = MotionCovariance(self.x, model, recording).all(self.noise)
        at = model.moves
        own = covariance[at[:, :, None], at[:, None]]
        shared = np.linalg.solve(own[:, :2, :2], own[:, :2, 2:]).swapaxes(1, 2)
        return replace(self, of_rotation=shared)

    def fit(self, recording, effects=(), start=None, prior=None):
        """Return the Solution for a recording, from the calibrations if not from a start."""
        return super().fit(recording, effects, self.x if start is None else start, prior)

    def covariance_at(self, x, model, recording, noise):
        """Return the covariance of a model's residuals, by a noise model."""
        return MotionCovariance(x, model, recording).by(noise)


class MotionCovariance:
    """The covariance of all residuals of a MotionModel that the noise predicts.

    Every channel has means at the poses and a mean over each move (`slow_covariance`); what each
    makes of a residual is the gain. White noise within a move, and errors of its time stamps, enter
    its rotation and its velocity alike.
    """

    def __init__(self, x, model, recording):
        self.model, self.recording = model, recording
        self.of_force, self.of_turn, self.turn = model.at(x)
        self.path = self.turn.path(self.of_turn)
        self.frame = model.frame(self.turn)
        self.carried = self.turn.plane @ self.path.last.swapaxes(1, 2)
        # error of each move per turn on the axes at its start, in the middle of each step
        of_rotation = self.carried @ cross_matrix(self.turn.departures)
        of_velocity = self.frame[:, None] @ model.levers(self.of_force, self.path)
        of_rotation = np.broadcast_to(of_rotation[:, None], (*of_velocity.shape[:2], 2, 3))
        self.per_turn = np.concatenate([of_rotation, of_velocity], axis=2)
        self.gains, (self.within, self.added) = self._gains(), self._within()

    def by(self, noise):
        """Return the covariance by a noise model of the residuals that count, shape (N, N)."""
        given, counted = self.model.given_rotation, self.model.counted
        return given(given(self.all(noise)).T)[np.ix_(counted, counted)]

    def all(self, noise):
        """Return that of all, velocities as they are."""
        poses, rotations = self.recording.poses, self.turn.rotations
        covariance = slow_covariance(poses, rotations, noise, self.gains, CHANNELS)
        white = [noise.axes[name].N.square for name in CHANNELS]
        move = self.model.moves
        within = np.tensordot(white, self.within, 1) + self.added
        covariance[move[:, :, None], move[:, None]] += within
        return covariance

    def _gains(self):
        """Return what each channel's mean at a pose or over a move adds, (6, N, n + m)."""
        n, m = len(self.recording.poses), len(self.turn.rotations)
        first, move = self.turn.rotations.first, self.model.moves
        gains, poses, moves = np.zeros((6, 4 * n + 5 * m, n + m)), np.arange(n), n + np.arange(m)
        T, K, _ = accelerometer.unpack(self.of_force)
        across = self.model.across(self.of_force) @ (T * K)
        norm = (self.turn.directions @ T) * K
        pull = self.model.force.gravity * self.model.weights.sum(axis=1)[:, None, None]
        weighted = self.model.attitudes(self.path) * self.model.weights[..., None, None]
        pushed = self.frame @ weighted.sum(axis=1) @ (T * K)
        begun = np.concatenate(
            [self.carried @ across[first], -pull * self.frame @ across[first]], 1
        )
        ended = -self.turn.plane @ across[first + 1]
        for axis in range(3):
            gain = gains[axis]
            gain[poses, poses] = norm[:, axis]
            gain[move, first[:, None]] += begun[:, :, axis]
            gain[move[:, :2], first[:, None] + 1] += ended[:, :, axis]
            gain[move[:, 2:], moves[:, None]] = pushed[:, :, axis]
        turned = (self.per_turn @ self.path.middle * self.path.steps[..., None, None]).sum(axis=1)
        for axis in range(3):
            gain = gains[3 + axis]
            gain[n + 3 * poses + axis, poses] = 1.0
            gain[move, moves[:, None]] = turned[:, :, axis]
        return gains

    def _within(self):
        """Return what white noise of each channel adds within a move, (6, m, 5, 5), and stamps."""
        model, path = self.model, self.path
        T, K, _ = accelerometer.unpack(self.of_force)
        turned = self.per_turn @ path.middle
        pushed = self.frame[:, None] @ model.attitudes(path) @ (T * K)
        found, added = np.zeros((6, len(path.steps), 5, 5)), np.zeros((len(path.steps), 5, 5))
        for axis in range(3):
            for k, own, seconds in (
                (axis, np.pad(pushed[..., axis], ((0, 0), (0, 0), (2, 0))), model.weights),
                (3 + axis, turned[..., axis], path.steps),
            ):
                found[k] = (own * seconds[..., None]).swapaxes(1, 2) @ own
        rotations = self.turn.rotations
        if rotations.added is not None:
            at = np.arange(len(added))[:, None], rotations.added_at
            gain = self.per_turn[at] @ path.middle[at]
            added = (gain @ rotations.added @ gain.swapaxes(2, 3)).sum(axis=1)
        return found, added
