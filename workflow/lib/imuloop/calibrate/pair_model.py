"""Residuals of both sensors at their poses and in the moves between, by one state."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.accelerometer import AccelerometerModel
from imuloop.calibrate.gyroscope import GyroscopeModel, cross_matrix, tangents
from imuloop.core.rotation import matrix

# parameters of the accelerometer's base model, and of both
FORCE = len(accelerometer.NAMES)
COUNT = FORCE + len(gyroscope.NAMES)


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
