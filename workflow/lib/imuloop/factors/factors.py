"""Which measurements of a recording count, and what effects add to them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from imuloop.core.effect import effect_design
from imuloop.core.samples import SENSORS
from imuloop.factors.linearised import Linearised
from imuloop.model.state import State

# kinds of residuals in the order of their rows: SI unit, components, and whose they are
KINDS = {
    "gravity_norm": ("m/s^2", 1),
    "pose_rate": ("rad/s", 3),
    "rotation": ("rad", 2),
    "velocity_vertical": ("m/s", 1),
    "velocity_horizontal": ("m/s", 2),
}
OWNER = {"gravity_norm": "accelerometer", "pose_rate": "gyroscope", "rotation": "gyroscope"}
OF_SENSOR = {s: tuple(kind for kind, owner in OWNER.items() if owner == s) for s in SENSORS}
AT_RESTS = ("gravity_norm", "pose_rate")
VELOCITY = ("velocity_vertical", "velocity_horizontal")
OWNER |= dict.fromkeys(VELOCITY, "motion")
# a sensor's own channels of rests and moves, and the other sensor's
OWN = {"accelerometer": ("f", "w"), "gyroscope": ("w", "f")}


@dataclass(frozen=True)
class Factors:
    """Which measurements count.

    Attributes
    ----------
    gravity : float
        Local gravity, m/s^2.
    sensors : tuple of str
        Sensors whose data count.
    quiet : ndarray of bool, shape (m,), or None
        Whether the velocity of a move counts; None where none does.
    share : ndarray, shape (m, 3, 2), or None
        As in `velocity`; None for none.
    bias_held : bool
        Whether the bias of the gyroscope stays as the prior has it.
    """

    gravity: float
    sensors: tuple = tuple(SENSORS)
    quiet: np.ndarray | None = None
    share: np.ndarray | None = None
    bias_held: bool = False

    @property
    def kinds(self):
        """Kinds of residuals that count, with SI unit and number of components."""
        known = {*self.sensors} if self.quiet is None else {*self.sensors, "motion"}
        kinds = {kind: KINDS[kind] for kind, owner in OWNER.items() if owner in known}
        if "accelerometer" not in known:
            # a rotation carries the direction of gravity
            kinds.pop("rotation", None)
        return kinds

    def every_row(self, recording):
        """Return kind, rests where it starts and ends, and whether it counts, of each residual."""
        rests, first = np.arange(len(recording.poses)), recording.rotations.first
        found, kinds = [], self.kinds
        for kind, (_, width) in KINDS.items():
            if kind in VELOCITY and self.quiet is None:
                continue
            ends = (rests, rests) if kind in AT_RESTS else (first, first + 1)
            counts = self.quiet if kind in VELOCITY else kind in kinds
            each = np.broadcast_arrays(kind, *ends, counts)
            found.append([np.repeat(column, width) for column in each])
        return [np.concatenate(column) for column in zip(*found, strict=True)]

    def rows(self, recording):
        """Return the rests where each residual that counts starts and ends, and its kind, (N,)."""
        kinds, start, end, counts = self.every_row(recording)
        return np.column_stack([start, end])[counts], kinds[counts]

    def owners(self, recording):
        """Return the `OWNER` of each residual that counts, (N,) of str."""
        return np.array([OWNER[kind] for kind in self.rows(recording)[1].tolist()], dtype=str)

    def about(self, recording, state):
        """Return the Measurements of a recording, effects seen with the parameters of a State."""
        if "accelerometer" not in self.sensors:
            # a dead accelerometer has no direction of gravity
            up = np.tile([0.0, 0.0, self.gravity], (len(recording.poses), 1))
            recording = replace(recording, poses=replace(recording.poses, f=up))
        return Measurements(self, recording, state)

    def without_rotation(self, recording, state, noise):
        """Return the same, velocities less what the noise has in common with rotations.

        By the NoiseModel, at a State.
        """
        every = np.ones(len(recording.rotations), dtype=bool)
        at = replace(self, share=None, quiet=every).about(recording, state).at(state.x)
        block = at.noise.by(noise)[at.places[:, :, None], at.places[:, None]]
        share = np.linalg.solve(block[:, :2, :2], block[:, :2, 2:]).swapaxes(1, 2)
        return replace(self, share=share)


@dataclass(frozen=True)
class Measurements:
    """Rests and moves of a recording, with effects as they are seen with the parameters `about`.

    What effects add is straight in their parameters then, and so it stays in a fit.
    """

    factors: Factors
    recording: object
    about: State

    @property
    def rests(self):
        """The Poses, n of them."""
        return self.recording.poses

    @property
    def moves(self):
        """The Rotations, m of k samples."""
        return self.recording.rotations

    @cached_property
    def counted(self):
        """Which of all residuals count."""
        return self.factors.every_row(self.recording)[3]

    @cached_property
    def designs(self):
        """As `designs_with` no more effects."""
        return self.designs_with(())

    def designs_with(self, effects):
        """Return of each sensor D, as in `Sensor`, of the effects of the state and of more.

        At rests, (n, 3, q), and along moves, (m, k, 3, q), the latter None where nothing asks.
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
        """Return the Linearised factors with parameters x, (p,)."""
        return Linearised(self, State(x, self.about.effects))


def _design(sensor, state, table, channels):
    """Return D of a sensor's effects in Poses or Rotations, (..., 3, q), at a State.

    Takes what gives their channels.
    """
    y, beside = (getattr(table, name) for name in OWN[sensor])
    effects = [e.effect for e in state.effects if e.sensor == sensor]
    own, (other,) = state.sensor(sensor), (s for s in SENSORS if s != sensor)
    if not (effects and len(y)):
        return np.zeros((*y.shape, len(own.p)))
    see = state.sensor(other).aligned
    seen = channels(sensor, own.output, see(beside), see)
    return effect_design(effects, seen, own.p).reshape(*y.shape, len(own.p))
