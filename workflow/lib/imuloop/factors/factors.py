"""The measurements of a recording that a fit uses, and the effects in them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.factors.linearised import Linearised
from imuloop.model.effect import effect_design
from imuloop.model.state import State

# kinds of residuals in the order of their rows: SI unit and number of components
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
# names of a sensor's own values in Poses, Rotations and Log, and of the other sensor's
OWN = {"accelerometer": ("f", "w"), "gyroscope": ("w", "f")}


@dataclass(frozen=True)
class Factors:
    """The choice of the measurements that count, which a fit uses.

    Attributes
    ----------
    gravity : float
        Local gravity, m/s^2.
    sensors : tuple of str
        Sensors whose data count.
    quiet : ndarray of bool, shape (m,), or None
        Whether the velocity of each move counts; None if none does.
    share : ndarray, shape (m, 3, 2), or None
        Velocity that a residual of the rotation predicts, m/s per rad; None for zero.
    bias_held : bool
        Whether the bias of the gyroscope is fixed at the mean of the prior.
    """

    gravity: float
    sensors: tuple = tuple(SENSORS)
    quiet: np.ndarray | None = None
    share: np.ndarray | None = None
    bias_held: bool = False

    @property
    def kinds(self):
        """Kinds of residuals that count, a dict with SI unit and number of components of each."""
        owners = {*self.sensors} if self.quiet is None else {*self.sensors, "motion"}
        kinds = {kind: KINDS[kind] for kind, owner in OWNER.items() if owner in owners}
        if "accelerometer" not in owners:
            # the residual of a rotation needs the direction of gravity
            kinds.pop("rotation", None)
        return kinds

    def every_row(self, recording):
        """Return four columns with a row for each residual of a Recording, counted or not.

        They are its kind, the index of the rest where it starts, the index of the rest where it
        ends, and whether it counts.
        """
        rests, first = np.arange(len(recording.poses)), recording.rotations.first
        columns, kinds = [], self.kinds
        for kind, (_, width) in KINDS.items():
            if kind in VELOCITY and self.quiet is None:
                continue
            ends = (rests, rests) if kind in AT_RESTS else (first, first + 1)
            counts = self.quiet if kind in VELOCITY else kind in kinds
            of_kind = np.broadcast_arrays(kind, *ends, counts)
            columns.append([np.repeat(column, width) for column in of_kind])
        return [np.concatenate(column) for column in zip(*columns, strict=True)]

    def rows(self, recording):
        """Return the rests, (N, 2), and the kind, (N,), of each residual that counts.

        The rests are the indices of those where the residual starts and ends.
        """
        kinds, start, end, counts = self.every_row(recording)
        return np.column_stack([start, end])[counts], kinds[counts]

    def owners(self, recording):
        """Return the sensor, or "motion", that each residual that counts measures, (N,) of str."""
        return np.array([OWNER[kind] for kind in self.rows(recording)[1].tolist()], dtype=str)

    def about(self, recording, state):
        """Return the Measurements of a Recording, with the effects linearised about a State."""
        if "accelerometer" not in self.sensors:
            # a dead accelerometer has no direction of gravity
            up = np.tile([0.0, 0.0, self.gravity], (len(recording.poses), 1))
            recording = replace(recording, poses=replace(recording.poses, f=up))
        return Measurements(self, recording, state)

    def without_rotation(self, recording, state, noise):
        """Return the Factors with the `share` that makes velocities independent of rotations.

        It follows from the covariance of both that the NoiseModel predicts at a State.
        """
        every = np.ones(len(recording.rotations), dtype=bool)
        at = replace(self, share=None, quiet=every).about(recording, state).at(state.x)
        block = at.noise.by(noise)[at.places[:, :, None], at.places[:, None]]
        share = np.linalg.solve(block[:, :2, :2], block[:, :2, 2:]).swapaxes(1, 2)
        return replace(self, share=share)


@dataclass(frozen=True)
class Measurements:
    """Rests and moves of a recording, with the effects linearised about the State `about`.

    The effects depend on calibrated values of both sensors, which are those of this State during
    the whole fit. So the effects are linear in their parameters.
    """

    factors: Factors
    recording: object
    about: State

    @property
    def rests(self):
        """The n rests, Poses."""
        return self.recording.poses

    @property
    def moves(self):
        """The m moves of k samples, Rotations."""
        return self.recording.rotations

    @cached_property
    def counted(self):
        """Whether each of all residuals counts."""
        return self.factors.every_row(self.recording)[3]

    @cached_property
    def designs(self):
        """Derivatives of the effects of the state, as `designs_with` returns them."""
        return self.designs_with(())

    def designs_with(self, effects):
        """Return the derivatives D of the effects of the state and of more effects, by sensor.

        D is the derivative of the sum of a sensor's effects with respect to their q parameters. It
        is given at the rests, (n, 3, q), and along the moves, (m, k, 3, q). The latter is None for
        the accelerometer if no velocity counts.
        """
        state, recording = self.about.with_effects(effects), self.recording
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
        """Return the Linearised factors at the parameters x, (p,)."""
        return Linearised(self, State(x, self.about.effects))


def _design(sensor, state, table, channels):
    """Return the derivative D of a sensor's effects at a State, (..., 3, q).

    `table` is the Poses or the Rotations, `channels` the method of the recording that returns their
    Channels.
    """
    y, other_y = (getattr(table, name) for name in OWN[sensor])
    effects = [e.effect for e in state.effects if e.sensor == sensor]
    model, (other,) = state.sensor(sensor), (s for s in SENSORS if s != sensor)
    if not (effects and len(y)):
        return np.zeros((*y.shape, len(model.p)))
    see = state.sensor(other).aligned
    inputs = channels(sensor, model.output, see(other_y), see)
    return effect_design(effects, inputs, model.p).reshape(*y.shape, len(model.p))
