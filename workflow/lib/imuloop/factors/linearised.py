"""Residuals of all factors at one state, with their Jacobian and intermediate values."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imuloop.core.rotation import exponential, matrix, multiply, prefix_product, step_vectors
from imuloop.core.samples import SENSORS
from imuloop.factors.covariance import ResidualCovariance
from imuloop.factors.rows import cross_matrix, gravity_norm, rest_rate, rotation, velocity
from imuloop.model.state import BIAS, COUNT, NAMES, State


@dataclass(frozen=True)
class MoveTerm:
    """One of several terms whose sum is the derivative of the residuals of m moves.

    The residuals depend on calibrated values of both sensors. A term is the part of the derivative
    that comes through k values of one sensor for each move. These are the k samples of the move, or
    the mean over the rest before or after it; then k is one. The term enters the last a residuals
    of each move.
    """

    sensor: str
    # (m, k, a, 3): derivative of the residuals with respect to the calibrated values
    weights: np.ndarray
    y: np.ndarray  # (m, k, 3): the values before calibration, nominal SI
    rest: np.ndarray | None = None  # (m,): index of the rest; None for the samples of the move

    def design(self, designs):
        """Return the derivative of the sensor's effects at the values of the term, (m, k, 3, q).

        The values are k values on three axes for each of m moves. The derivative is with respect to
        the q parameters of the effects. `designs` has by sensor a pair of derivatives: at the n
        rests, (n, 3, q), and at the samples of the moves, (m, k, 3, q).
        """
        at_rests, along = designs[self.sensor]
        return along if self.rest is None else at_rests[self.rest, None]

    def rows(self, places):
        """Return the indices of those a residuals of each move that the term enters, (m, a, 1).

        By them the term is added to the right rows of the Jacobian. The last axis, of length one,
        is there to combine them with numbers of columns. `places`, (m, 2 or 5), has the indices of
        all residuals of each of m moves. The term enters the last a of them: a force during the
        move changes only the velocities.
        """
        return places[:, -self.weights.shape[2] :, None]


class Linearised:
    """Residuals of n rests and m moves of k samples, with their Jacobian, at given parameters.

    Each kind of residual is a factor of the fit. A move lies between two rests.

    Attributes
    ----------
    measured, state : Measurements, State
        The rests and moves, and the p parameters of both sensors and of their effects.
    force, turn : Sensor
        The accelerometer and the gyroscope with these parameters.
    force_at_rest : ndarray, shape (n, 3)
        Calibrated specific force at the rests, m/s^2.
    up : ndarray, shape (n, 3)
        Direction of `force_at_rest`, a unit vector.
    across : ndarray, shape (n, 3, 3)
        Derivative of `up` with respect to `force_at_rest`.
    leaving, arriving : ndarray, shape (m, 3)
        Upward direction at the start and at the end of each move, as the accelerometer measures it
        at the rests.
    after : ndarray, shape (m, k - 1, 4)
        Attitude after each time step, quaternions that take the body axes then to those at the
        start of the move.
    attitude_within : ndarray, shape (m, k - 1, 3, 3)
        Attitude in the middle of each time step, matrices that take the body axes then to those at
        the start of the move.
    weights : ndarray, shape (m, k)
        Weights w, s: by the trapezoid rule, ``Σ w x`` over the samples x of a move is their
        integral over time.
    move_rows : MoveRows
        Rows of all factors of the moves: rotations first, then velocities.
    places : ndarray of int, shape (m, 2 or 5)
        Indices of the residuals of each move among all residuals, whose order is: norms of gravity,
        rates, rotations, vertical velocities, horizontal velocities.
    """

    def __init__(self, measured, state):
        """Compute the attributes, which several residuals share, from Measurements and a State."""
        self.measured, self.state = measured, state
        rests, moves, factors = measured.rests, measured.moves, measured.factors
        # derivative of the sum of a sensor's effects with respect to their parameters: of the
        # accelerometer at rests, of the gyroscope at rests and along moves
        (of_force, _), (at_rests, along) = measured.designs.values()
        self.sensors = {name: state.sensor(name) for name in SENSORS}
        self.force, self.turn = self.sensors.values()
        self.force_at_rest = self.force.values(rests.f, of_force)
        norm = np.linalg.norm(self.force_at_rest, axis=1, keepdims=True)
        up = self.up = self.force_at_rest / norm
        self.across = (np.eye(3) - up[:, :, None] * up[:, None]) / norm[..., None]
        # upward directions at the start and end of each rest, which differ if the device tilts in
        # it. The rotation from the mean attitude to either end is an angular rate times a time
        rate = self.turn.values(rests.w_to_ends, at_rests[:, None])
        start, end = np.moveaxis(np.cross(up[:, None], rate * rests.to_ends_s[..., None]), 1, 0)
        self.leaving, self.arriving = (up + end)[moves.first], (up + start)[moves.first + 1]
        # rotation vectors of the time steps
        turns = step_vectors(self.turn.values(moves.w, along), moves.steps, moves.uneven)
        half = exponential(turns / 2)
        self.after = prefix_product(multiply(half, half))
        # the middle of a step is half a step back from its end
        half[..., 1:] *= -1
        self.attitude_within = matrix(multiply(self.after, half))
        self.weights = add_at_both_ends(moves.steps / 2)
        # for each kind of residual of a move, index of the first and number of components: a rest
        # has one residual of the norm of gravity and three of the rate, so 4 n come before
        self.move_rows, blocks = rotation(self), [(4 * len(rests), 2)]
        if factors.quiet is not None:
            self.move_rows = velocity(self, self.move_rows, factors.share)
            blocks += [(4 * len(rests) + 2 * len(moves), 1), (4 * len(rests) + 3 * len(moves), 2)]
        number = np.arange(len(moves))[:, None]
        places = [first + width * number + np.arange(width) for first, width in blocks]
        self.places = np.concatenate(places, axis=1)

    @cached_property
    def rest_rows(self):
        """Residuals at rests and their derivatives, RestRows of accelerometer and gyroscope."""
        rests, gravity = self.measured.rests, self.measured.factors.gravity
        (of_force, _), (of_rate, _) = self.measured.designs.values()
        return (
            gravity_norm(self.force, rests.f, gravity, of_force),
            rest_rate(self.turn, rests.w, of_rate),
        )

    @property
    def residual(self):
        """The N residuals that the fit uses, SI, (N,)."""
        values = np.zeros(len(self.measured.counted))
        at_rest = np.concatenate([rows.residual.ravel() for rows in self.rest_rows])
        values[: len(at_rest)] = at_rest
        values[self.places] = self.move_rows.residual[..., 0]
        return values[self.measured.counted]

    @cached_property
    def move_terms(self):
        """Terms whose sum is the derivative of the residuals of moves, a list of MoveTerm.

        The derivative is with respect to the calibrated values of both sensors.
        """
        rests, moves, rows = self.measured.rests, self.measured.moves, self.move_rows
        # the rate of a step is the mean of the rates at its ends
        by_rate = add_at_both_ends(rows.by_turn * (moves.steps[..., None, None] / 2))
        terms = [MoveTerm(sensor="gyroscope", weights=by_rate, y=moves.w)]
        # a move starts at the end, 1, of a rest, and ends at the start, 0, of the next
        ends = (rows.by_start, moves.first, 1), (rows.by_end, moves.first + 1, 0)
        for by_force, rest, end in ends:
            weights, mean = by_force[:, None], rests.f[rest, None]
            terms.append(MoveTerm(sensor="accelerometer", weights=weights, y=mean, rest=rest))
            # the rotation within a rest that tilts turns the direction of the force there
            by_turn = by_force @ cross_matrix(self.force_at_rest[rest])
            by_turn = by_turn * rests.to_ends_s[rest, end, None, None]
            mean = rests.w_to_ends[rest, end, None]
            terms.append(MoveTerm(sensor="gyroscope", weights=by_turn[:, None], y=mean, rest=rest))
        if rows.by_force is not None:
            by_force = rows.by_force * self.weights[..., None, None]
            terms.append(MoveTerm(sensor="accelerometer", weights=by_force, y=moves.f))
        return terms

    @cached_property
    def jacobian(self):
        """Derivative of the N residuals that the fit uses with respect to the p parameters, (N, p).

        The parameters are those of both sensors, then those of their effects.
        """
        designs, state = self.measured.designs, self.state
        jacobian, start = np.zeros((len(self.measured.counted), len(state.x))), 0
        for sensor, at_rest in zip(SENSORS, self.rest_rows, strict=True):
            stop = start + at_rest.residual.size
            jacobian[start:stop, state.places(sensor)] = np.concatenate(at_rest.jacobian)
            start = stop
        for term in self.move_terms:
            sensor, design = self.sensors[term.sensor], term.design(designs)
            change = sensor.jacobian(term.weights, term.y, design)
            jacobian[term.rows(self.places), state.places(term.sensor)] += change
        if self.measured.factors.bias_held:
            jacobian[:, BIAS] = 0.0
        return jacobian[self.measured.counted]

    def columns(self, effects):
        """Return the derivative of the N residuals by effects that the state lacks, (N, q).

        `effects` is a sequence of SensorEffect with q parameters. The derivative is taken where
        these parameters are zero, so it shows how the residuals would change if an effect were
        added. There is a row for each residual that the fit uses.
        """
        state = State(self.measured.linearisation_point.x[:COUNT]).with_effects(effects)
        designs, n = self.measured.designs_at(state), len(self.measured.rests)
        places = {s: state.places(s)[len(NAMES[s]) :] - COUNT for s in SENSORS}
        columns = np.zeros((len(self.measured.counted), len(state.x) - COUNT))
        (of_force, _), (of_rate, _) = designs.values()
        # at a rest the norm of gravity changes along the upward direction, (n, k, a, 3)
        norm = self.force.effect_jacobian(self.up[:, None, None], of_force[:, None])
        columns[:n, places["accelerometer"]] = norm[:, 0]
        columns[n : 4 * n, places["gyroscope"]] = -np.concatenate(of_rate)
        for term in self.move_terms:
            # most variants of effects belong to one sensor, so the other one is skipped
            if len(index := places[term.sensor]):
                sensor, design = self.sensors[term.sensor], term.design(designs)
                change = sensor.effect_jacobian(term.weights, design)
                columns[term.rows(self.places), index] += change
        return columns[self.measured.counted]

    @cached_property
    def noise(self):
        """The ResidualCovariance, which gives the covariance of these residuals by noise."""
        return ResidualCovariance(self)


def add_at_both_ends(values):
    """Return for each sample the sum of the values of the time steps next to it, (m, k, ...).

    `values`, (m, k - 1, ...), belong to the steps between the k samples of each of m moves. The
    first and the last sample have one step only. With half the lengths of the steps as values, the
    result has the weights of the trapezoid rule.
    """
    sums = np.zeros((len(values), values.shape[1] + 1, *values.shape[2:]))
    sums[:, 1:] = values
    sums[:, :-1] += values
    return sums
