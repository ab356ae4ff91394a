"""Residuals of all factors at one state, with their Jacobian and intermediate values."""

from functools import cached_property

import numpy as np

from imuloop.core.rotation import exponential, matrix, multiply, prefix_product, step_vectors
from imuloop.core.samples import SENSORS
from imuloop.factors.covariance import ResidualCovariance
from imuloop.factors.gravity_norm import gravity_norm
from imuloop.factors.rest_rate import rest_rate
from imuloop.factors.rotation import rotation
from imuloop.factors.velocity import velocity
from imuloop.model.state import BIAS


class Linearised:
    """The factors of n rests and m moves of k samples, linearised at a state.

    Attributes
    ----------
    measured, state : Measurements, State
        The measurements, and the parameters, p of them.
    force : Sensor
        The accelerometer.
    force_at_rest : ndarray, shape (n, 3)
        Calibrated specific force at the rests, m/s^2.
    across : ndarray, shape (n, 3, 3)
        Derivative of the direction of `force_at_rest` with respect to `force_at_rest`.
    leaving, arriving : ndarray, shape (m, 3)
        Upward direction at the start and at the end of each move, as the accelerometer measures it
        at the rests.
    after : ndarray, shape (m, k - 1, 4)
        Attitude after each step relative to the start of the move, quaternions that take body axes
        to the axes at the start.
    attitude_within : ndarray, shape (m, k - 1, 3, 3)
        Attitude in the middle of each step relative to the start of the move, rotation matrices.
    weights : ndarray, shape (m, k)
        Weight of each sample in an integral by trapezoids, s.
    move_rows : MoveRows
        Rows of all factors of the moves: rotations first, then velocities.
    places : ndarray of int, shape (m, 2 or 5)
        Indices of the residuals of each move among all residuals, whose order is: norms of gravity,
        rates, rotations, vertical velocities, horizontal velocities.
    """

    def __init__(self, measured, state):
        self.measured, self.state = measured, state
        rests, moves, factors = measured.rests, measured.moves, measured.factors
        (of_force, _), (_, along) = measured.designs.values()
        self.force, turn = (state.sensor(name) for name in SENSORS)
        self.force_at_rest = self.force.values(rests.f, of_force)
        norm = np.linalg.norm(self.force_at_rest, axis=1, keepdims=True)
        up = self.force_at_rest / norm
        self.across = (np.eye(3) - up[:, :, None] * up[:, None]) / norm[..., None]
        # the small turns within a rest that tilts are calibrated as angular rates are
        gain = measured.about.sensor("gyroscope").gain.T
        start, end = (up + np.cross(up, small @ gain) for small in (rests.to_start, rests.to_end))
        self.leaving, self.arriving = end[moves.first], start[moves.first + 1]
        turns = step_vectors(turn.values(moves.w, along), moves.steps, moves.uneven)
        half = exponential(turns / 2)
        self.after = prefix_product(multiply(half, half))
        # the middle of a step is half a step back from its end
        half[..., 1:] *= -1
        self.attitude_within = matrix(multiply(self.after, half))
        self.weights = add_at_both_ends(moves.steps / 2)
        self.move_rows, blocks = rotation(self), [(4 * len(rests), 2)]
        if factors.quiet is not None:
            self.move_rows = velocity(self, self.move_rows, factors.share)
            blocks += [(4 * len(rests) + 2 * len(moves), 1), (4 * len(rests) + 3 * len(moves), 2)]
        number = np.arange(len(moves))[:, None]
        places = [first + width * number + np.arange(width) for first, width in blocks]
        self.places = np.concatenate(places, axis=1)

    def _rest_rows(self, state, designs):
        """Return the RestRows of both sensors at a State, with the derivatives of its effects."""
        rests, (of_force, of_turn) = self.measured.rests, (at for at, _ in designs.values())
        force, turn = (state.sensor(name) for name in SENSORS)
        gravity = self.measured.factors.gravity
        return gravity_norm(force, rests.f, gravity, of_force), rest_rate(turn, rests.w, of_turn)

    @cached_property
    def rest_rows(self):
        """The RestRows of the accelerometer and of the gyroscope."""
        return self._rest_rows(self.state, self.measured.designs)

    @property
    def residual(self):
        """Residuals that count, SI, (N,)."""
        values = np.zeros(len(self.measured.counted))
        at_rest = np.concatenate([rows.residual.ravel() for rows in self.rest_rows])
        values[: len(at_rest)] = at_rest
        values[self.places] = self.move_rows.residual[..., 0]
        return values[self.measured.counted]

    @cached_property
    def jacobian(self):
        """Derivative of the residuals that count with respect to the state, (N, p)."""
        return self._jacobian(self.state, self.measured.designs, self.rest_rows)

    def columns(self, effects):
        """Return the derivative of the residuals with respect to more effects of size zero, (N, q).

        q is the number of parameters of these effects, a sequence of SensorEffect.
        """
        state, designs = self.state.with_effects(effects), self.measured.designs_with(effects)
        jacobian = self._jacobian(state, designs, self._rest_rows(state, designs))
        return jacobian[:, len(self.state.x) :]

    def _jacobian(self, state, designs, rest_rows):
        """Return the derivative of the residuals with respect to a State, by the chain rule.

        `designs` are the derivatives of its effects, `rest_rows` the RestRows of both sensors.
        """
        rests, moves, rows = self.measured.rests, self.measured.moves, self.move_rows
        jacobian, start = np.zeros((len(self.measured.counted), len(state.x))), 0

        def add(sensor, places, weights, y, design):
            change = state.sensor(sensor).jacobian(weights, y, design)
            jacobian[places[..., None], state.places(sensor)] += change

        for sensor, at_rest in zip(SENSORS, rest_rows, strict=True):
            stop = start + at_rest.residual.size
            jacobian[start:stop, state.places(sensor)] = np.concatenate(at_rest.jacobian)
            start = stop
        (resting, pushed), (_, turned) = designs.values()
        for weights, at in ((rows.by_start, moves.first), (rows.by_end, moves.first + 1)):
            values = rests.f[at, None], resting[at, None]
            add("accelerometer", self.places, weights[:, None], *values)
        # the rate of a step is the mean of those at its ends
        weights = add_at_both_ends(rows.by_turn * (moves.steps[..., None, None] / 2))
        add("gyroscope", self.places, weights, moves.w, turned)
        if rows.by_force is not None:
            weights = rows.by_force * self.weights[..., None, None]
            add("accelerometer", self.places[:, -weights.shape[2] :], weights, moves.f, pushed)
        if self.measured.factors.bias_held:
            jacobian[:, BIAS] = 0.0
        return jacobian[self.measured.counted]

    @cached_property
    def noise(self):
        """The ResidualCovariance at this state."""
        return ResidualCovariance(self)


def add_at_both_ends(values):
    """Return, for each sample, the sum of the values of the steps before and after it, (m, k, ...).

    Takes the values of the steps, (m, k - 1, ...).
    """
    sums = np.zeros((len(values), values.shape[1] + 1, *values.shape[2:]))
    sums[:, 1:] = values
    sums[:, :-1] += values
    return sums
