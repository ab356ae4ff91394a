"""A recording: poses, the rotations between them, and the channels that effects depend on.

A pose is an attitude in which the device rests. Nominal SI values are raw readings less the data
sheet's offset, times its scale. An effect is an error of a sensor that depends on channels: time,
output of both sensors, temperature.
"""

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
from imuloop.factors.covariance import ChannelMeans
from imuloop.factors.factors import OWN
from imuloop.model.effect import Channels, LoggedChannels


def identity(values):
    """Return `values` unchanged: the default where a conversion of values may be given."""
    return values


@dataclass(frozen=True)
class Log:
    """The whole log of a session, N samples: both sensors in nominal SI, and the temperature."""

    t: np.ndarray  # (N,): time, s
    f: np.ndarray  # (N, 3): specific force, m/s^2, nominal SI
    w: np.ndarray  # (N, 3): angular rate, rad/s, nominal SI
    temperature: np.ndarray | None  # (N,): degC, missing values interpolated; None if not logged
    clipped: np.ndarray  # (2, N): whether w, and whether f, is at the end of its range

    @classmethod
    def of(cls, samples, rails=None):
        """Return the Log of the samples of a session.

        `samples` is a DataFrame or a dict of arrays by the name of the column. `rails` has the ends
        of the range of each channel by name, (low, high), SI. An end is None if no sample reaches
        it. Without `rails` no sample counts as clipped.
        """
        t, temperature = np.asarray(samples[TIME]), None
        if TEMPERATURE in samples and np.isfinite(samples[TEMPERATURE]).any():
            temperature = filled(t, np.asarray(samples[TEMPERATURE]))
        sensors = ANGULAR_RATE, ACCELERATION
        w, f = (np.column_stack([samples[c] for c in axes]) for axes in sensors)
        clipped = np.array([at_rail(samples, rails or {}, axes) for axes in sensors])
        return cls(t=t, f=f, w=w, temperature=temperature, clipped=clipped)

    def channels(self, sensor, output=identity, align_other=identity):
        """Return the LoggedChannels on which an effect of a sensor depends, at all N samples.

        `sensor` is the name of the sensor. `output` is a function that converts its values from
        nominal SI, (N, 3), to the output ``K (raw - b)``, SI. `align_other` is a function that
        converts the values of the other sensor from nominal SI to calibrated SI. By default neither
        is converted.
        """
        own_name, other_name = OWN[sensor]
        return LoggedChannels(
            self.t,
            self.temperature,
            output=lambda: output(getattr(self, own_name)),
            other=lambda: align_other(getattr(self, other_name)),
        )


@dataclass(frozen=True)
class Recording:
    """The poses of all usable sessions of one kind, and the rotations between them."""

    poses: Poses
    rotations: Rotations
    logs: tuple[Log, ...] = ()  # the Log of each session, for effects with a memory
    lost: Lost = field(default_factory=Lost)  # rotations and rests that were left out
    # whether an accelerometer is slower than the gyroscope, so that its samples are interpolated
    slow_force: bool = False
    # kind of the sessions, which names the method of the calibration
    kind: str = "multi_position"
    # why no session has a pose, text; used only if none has a pose
    why_no_pose: str = "no multi_position session with a pose"

    @cached_property
    def means(self):
        """ChannelMeans, which give the covariance of the noise of means over poses and turns."""
        return ChannelMeans(self.poses, self.rotations)

    def select(self, keep):
        """Return the Recording with some of the n poses, and the rotations between them.

        `keep`, (n,) of bool, is the mask of the poses. A rotation stays if both its poses do.
        """
        keep = np.asarray(keep)
        first = self.rotations.first
        rotations = self.rotations.select(keep[first] & keep[first + 1])
        # two poses with a rotation between them remain consecutive
        renumbered = replace(rotations, first=(np.cumsum(keep) - 1)[rotations.first])
        return replace(self, poses=self.poses.select(keep), rotations=renumbered)

    def of_new_power_cycles(self):
        """Return a copy of the Recording whose power cycles are new to every calibration.

        A calibration may have a bias for each power cycle 0, 1, … that it was fitted to. The copy
        has negative numbers of power cycles, for which no calibration has a bias.
        """
        new = replace(self.poses, power_cycle=-1 - self.poses.power_cycle)
        return replace(self, poses=new)

    def pose_channels(self, sensor, output, other, align_other=identity):
        """Return the channels on which an effect of a sensor depends, at the n poses, Channels.

        Parameters
        ----------
        sensor : str
            Name of the sensor.
        output : callable
            Converts values of the sensor, nominal SI, (n, 3), to ``K (raw - b)``, SI.
        other : ndarray, shape (n, 3)
            Calibrated values of the other sensor at the poses, SI.
        align_other : callable, optional
            Converts the other sensor's samples in a whole log, (N, 3), from nominal to calibrated
            SI. It is for effects that depend on the whole log.
        """
        poses = self.poses
        return Channels(
            t=poses.mid_s,
            output=output(getattr(poses, OWN[sensor][0])),
            other=other,
            temperature=poses.temperature,
            history=self._history(
                sensor, output, align_other, partial(pose_means, poses, self.logs)
            ),
            power_cycle=poses.power_cycle,
        )

    def rotation_channels(self, sensor, output, other, align_other=identity):
        """Return the channels on which an effect of a sensor depends, along the m rotations.

        The Channels have m k points: the k samples of the first rotation, then of the next.

        Parameters
        ----------
        sensor : str
            Name of the sensor.
        output : callable
            Converts values of the sensor, nominal SI, (m k, 3), to ``K (raw - b)``, SI.
        other : ndarray, shape (m, k, 3)
            Calibrated values of the other sensor along the rotations, SI.
        align_other : callable, optional
            Converts the other sensor's samples in a whole log, (N, 3), from nominal to calibrated
            SI. It is for effects that depend on the whole log.
        """
        rotations, temperature = self.rotations, self.rotations.temperature
        session = self.poses.session[rotations.first]

        def select_samples(logged):
            """Return the values of the logs at the k samples of each of m rotations, (m k, …).

            `logged` is a dict by session of arrays (N, …), a value for each sample of the log.
            """
            # each time of a rotation is the time of a sample
            rows = zip(session, rotations.t, strict=True)
            return np.concatenate([logged[s][np.searchsorted(self.logs[s].t, t)] for s, t in rows])

        return Channels(
            t=rotations.t.ravel(),
            output=output(getattr(rotations, OWN[sensor][0]).reshape(-1, 3)),
            other=other.reshape(-1, 3),
            temperature=None if temperature is None else temperature.ravel(),
            history=self._history(sensor, output, align_other, select_samples),
            power_cycle=self.poses.power_cycle[rotations.first].repeat(rotations.t.shape[1]),
        )

    def calibrated_force(self, calibration):
        """Return the calibrated specific force, m/s^2, at the n poses and along the m rotations.

        The first result, (n, 3), has the force at the poses; the second, (m, k, 3), has it at the k
        samples of each rotation. `calibration` is the SensorCalibration of the accelerometer, with
        its effects. Effects that depend on the angular rate take this rate in nominal SI.
        """
        poses, rotations = self.poses, self.rotations
        at_poses = self.pose_channels("accelerometer", calibration.output, poses.w)
        along = self.rotation_channels("accelerometer", calibration.output, rotations.w)
        in_rotations = calibration.apply(rotations.f.reshape(-1, 3), along)
        return calibration.apply(poses.f, at_poses), in_rotations.reshape(rotations.f.shape)

    def without_effects(self, calibrations):
        """Return a copy of the Recording from which the effects of calibrations are subtracted.

        In the copy a change of the sensor during the recording can be told from these effects.
        `calibrations` is a dict of SensorCalibration by sensor. The effects are subtracted from the
        specific force and the angular rate of poses and rotations, nominal SI. Effects that depend
        on the other sensor take its values in nominal SI.
        """
        poses, rotations = self.poses, self.rotations
        for sensor, calibration in calibrations.items():
            if not calibration.effects:
                continue
            column, other = OWN[sensor]
            at_poses = self.pose_channels(sensor, calibration.output, getattr(self.poses, other))
            along = self.rotation_channels(
                sensor, calibration.output, getattr(self.rotations, other)
            )
            # from an error of the output K (raw - b) to one of nominal SI
            scale = calibration.raw_unit.scale / calibration.K
            for effect in calibration.effects:
                error = effect.output(at_poses) * scale
                poses = replace(poses, **{column: getattr(poses, column) - error})
                if sensor == "gyroscope":
                    poses = replace(poses, w_to_ends=poses.w_to_ends - error[:, None])
                values = getattr(rotations, column)
                in_moves = values - (effect.output(along) * scale).reshape(values.shape)
                rotations = replace(rotations, **{column: in_moves})
        return replace(self, poses=poses, rotations=rotations)

    def _history(self, sensor, output, align_other, gather):
        """Return the function `history` of Channels, for effects that depend on the whole log.

        ``history(function, *constants)`` evaluates ``function(channels, *constants)`` with the
        LoggedChannels of each session. It returns the values at the points of the Channels, such as
        poses or samples of rotations.

        Parameters
        ----------
        sensor : str
            Name of the sensor whose effects the channels are for.
        output, align_other : callable
            Convert values of the sensor from nominal SI to ``K (raw - b)``, and values of the other
            sensor from nominal to calibrated SI.
        gather : callable
            Function that picks the points: from a dict by session of arrays (N, …), the values at
            the N samples of the log, it returns the values at the points of the Channels.
        """

        @cache
        def history(function, *constants):
            """Evaluate `function` on each whole log, and return its values at the points wanted.

            The points are those of the Channels. `constants` are the arguments of `function` after
            the first one, the LoggedChannels of a log.
            """
            by_session = {}
            for session in set(self.poses.session.tolist()):
                channels = self.logs[session].channels(sensor, output, align_other)
                by_session[session] = function(channels, *constants)
            return gather(by_session)

        return history


def pose_means(poses, logs, logged):
    """Return the mean of a logged quantity over the samples of each of n poses, (n, ...).

    `logged` has for each session an array (N, ...), a value of the quantity for each of the N
    samples of its log. `poses` are the Poses, and `logs` has the Log of each session.
    """
    means = []
    for s, start, end in zip(poses.session, poses.start_s, poses.end_s, strict=True):
        first, last = np.searchsorted(logs[s].t, [start, end])
        means.append(logged[s][first:last].mean(axis=0))
    return np.array(means)


def record(samples, segments, longest_rotation, rails=None):
    """Return the Recording of several sessions: their poses, and the rotations between them.

    The poses have temperatures only if every session logs a temperature. Rotations that contradict
    all others (`odd_turns`) are left out.

    Parameters
    ----------
    samples, segments : sequence of DataFrame or dict of arrays
        For each session the table of its samples, SI, and the table of its segments: rests, moves,
        gaps.
    longest_rotation : float
        Longest rotation, s; longer ones are left out.
    rails : sequence of dict, optional
        For each session a dict with the ends of the range of a channel by its name, (low, high),
        SI. By default no sample counts as clipped.
    """
    rails = rails or [{}] * len(samples)
    logs = tuple(map(Log.of, map(on_gyroscope_clock, samples), rails))
    # the poses by the segments alone, to which the logs add further fields
    poses = gather_poses(segments)
    add_rounding(poses, logs)
    add_tilt_turns(poses, logs)
    if len(poses) and all(log.temperature is not None for log in logs):
        temperature = pose_means(poses, logs, [log.temperature for log in logs])
        poses = replace(poses, temperature=temperature)
    rotations, lost = gather_rotations(poses, logs, segments, longest_rotation)
    slow_force = any(map(_has_slow_force, samples))
    recording = Recording(poses, rotations, logs=logs, lost=lost, slow_force=slow_force)
    odd, errors = odd_turns(recording)
    # session, start, end and error of each rotation that contradicts the others
    left_out = poses.session[rotations.first], rotations.start_s, rotations.end_s, errors
    contradicting = tuple(zip(*(values[odd].tolist() for values in left_out), strict=True))
    railed = sum(int(np.sum(np.asarray(table["kind"]) == DISTURBED)) for table in segments)
    lost = replace(lost, railed=railed, contradicting=contradicting)
    return replace(recording, rotations=rotations.select(~odd), lost=lost)


def _has_slow_force(samples):
    """Return whether the accelerometer samples at less than two thirds of the gyroscope's rate.

    `samples` are columns by name with a row per sample of the gyroscope. The accelerometer's time
    stamps, if it has its own, tell in which rows its sample is new; without them the result is
    false.
    """
    stamps = samples.get(OWN_TIME["accelerometer"])
    return stamps is not None and np.mean(np.diff(stamps) > 0) < 2 / 3
