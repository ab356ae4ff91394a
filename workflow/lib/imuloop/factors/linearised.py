"""Residuals of all factors at one state, with their Jacobian and what factors share."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imuloop.core.rotation import exponential, matrix, multiply, prefix_product, step_vectors
from imuloop.factors.covariance import ResidualCovariance
from imuloop.factors.gravity_norm import gravity_norm
from imuloop.factors.rest_rate import rest_rate
from imuloop.factors.rotation import rotation
from imuloop.factors.velocity import velocity
from imuloop.model.state import BIAS, State


@dataclass(frozen=True)
class Linearised:
    """Residuals of n rests and m moves of k samples at a State.

    The norms of gravity come first, then the rates, then what moves leave, kind by kind.
    """

    measured: object  # Measurements
    state: State

    @cached_property
    def force(self):
        """The accelerometer's Sensor."""
        return self.state.sensor("accelerometer")

    @cached_property
    def force_at_rest(self):
        """Calibrated specific force of the rests, m/s^2, (n, 3)."""
        design, _ = self.measured.designs["accelerometer"]
        return self.force.values(self.measured.rests.f, design)

    @cached_property
    def force_along(self):
        """Calibrated specific force along the moves, m/s^2, (m, k, 3)."""
        _, design = self.measured.designs["accelerometer"]
        return self.force.values(self.measured.moves.f, design)

    @cached_property
    def up(self):
        """Direction of gravity at the rests, upward, (n, 3)."""
        return self.force_at_rest / np.linalg.norm(self.force_at_rest, axis=1, keepdims=True)

    @cached_property
    def across(self):
        """Derivative of that direction by calibrated specific force, (n, 3, 3)."""
        norm = np.linalg.norm(self.force_at_rest, axis=1)[:, None, None]
        return (np.eye(3) - self.up[:, :, None] * self.up[:, None]) / norm

    @cached_property
    def leaving(self):
        """Direction of gravity where each move starts, (m, 3): a rest may tilt by small turns."""
        first = self.measured.moves.first
        return self.up[first] + np.cross(self.up[first], self.measured.to_end[first])

    @cached_property
    def arriving(self):
        """Direction of gravity as measured where each move ends, (m, 3)."""
        last = self.measured.moves.first + 1
        return self.up[last] + np.cross(self.up[last], self.measured.to_start[last])

    @cached_property
    def attitudes(self):
        """Rotation from body axes to those at the start of a move.

        At the samples, (m, k, 3, 3), and in the middle of each step, (m, k - 1, 3, 3).
        """
        moves, (_, design) = self.measured.moves, self.measured.designs["gyroscope"]
        rates = self.state.sensor("gyroscope").values(moves.w, design)
        half = exponential(step_vectors(rates, moves.steps, moves.uneven) / 2)
        after = prefix_product(multiply(half, half))
        # the middle of a step is half a step back from its end
        half[..., 1:] *= -1
        start = np.tile(np.eye(3), (len(moves), 1, 1, 1))
        return np.concatenate([start, matrix(after)], axis=1), matrix(multiply(after, half))

    @cached_property
    def weights(self):
        """Weight of each sample in an integral by trapezoids, s, (m, k)."""
        return at_both_ends(self.measured.moves.steps / 2)

    @cached_property
    def move_rows(self):
        """The MoveRows of all factors of moves, those of the rotation first."""
        turned, factors = rotation(self), self.measured.factors
        if factors.quiet is None:
            return turned
        nothing = np.zeros((len(self.measured.moves), 3, 2))
        share = nothing if factors.share is None else factors.share
        return velocity(self, turned, share).after(turned)

    @cached_property
    def rest_rows(self):
        """The RestRows by sensor."""
        return self._rest_rows(self.state, self.measured.designs)

    def _rest_rows(self, state, designs):
        rests, gravity = self.measured.rests, self.measured.factors.gravity
        force, turn = (state.sensor(name) for name in designs)
        (of_force, _), (of_turn, _) = designs.values()
        return {
            "accelerometer": gravity_norm(force, rests.f, gravity, of_force),
            "gyroscope": rest_rate(turn, rests.w, of_turn),
        }

    @cached_property
    def places(self):
        """Places of each move's rows among all, (m, 2 or 5): rotation, vertical, horizontal."""
        n, m = len(self.measured.rests), len(self.measured.moves)
        blocks = [(4 * n, 2), (4 * n + 2 * m, 1), (4 * n + 3 * m, 2)]
        blocks = blocks[: 1 if self.measured.factors.quiet is None else 3]
        return np.concatenate([s + np.arange(w * m).reshape(m, w) for s, w in blocks], axis=1)

    @cached_property
    def residual(self):
        """All residuals that count, SI, (N,)."""
        values = np.zeros(len(self.measured.counted))
        at_rest = np.concatenate([rows.residual.ravel() for rows in self.rest_rows.values()])
        values[: len(at_rest)] = at_rest
        values[self.places] = self.move_rows.residual
        return values[self.measured.counted]

    @cached_property
    def jacobian(self):
        """Their derivative with respect to the state, (N, p)."""
        return self._derivative(self.state, self.measured.designs, self.rest_rows)

    def columns(self, effects):
        """Return the derivative with respect to more effects, of size zero, (N, q)."""
        state, designs = self.state.with_effects(effects), self.measured.designs_of(effects)
        rows = self._rest_rows(state, designs)
        return self._derivative(state, designs, rows)[:, len(self.state.x) :]

    def _derivative(self, state, designs, rest_rows):
        """Return the derivative of all residuals with respect to a State, by the chain rule."""
        measured, moves, rows = self.measured, self.measured.moves, self.move_rows
        made, start = np.zeros((len(measured.counted), len(state.x))), 0
        for sensor, at_rest in rest_rows.items():
            stop = start + at_rest.residual.size
            made[start:stop, state.places(sensor)] = np.concatenate(at_rest.jacobian)
            start = stop

        def add(sensor, places, weights, y, design):
            own = state.sensor(sensor).jacobian(weights, y, design)
            made[places[..., None], state.places(sensor)] += own

        (at_rest, along), (_, turned) = designs.values()
        for weights, at in ((rows.by_start, moves.first), (rows.by_end, moves.first + 1)):
            resting = measured.rests.f[at, None], at_rest[at, None]
            add("accelerometer", self.places, weights[:, None], *resting)
        if measured.factors.quiet is not None:
            weights = rows.by_force * self.weights[..., None, None]
            add("accelerometer", self.places[:, -weights.shape[2] :], weights, moves.f, along)
        # the rate of a step is the mean of those at its ends
        weights = at_both_ends(rows.by_turn * (moves.steps[..., None, None] / 2))
        add("gyroscope", self.places, weights, moves.w, turned)
        if measured.factors.bias_held:
            made[:, BIAS] = 0.0
        return made[measured.counted]

    @cached_property
    def noise(self):
        """The ResidualCovariance here."""
        return ResidualCovariance(self)


def at_both_ends(values):
    """Return at each sample the sum of the values of the steps beside it, (m, k, ...).

    Takes the values of the steps, (m, k - 1, ...).
    """
    found = np.zeros((len(values), values.shape[1] + 1, *values.shape[2:]))
    found[:, 1:] = values
    found[:, :-1] += values
    return found
