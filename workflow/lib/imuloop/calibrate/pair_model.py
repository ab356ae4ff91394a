"""Residuals of both sensors at their poses and in the moves between, by one state."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.accelerometer import AccelerometerModel, SpecificForce
from imuloop.calibrate.gyroscope import (
    GyroscopeModel,
    at_both_ends,
    cross_matrix,
    midpoints,
    tangents,
)

# parameters of the accelerometer's base model, and of both
FORCE = len(accelerometer.NAMES)
COUNT = FORCE + len(gyroscope.NAMES)


@dataclass(frozen=True)
class MoveResiduals:
    """Residuals of m moves, and their derivative by what enters them.

    Of each move the w residuals are both components of its rotation, then of its velocity the one
    along gravity and the two across, if velocities count.
    """

    values: np.ndarray  # (m, w, 1)
    # by calibrated specific force at the poses before and after, (m, w, 3)
    by_start: np.ndarray
    by_end: np.ndarray
    # by a small turn on the axes of the body, in the middle of each step, (m, k - 1, w, 3)
    by_turn: np.ndarray
    # of the velocities by the integral of specific force about each sample, (m, k, 3, 3)
    by_force: np.ndarray | None = None


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
    turn: GyroscopeModel
    # where in all parameters those of each sensor are
    own: dict
    free: np.ndarray  # places of what is estimated among all parameters
    start: np.ndarray  # all parameters; those that are not free have these values
    counted: np.ndarray  # which of all residuals count, (N,)
    # along the moves, (m, k, 3); None where velocities do not count
    along: SpecificForce | None = None
    # velocity that a move's own error of rotation lets expect, per rad, (m, 3, 2)
    of_rotation: np.ndarray | None = None
    # the last MoveResiduals, and residuals: fit, covariance and derivative at one x share them
    _moves: dict = field(default_factory=dict, init=False, compare=False, repr=False)
    _residuals: dict = field(default_factory=dict, init=False, compare=False, repr=False)

    def all(self, x):
        """Return all parameters: those that are estimated, x, and the others."""
        found = self.start.copy()
        found[self.free] = x
        return found

    def at(self, x):
        """Return the parameters of each sensor, and the gyroscope's model with its directions."""
        of_force, of_turn = (self.all(x)[places] for places in self.own.values())
        force = self.force.values(of_force)
        directions = force / np.linalg.norm(force, axis=1, keepdims=True)
        return of_force, of_turn, replace(self.turn, directions=directions)

    def moves_at(self, x):
        """Return the MoveResiduals with parameters x."""
        key = np.asarray(x, dtype=float).tobytes()
        if key not in self._moves:
            self._moves.clear()
            self._moves[key] = self.of_moves(*self.at(x))
        return self._moves[key]

    def know_moves(self, found, x):
        """Take the MoveResiduals with parameters x from another model that has the same there."""
        self._moves[np.asarray(x, dtype=float).tobytes()] = found

    def residuals(self, x):
        """Return all residuals in one vector, in the order of `KINDS`, and their derivative."""
        key = np.asarray(x, dtype=float).tobytes()
        if key not in self._residuals:
            self._residuals.clear()
            self._residuals[key] = self._residuals_at(x)
        return self._residuals[key]

    def _residuals_at(self, x):
        of_force, of_turn, turn = self.at(x)
        n, (force, rate) = len(self.force.y), self.own.values()
        values = np.zeros(len(self.counted))
        jacobian = np.zeros((len(values), len(self.start)))
        values[:n], jacobian[:n, force] = self.force.residuals(of_force)
        rates, of_rates = turn.pose_rates(of_turn)
        values[n : 4 * n] = rates.ravel()
        jacobian[n : 4 * n, rate] = of_rates.reshape(3 * n, len(rate))
        found, rows = self.moves_at(x), self.moves
        change, first = self.force.derivative(of_force), turn.rotations.first
        by_force = found.by_start @ change[first] + found.by_end @ change[first + 1]
        if self.along:
            weighted = found.by_force * self.weights[..., None, None]
            by_force[:, 2:] += self.along.summed(weighted, of_force)
        values[rows] = found.values[..., 0]
        jacobian[rows[..., None], force] = by_force
        jacobian[rows[..., None], rate] = turn.summed(found.by_turn, of_turn)
        return values[self.counted], jacobian[self.counted][:, self.free]

    @cached_property
    def moves(self):
        """Rows of each move among all residuals, (m, 2 or 5): rotation, vertical, horizontal."""
        n, m = len(self.force.y), len(self.turn.rotations)
        blocks = [(4 * n, 2)] + [(4 * n + 2 * m, 1), (4 * n + 3 * m, 2)] * bool(self.along)
        return np.concatenate([s + np.arange(w * m).reshape(m, w) for s, w in blocks], axis=1)

    def of_moves(self, of_force, of_turn, turn):
        """Return the MoveResiduals; arguments as `at` returns them.

        A rotation takes gravity's direction u to ``Cᵀ u``, with C the attitude at its end; a turn φ
        on the axes at its start changes that by ``Cᵀ (u × φ)``.
        """
        path, first, u = turn.path(of_turn), turn.rotations.first, turn.departures
        carried, across = turn.carried(of_turn), self.across(of_force)
        by_turn = (carried @ cross_matrix(u))[:, None]
        rotation = (
            carried @ u[..., None],
            carried @ across[first],
            -turn.plane @ across[first + 1],
            by_turn @ path.middle,
        )
        if not self.along:
            return MoveResiduals(*rotation)
        frame = np.concatenate([u[:, None], tangents(u)], axis=1)
        pull = self.force.gravity * self.weights.sum(axis=1)[:, None, None]
        # a turn of all that follows adds φ × v, with v the velocity that is to come
        pushed = path.at_samples @ self.along.values(of_force)[..., None]
        gained = midpoints(pushed[..., 0]) * turn.rotations.steps[..., None]
        to_come = gained[:, ::-1].cumsum(axis=1)[:, ::-1] - gained / 2
        levers = -cross_matrix(to_come.reshape(-1, 3)).reshape(*to_come.shape, 3)
        velocity = (self.weights[:, None] @ pushed[..., 0]).swapaxes(1, 2) - pull * u[..., None]
        velocity = (
            frame @ velocity,
            -pull * frame @ across[first],
            0.0,
            frame[:, None] @ levers @ path.middle,
        )
        parts = []
        for own, expected in zip(velocity, rotation, strict=True):
            share = self.of_rotation if expected.ndim == 3 else self.of_rotation[:, None]
            parts.append(np.concatenate([expected, own - share @ expected], axis=-2))
        return MoveResiduals(*parts, frame[:, None] @ path.at_samples)

    def across(self, of_force):
        """Return what takes a change of specific force at the poses to one of its direction."""
        force = self.force.values(of_force)
        norm = np.linalg.norm(force, axis=1)[:, None, None]
        u = force[:, :, None] / norm
        return (np.eye(3) - u * u.swapaxes(1, 2)) / norm

    @cached_property
    def weights(self):
        """Weight of each sample in an integral by trapezoids, s, (m, k); `∫ dt` is their sum."""
        return at_both_ends(self.turn.rotations.steps / 2)
