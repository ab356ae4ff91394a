"""A recording: poses, the rotations between them, and what an effect can see at both."""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial

import numpy as np

from imuloop.calibrate.contradictions import odd_turns
from imuloop.calibrate.errors_of_time import Lost
from imuloop.calibrate.poses import (
    Poses,
    Rotations,
    add_rounding,
    add_tilt_turns,
    gather_poses,
    gather_rotations,
)
from imuloop.core.effect import Channels, LoggedChannels
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


def unchanged(values):
    """Return values as they are."""
    return values


@dataclass(frozen=True)
class Log:
    """The whole log of a session: specific force and angular rate, (N, 3), SI as logged.

    Missing values of the temperature, degC, are interpolated; None where none was logged.
    """

    t: np.ndarray
    f: np.ndarray
    w: np.ndarray
    temperature: np.ndarray | None

    @classmethod
    def of(cls, samples):
        """Return the log that samples (DataFrame or dict of arrays) hold."""
        t, temperature = np.asarray(samples[TIME]), None
        if TEMPERATURE in samples and np.isfinite(samples[TEMPERATURE]).any():
            temperature = filled(t, np.asarray(samples[TEMPERATURE]))
        sensors = (ACCELERATION, ANGULAR_RATE)
        f, w = (np.column_stack([samples[c] for c in axes]) for axes in sensors)
        return cls(t, f, w, temperature)

    def evaluate(self, sensor, function, *constants, output=unchanged, see=unchanged):
        """Return a function, as in `Channels.evaluate`, of a sensor's channels, (N, …).

        `output` and `see` are as in `Recording.pose_channels`.
        """
        changes = zip((output, see), OWN[sensor], strict=True)
        outputs = (partial(change, getattr(self, name)) for change, name in changes)
        return function(LoggedChannels(self.t, self.temperature, *outputs), *constants)


@dataclass(frozen=True)
class Recording:
    """The poses and rotations of all usable sessions of one kind.

    Without rotations where only poses are looked at. The whole log of each session is for effects
    with a memory. With `slow_force` an accelerometer is slower than its gyroscope: interpolated.
    """

    poses: Poses
    rotations: Rotations | None = None
    logs: tuple[Log, ...] = ()
    lost: Lost = field(default_factory=Lost)
    slow_force: bool = False

    @cached_property
    def means(self):
        """The ChannelMeans at the poses and over parts of the rotations."""
        return ChannelMeans(self.poses, self.rotations)

    def select(self, keep):
        """Return the poses of a mask and the rotations with both ends among them."""
        keep = np.asarray(keep)
        first = self.rotations.first
        rotations = self.rotations.select(keep[first] & keep[first + 1])
        # neighbours that were both kept stay neighbours
        renumbered = replace(rotations, first=(np.cumsum(keep) - 1)[rotations.first])
        return replace(self, poses=self.poses.select(keep), rotations=renumbered)

    def without_aliasing(self):
        """Return the same, as if samples were close enough to follow the rotations."""
        return replace(self, rotations=self.rotations.without_aliasing())

    def of_new_power_cycles(self):
        """Return the same, its power cycles none that a calibration knows: numbers below zero."""
        new = replace(self.poses, power_cycle=-1 - self.poses.power_cycle)
        return replace(self, poses=new)

    def pose_channels(self, sensor, output, other, see=unchanged):
        """Return what an effect of a sensor sees at the poses.

        `output` takes values of the sensor, SI as logged, (n, 3), to ``K (raw - b)``, `see` those
        of the other in a log to what an effect sees; `other`, (n, 3), is what it sees at the poses.
        """
        poses = self.poses
        history = self._history(sensor, output, see, partial(pose_means, poses, self.logs))
        own = output(getattr(poses, OWN[sensor][0]))
        cycle = poses.power_cycle
        return Channels(poses.mid_s, own, other, poses.temperature, history, power_cycle=cycle)

    def rotation_channels(self, sensor, output, other, see=unchanged):
        """Return the same along the rotations, m of k samples; the other sensor is (m, k, 3)."""
        rotations, temperature = self.rotations, self.rotations.temperature
        session = self.poses.session[rotations.first]

        def at_samples(whole):
            at = zip(session, rotations.t, strict=True)
            return np.concatenate([whole[s][np.searchsorted(self.logs[s].t, t)] for s, t in at])

        return Channels(
            rotations.t.ravel(),
            output(getattr(rotations, OWN[sensor][0]).reshape(-1, 3)),
            other.reshape(-1, 3),
            None if temperature is None else temperature.ravel(),
            self._history(sensor, output, see, at_samples),
            power_cycle=np.repeat(self.poses.power_cycle[rotations.first], rotations.t.shape[1]),
        )

    def calibrated_force(self, calibration):
        """Return specific force by an accelerometer's calibration, m/s^2.

        At the poses, (n, 3), and along the rotations, (m, k, 3).
        """
        poses, rotations = self.poses, self.rotations
        channels = self.pose_channels("accelerometer", calibration.output, poses.w)
        along = self.rotation_channels("accelerometer", calibration.output, rotations.w)
        turned = calibration.apply(rotations.f.reshape(-1, 3), along)
        return calibration.apply(poses.f, channels), turned.reshape(rotations.f.shape)

    def _history(self, sensor, output, see, seen):
        """Return a function of functions of the whole log of each session, as `seen` takes them."""

        @cache
        def history(function, *constants):
            sessions, how = set(self.poses.session.tolist()), {"output": output, "see": see}
            return seen(
                {s: self.logs[s].evaluate(sensor, function, *constants, **how) for s in sessions}
            )

        return history


def pose_means(poses, logs, whole):
    """Return the mean over each pose, (n, ...), of an array per session, `whole`, (N, ...) each.

    Takes the Poses and the Log of each session.
    """
    means = []
    for s, start, end in zip(poses.session, poses.start_s, poses.end_s, strict=True):
        first, last = np.searchsorted(logs[s].t, [start, end])
        means.append(whole[s][first:last].mean(axis=0))
    return np.array(means)


def record(samples, segments, longest_rotation, rails=None):
    """Return the Recording of several sessions, with temperatures where every one logs them.

    Takes samples and segments of each session, DataFrames or dicts of arrays, the longest
    rotation, s, and the `rails` of each session that `core.samples.at_rail` takes.
    """
    samples = [on_gyroscope_clock(s) for s in samples]
    logs = tuple(Log.of(s) for s in samples)
    poses = add_tilt_turns(add_rounding(gather_poses(segments), logs), logs)
    if len(poses) and all(log.temperature is not None for log in logs):
        temperature = pose_means(poses, logs, [log.temperature for log in logs])
        poses = replace(poses, temperature=temperature)
    rails = rails or [{}] * len(logs)
    clipped = [
        np.array([at_rail(log, ends, axes) for axes in (ANGULAR_RATE, ACCELERATION)])
        for log, ends in zip(samples, rails, strict=True)
    ]
    rotations, lost = gather_rotations(poses, logs, segments, longest_rotation, clipped)
    recording = Recording(poses, rotations, logs)
    odd, errors = odd_turns(recording)
    left_out = poses.session[rotations.first], rotations.start_s, rotations.end_s, errors
    contradicting = tuple(zip(*(values[odd].tolist() for values in left_out), strict=True))
    railed = sum(int(np.sum(np.asarray(table["kind"]) == DISTURBED)) for table in segments)
    slow_force = any(map(_has_slow_force, samples))
    lost = replace(lost, railed=railed, contradicting=contradicting)
    return Recording(poses, rotations.select(~odd), logs, lost, slow_force)


def _has_slow_force(samples):
    """Return whether fewer than two of three rows have an accelerometer's sample of their own."""
    own = samples.get(OWN_TIME["accelerometer"])
    return own is not None and np.mean(np.diff(own) > 0) < 2 / 3
