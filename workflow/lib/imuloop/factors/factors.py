"""The measurements of a recording that a fit uses, and the effects in them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.factors.linearised import Linearised
from imuloop.model.effect import effect_design
from imuloop.model.state import State

# kinds of residuals, in their order in the fit: SI unit and number of components
KINDS = {
    "gravity_norm": ("m/s^2", 1),
    "pose_rate": ("rad/s", 3),
    "rotation": ("rad", 2),
    "velocity_vertical": ("m/s", 1),
    "velocity_horizontal": ("m/s", 2),
}
# sensor that each kind of residual measures; velocities measure both, "motion"
OWNER = {"gravity_norm": "accelerometer", "pose_rate": "gyroscope", "rotation": "gyroscope"}
OF_SENSOR = {s: tuple(kind for kind, owner in OWNER.items() if owner == s) for s in SENSORS}
AT_RESTS = ("gravity_norm", "pose_rate")
VELOCITY = ("velocity_vertical", "velocity_horizontal")
OWNER |= dict.fromkeys(VELOCITY, "motion")
# by sensor, the fields of Poses, Rotations and Log that have the values of this sensor, and those
# of the other sensor
OWN = {"accelerometer": ("f", "w"), "gyroscope": ("w", "f")}


@dataclass(frozen=True)
class Factors:
    """The choice of the residuals that count in a fit of rests and moves.

    Each rest gives residuals of the norm of gravity and of the angular rate. Each move, from one
    rest to the next, gives residuals of its rotation and of the velocity at its end.

    Attributes
    ----------
    gravity : float
        Local gravity, m/s^2.
    sensors : tuple of str
        Sensors whose data count.
    quiet : ndarray of bool, shape (m,), or None
        Whether each of m moves is quiet enough for the fit to use the velocity at its end; None if
        the fit uses no velocity.
    share : ndarray, shape (m, 3, 2), or None
        Velocity that a residual of the rotation of each of m moves predicts, m/s per rad. This
        velocity is subtracted from the residual of the velocity. None stands for zero.
    bias_held : bool
        Whether the bias of the gyroscope is fixed at its value before the fit.
    """

    gravity: float
    sensors: tuple = tuple(SENSORS)
    quiet: np.ndarray | None = None
    share: np.ndarray | None = None
    bias_held: bool = False

    @property
    def kinds(self):
        """Kinds of residuals that count in the fit, a dict.

        A key is the name of a kind; its value is a pair, the SI unit and the number of components.
        Rotations do not count without the accelerometer, as their residual needs its direction of
        gravity.
        """
        owners = {*self.sensors} if self.quiet is None else {*self.sensors, "motion"}
        kinds = {kind: KINDS[kind] for kind, owner in OWNER.items() if owner in owners}
        if "accelerometer" not in owners:
            # the residual of a rotation needs the direction of gravity, which the accelerometer
            # gives
            kinds.pop("rotation", None)
        return kinds

    def every_row(self, recording):
        """Return four arrays, (M,), that describe all M scalar residuals of a `recording`.

        1. The kind of each residual.
        2. The index of the rest where the residual starts.
        3. The index of the rest where it ends; for the residual of a rest, the same rest.
        4. Whether the fit uses the residual.

        If the fit uses no velocity, the arrays leave out all velocities.
        """
        rests, first = np.arange(len(recording.poses)), recording.rotations.first
        columns, kinds = [], self.kinds
        for kind, (_, width) in KINDS.items():
            if kind in VELOCITY and self.quiet is None:
                continue
            # a residual of a rest starts and ends there
            ends = (rests, rests) if kind in AT_RESTS else (first, first + 1)
            counts = self.quiet if kind in VELOCITY else kind in kinds
            by_residual = np.broadcast_arrays(kind, *ends, counts)
            # all components of a residual have the same values
            columns.append([np.repeat(column, width) for column in by_residual])
        return [np.concatenate(column) for column in zip(*columns, strict=True)]

    def rows(self, recording):
        """Return the rests, (N, 2) of int, and the kind, (N,) of str, of N residuals.

        They are the scalar residuals of the `recording` that the fit uses. The columns of the first
        array are the index of the rest where the residual starts, and of the rest where it ends.
        """
        kinds, start, end, counts = self.every_row(recording)
        return np.column_stack([start, end])[counts], kinds[counts]

    def owners(self, recording):
        """Return the owner of each of the N residuals of a `recording` in the fit, (N,) of str.

        The owner is the name of the sensor that the residual measures. A velocity depends on both
        sensors: its owner is "motion".
        """
        return np.array([OWNER[kind] for kind in self.rows(recording)[1].tolist()], dtype=str)

    def linearised_about(self, recording, state):
        """Return the Measurements of a `recording`, with the effects linearised about a `state`.

        Effects depend on calibrated values. The State gives these values during the whole fit: it
        has the parameters of both sensors and of the effects. If the accelerometer is not used (for
        example, it is dead), all poses get gravity along z as a placeholder. Then an effect of the
        specific force on the gyroscope is the same in all poses, as a bias is.
        """
        if "accelerometer" not in self.sensors:
            up = np.tile([0.0, 0.0, self.gravity], (len(recording.poses), 1))
            recording = replace(recording, poses=replace(recording.poses, f=up))
        return Measurements(self, recording, state)

    def without_rotation(self, recording, state, noise):
        """Return the Factors whose velocity residuals are independent of the rotation residuals.

        The residual of a rotation predicts a part of the velocity residual of the same move, as
        both have the same noise. The new Factors subtract this part, which is `share`, (m, 3, 2),
        times the residual of the rotation, for each of m moves. The share follows from the
        covariance of both residuals in the `recording`, at the State `state`, by the NoiseModel
        `noise`.
        """
        all_moves = np.ones(len(recording.rotations), dtype=bool)
        factors = replace(self, share=None, quiet=all_moves)
        linearised = factors.linearised_about(recording, state).at(state.x)
        index = linearised.places
        # (m, 5, 5): covariance of the five residuals of each move; two are of its rotation
        block = linearised.noise.by(noise)[index[:, :, None], index[:, None]]
        share = np.linalg.solve(block[:, :2, :2], block[:, :2, 2:]).swapaxes(1, 2)
        return replace(self, share=share)


@dataclass(frozen=True)
class Measurements:
    """Rests and moves of a recording, with the effects linearised about a State.

    `recording` is the Recording, and `factors` says which residuals of its rests and moves the fit
    uses. Effects depend on calibrated values of both sensors. The State `linearisation_point` gives
    these values during the whole fit, so that the effects are linear in their parameters.
    """

    factors: Factors
    recording: object
    linearisation_point: State

    @property
    def rests(self):
        """The n rests of the recording, Poses."""
        return self.recording.poses

    @property
    def moves(self):
        """The m moves of k samples between rests of the recording, Rotations."""
        return self.recording.rotations

    @cached_property
    def counted(self):
        """Whether the fit uses each of the M residuals of the recording, (M,) of bool."""
        return self.factors.every_row(self.recording)[3]

    @cached_property
    def designs(self):
        """Derivatives of the effects of both sensors, a dict with one pair for each sensor.

        A key is the name of a sensor. Its pair has the derivatives of the sum of the sensor's
        effects with respect to their q parameters. The first entry is taken at the n rests,
        (n, 3, q), the second at the k samples of each of m moves, (m, k, 3, q). The axis of length
        3 has the axes of the sensor. The second entry is None for the accelerometer if the fit uses
        no velocity.
        """
        return self.designs_at(self.linearisation_point)

    def designs_at(self, state):
        """Return the derivatives of the effects in a State, the argument `state`, a dict of pairs.

        A key is the name of a sensor. Its pair has the derivatives of the sum of the sensor's
        effects with respect to their q parameters, at the calibrated values by this State. The
        first entry is taken at the n rests, (n, 3, q), the second at the k samples of each of m
        moves, (m, k, 3, q). The axis of length 3 has the axes of the sensor. The second entry is
        None for the accelerometer if the fit uses no velocity.
        """
        recording = self.recording
        return {
            sensor: (
                _design(sensor, state, self.rests, recording.pose_channels),
                _design(sensor, state, self.moves, recording.rotation_channels)
                if sensor == "gyroscope" or self.factors.quiet is not None
                else None,
            )
            for sensor in SENSORS
        }

    def at(self, x):
        """Return the residuals and their Jacobian at the parameters `x`, a Linearised.

        `x`, (p,), has the parameters of both sensors, then those of the effects.
        """
        return Linearised(self, State(x, self.linearisation_point.effects))


def _design(sensor, state, table, channels):
    """Return the derivative of the sum of a sensor's effects by their q parameters, (..., 3, q).

    The axis of length 3 has the axes of the sensor, whose name is `sensor`. The derivative is taken
    at the values in `table`: the Poses, then the result is (n, 3, q) for n rests, or the Rotations,
    then it is (m, k, 3, q) for k samples of m moves. `state` has the effects and the calibration.
    `channels` is the method of the recording that returns the inputs of effects at these values.
    """
    # values of the sensor and of the other one, nominal SI
    y, other_y = (getattr(table, name) for name in OWN[sensor])
    effects = [e.effect for e in state.effects if e.sensor == sensor]
    model, (other,) = state.sensor(sensor), (s for s in SENSORS if s != sensor)
    if not (effects and len(y)):
        return np.zeros((*y.shape, len(model.p)))
    # effects depend on the values of the other sensor, which are calibrated by its T, K and b only
    align = state.sensor(other).aligned
    inputs = channels(sensor, output=model.output, other=align(other_y), align_other=align)
    return effect_design(effects, inputs, model.p).reshape(*y.shape, len(model.p))
