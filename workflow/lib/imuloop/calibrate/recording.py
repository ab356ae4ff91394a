"""A recording: poses, the rotations between them, and the channels that effects depend on."""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial

import numpy as np

from imuloop.calibrate.contradictions import odd_turns
from imuloop.calibrate.poses import Poses, add_rounding, add_tilt_turns, gather_poses
from imuloop.calibrate.rotations import Lost, Rotations, gather_rotations
from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    OWN_TIME,
    TEMPERATURE,
    TIME,
    at_rail,
    filled,
    on_gyroscope_clock,
)
from imuloop.core.segments import DISTURBED
from imuloop.factors.factors import OWN
from imuloop.factors.means import ChannelMeans
from imuloop.model.effect import Channels, LoggedChannels


def identity(values):
    """Return the values themselves."""
    return values


@dataclass(frozen=True)
class Log:
    """The whole log of a session, N samples."""

    t: np.ndarray  # (N,): time, s
    f: np.ndarray  # (N, 3): specific force, m/s^2, nominal SI
    w: np.ndarray  # (N, 3): angular rate, rad/s, nominal SI
    temperature: np.ndarray | None  # (N,): degC, missing values interpolated; None if not logged
    clipped: np.ndarray  # (2, N): whether w, and whether f, is at the end of its range

    @classmethod
    def of(cls, samples, rails=None):
        """Return the Log of samples, a DataFrame or a dict of arrays.

        `rails` are the ends of the range of each channel, as in `core.samples.at_rail`.
        """
        t, temperature = np.asarray(samples[TIME]), None
        if TEMPERATURE in samples and np.isfinite(samples[TEMPERATURE]).any():
            temperature = filled(t, np.asarray(samples[TEMPERATURE]))
        sensors = ANGULAR_RATE, ACCELERATION
        w, f = (np.column_stack([samples[c] for c in axes]) for axes in sensors)
        clipped = np.array([at_rail(samples, rails or {}, axes) for axes in sensors])
        return cls(t, f, w, temperature, clipped)

    def evaluate(self, sensor, function, *constants, output=identity, see=identity):
        """Return the values of a function of a sensor's channels at all samples, (N, …).

        The function takes the channels of the whole log, of the sensor and with its `output`, and
        the constants. `output` converts values of the sensor, nominal SI, (N, 3), to
        ``K (raw - b)``; `see` converts values of the other sensor to those that an effect uses.
        """
        changes = zip((output, see), OWN[sensor], strict=True)
        outputs = (partial(change, getattr(self, name)) for change, name in changes)
        return function(LoggedChannels(self.t, self.temperature, *outputs), *constants)


@dataclass(frozen=True)
class Recording:
    """The poses of all usable sessions of one kind, and the rotations between them."""

    poses: Poses
    rotations: Rotations
    logs: tuple[Log, ...] = ()  # the Log of each session, for effects with a memory
    lost: Lost = field(default_factory=Lost)  # rotations and rests that were left out
    # whether an accelerometer is slower than its gyroscope, so that its samples are interpolated
    slow_force: bool = False
    # kind of the sessions, which names the method of the calibration
    kind: str = "multi_position"
    # what became of the sessions if there is no pose, text
    why_no_pose: str = "no multi_position session with a pose"

    @cached_property
    def means(self):
        """The ChannelMeans of the poses and of parts of the rotations."""
        return ChannelMeans(self.poses, self.rotations)

    def select(self, keep):
        """Return the Recording with the poses of a mask, and the rotations between two of them."""
        keep = np.asarray(keep)
        first = self.rotations.first
        rotations = self.rotations.select(keep[first] & keep[first + 1])
        # two poses with a rotation between them remain consecutive
        renumbered = replace(rotations, first=(np.cumsum(keep) - 1)[rotations.first])
        return replace(self, poses=self.poses.select(keep), rotations=renumbered)

    def of_new_power_cycles(self):
        """Return a copy of the Recording with negative numbers of power cycles.

        No calibration was fitted to power cycles with such numbers.
        """
        new = replace(self.poses, power_cycle=-1 - self.poses.power_cycle)
        return replace(self, poses=new)

    def pose_channels(self, sensor, output, other, see=identity):
        """Return the Channels that an effect of a sensor depends on, at the n poses.

        Parameters
        ----------
        sensor : str
            Name of the sensor.
        output : callable
            Converts values of the sensor, nominal SI, (n, 3), to ``K (raw - b)``, SI.
        other : ndarray, shape (n, 3)
            Values of the other sensor at the poses, SI.
        see : callable, optional
            Converts values of the other sensor in a log, nominal SI, (N, 3), to such as `other`.
        """
        poses = self.poses
        history = self._history(sensor, output, see, partial(pose_means, poses, self.logs))
        values = output(getattr(poses, OWN[sensor][0]))
        return Channels(poses.mid_s, values, other, poses.temperature, history, poses.power_cycle)

    def rotation_channels(self, sensor, output, other, see=identity):
        """Return the Channels that an effect of a sensor depends on, along the rotations.

        They have m k points: the k samples of the first rotation, then of the next. `other` has the
        shape (m, k, 3); all arguments have the same meaning as for `pose_channels`.
        """
        rotations, warmth = self.rotations, self.rotations.temperature
        session = self.poses.session[rotations.first]

        def select_samples(logged):
            """Return the values at the samples of the rotations, of an array per session."""
            rows = zip(session, rotations.t, strict=True)
            return np.concatenate([logged[s][np.searchsorted(self.logs[s].t, t)] for s, t in rows])

        history = self._history(sensor, output, see, select_samples)
        values = output(getattr(rotations, OWN[sensor][0]).reshape(-1, 3))
        warmth = None if warmth is None else warmth.ravel()
        cycle = self.poses.power_cycle[rotations.first].repeat(rotations.t.shape[1])
        return Channels(rotations.t.ravel(), values, other.reshape(-1, 3), warmth, history, cycle)

    def calibrated_force(self, calibration):
        """Return the specific force, m/s^2, at the poses, (n, 3), and along rotations, (m, k, 3).

        `calibration` is the SensorCalibration of the accelerometer.
        """
        poses, rotations = self.poses, self.rotations
        channels = self.pose_channels("accelerometer", calibration.output, poses.w)
        along = self.rotation_channels("accelerometer", calibration.output, rotations.w)
        turned = calibration.apply(rotations.f.reshape(-1, 3), along)
        return calibration.apply(poses.f, channels), turned.reshape(rotations.f.shape)

    def _history(self, sensor, output, see, reduce):
        """Return the function that `Channels.evaluate` calls.

        It evaluates a function of the channels of the whole log of each session. `reduce` converts
        the results, an array (N, …) by session, to values at the points of the Channels.
        """

        @cache
        def history(function, *constants):
            sessions, how = set(self.poses.session.tolist()), {"output": output, "see": see}
            return reduce(
                {s: self.logs[s].evaluate(sensor, function, *constants, **how) for s in sessions}
            )

        return history


def pose_means(poses, logs, logged):
    """Return the mean over each pose, (n, ...), of `logged`, an array (N, ...) per session.

    Takes the Poses and the Log of each session.
    """
    means = []
    for s, start, end in zip(poses.session, poses.start_s, poses.end_s, strict=True):
        first, last = np.searchsorted(logs[s].t, [start, end])
        means.append(logged[s][first:last].mean(axis=0))
    return np.array(means)


def record(samples, segments, longest_rotation, rails=None):
    """Return the Recording of several sessions.

    It has temperatures only if every session logs them.

    Parameters
    ----------
    samples, segments : sequence of DataFrame or dict of arrays
        The samples and the segments of each session.
    longest_rotation : float
        Longest rotation, s.
    rails : sequence of dict, optional
        Ends of the range of each channel, by session, as for `core.samples.at_rail`.
    """
    rails = rails or [{}] * len(samples)
    logs = tuple(map(Log.of, map(on_gyroscope_clock, samples), rails))
    poses = gather_poses(segments)
    add_rounding(poses, logs)
    add_tilt_turns(poses, logs)
    if len(poses) and all(log.temperature is not None for log in logs):
        temperature = pose_means(poses, logs, [log.temperature for log in logs])
        poses = replace(poses, temperature=temperature)
    rotations, lost = gather_rotations(poses, logs, segments, longest_rotation)
    recording = Recording(poses, rotations, logs, lost, any(map(_has_slow_force, samples)))
    odd, errors = odd_turns(recording)
    left_out = poses.session[rotations.first], rotations.start_s, rotations.end_s, errors
    contradicting = tuple(zip(*(values[odd].tolist() for values in left_out), strict=True))
    railed = sum(int(np.sum(np.asarray(table["kind"]) == DISTURBED)) for table in segments)
    lost = replace(lost, railed=railed, contradicting=contradicting)
    return replace(recording, rotations=rotations.select(~odd), lost=lost)


def _has_slow_force(samples):
    """Return whether fewer than two thirds of the rows have a new sample of the accelerometer."""
    own = samples.get(OWN_TIME["accelerometer"])
    return own is not None and np.mean(np.diff(own) > 0) < 2 / 3
