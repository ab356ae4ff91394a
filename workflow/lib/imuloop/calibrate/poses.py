"""Poses and the rotations between them, gathered from the segments of all sessions."""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from imuloop.calibrate.errors_of_time import Lost, errors_of_time
from imuloop.calibrate.undersampling import PARTS, aliased_turns
from imuloop.core.gaps import lost_samples
from imuloop.core.noise_model import without_weight
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.segments import GAP, STATIC, power_cycles
from imuloop.segment.windows import DECIDING

# length of the taper of the weights at both ends of a rest in the hand, s
FADE = 0.25
# share of a rotation at either end that is too slow to be told from a rest, and the part of it, s,
# that the segmentation does not count as rest
ONSET, SEEN = 0.03, 0.1
# relative difference of two values below which only their number format tells them apart
SAME_LEVEL = 1e-9
# distance from a multiple of the step, in steps, above which levels have no common step
UNEVEN = 0.1


@dataclass(frozen=True)
class Poses:
    """Means over n static poses. All fields are arrays with a row per pose."""

    # index of the session, and of the power cycle (`imuloop.core.segments.power_cycles`): no two
    # sessions share a power cycle, and the noise of different power cycles is independent
    session: np.ndarray
    power_cycle: np.ndarray
    start_s: np.ndarray  # start of the pose, s on the session's clock
    end_s: np.ndarray  # end of the pose, s
    duration_s: np.ndarray  # time at rest, s: less than end - start if the rest was interrupted
    n: np.ndarray  # number of samples
    f: np.ndarray  # mean specific force, m/s^2, (n, 3), nominal SI
    w: np.ndarray  # mean angular rate, rad/s, (n, 3), nominal SI
    variance: np.ndarray  # sample variance of the six channels within the pose, (n, 6)
    temperature: np.ndarray | None  # mean, degC; None unless every session logs a temperature
    # variance that rounding (`rounding_variance`) and tilts add to the six means, (n, 6)
    extra_variance: np.ndarray
    # root mean square of the tilt that both sensors show in the pose, rad, (n,)
    tilt: np.ndarray
    # rotation vectors from the mean attitude to the attitude at the start and at the end of the
    # pose, rad, body axes, (n, 3); zero where the device lies still
    to_start: np.ndarray
    to_end: np.ndarray

    def __len__(self):
        return len(self.n)

    def select(self, keep):
        """Return the Poses that `keep`, an index array or a mask, chooses."""
        return _select_rows(self, keep)

    @property
    def mid_s(self):
        """Middle of each pose, s, (n,)."""
        return (self.start_s + self.end_s) / 2

    @property
    def windows(self):
        """Start and end, s, (n, 2), of a window about each pose's middle, as long as its rest."""
        half = self.duration_s / 2
        return np.column_stack([self.mid_s - half, self.mid_s + half])

    def mean_covariance(self, noise):
        """Return the covariance of the pose means, (6, n, n), SI units squared, in order ax … gz.

        It is the sum of the covariance that the NoiseModel `noise` predicts and the variance that
        rounding and tilts add, which is independent between poses. If the noise of an axis is not
        known, its covariance is diagonal: the sample variance within the pose over the number of
        samples. The joint fit does not use this covariance, but `ResidualCovariance`, which
        includes the rotations.
        """
        covariances = noise.mean_covariance(self.windows, self.power_cycle)
        for axis, covariance in enumerate(covariances):
            white = self.variance[:, axis] / self.n
            covariance += np.diag(self.extra_variance[:, axis] if covariance.any() else white)
        return covariances

    def unknown_noise(self, noise, channels):
        """Return why the pose means of some channels have no weight, text; None if all have one.

        Takes a NoiseModel and the names of the channels.
        """
        chosen = [c in channels for c in CHANNELS]
        silent, lines = without_weight(self.mean_covariance(noise)[chosen])
        for affected, what in (
            (silent, "never changes within a pose"),
            (lines, "shows lines and no noise beside them"),
        ):
            if affected.any():
                names = ", ".join(np.array(CHANNELS)[chosen][affected])
                return f"{names} {what}: its noise is not known"
        return None


@dataclass(frozen=True)
class Rotations:
    """The samples of m rotations between consecutive poses.

    All rotations are padded to the same number k of samples: the last sample is repeated, so that
    the time steps of the padding are zero.
    """

    first: np.ndarray  # index of the pose that the rotation starts from, (m,); it ends at the next
    start_s: np.ndarray  # time of the first sample, s, (m,)
    end_s: np.ndarray  # time of the last sample, s, (m,)
    t: np.ndarray  # time of the samples, s, (m, k)
    w: np.ndarray  # angular rate, rad/s, (m, k, 3), nominal SI
    f: np.ndarray  # specific force, m/s^2, (m, k, 3), nominal SI
    temperature: np.ndarray | None  # degC, (m, k)
    # whether samples are missing in each step, (m, k - 1)
    uneven: np.ndarray | None = None
    # additional errors of a rotation: the steps in which they arise, (m, g), and the covariance of
    # each as a rotation vector, rad², (m, g, 3, 3). The first `PARTS` of the g errors are due to
    # undersampling (`undersampling.aliased_turns`), the others to missing samples and jitter
    extra_at: np.ndarray | None = None
    extra_covariance: np.ndarray | None = None
    # variance of each axis due to undersampling, rad², (m,)
    aliased: np.ndarray | None = None
    # exponent p of the power law f⁻ᵖ of the spectrum from which `aliased` is predicted, (m,)
    fall: np.ndarray | None = None
    # whether the specific force reached the end of its range, (m,)
    force_clipped: np.ndarray | None = None

    def __len__(self):
        return len(self.first)

    @cached_property
    def steps(self):
        """Time steps, s, (m, k - 1); zero in the padding."""
        return np.diff(self.t, axis=1)

    def select(self, keep):
        """Return the Rotations that `keep`, an index array or a mask, chooses."""
        return _select_rows(self, keep)

    def errors(self, aliasing=True, others=True):
        """Return the additional errors of the rotations.

        `aliasing` includes the errors due to undersampling, `others` those due to missing samples
        and jitter.

        Returns
        -------
        steps : ndarray of int, shape (m, g)
            Index of the step in which each error arises.
        covariance : ndarray, shape (m, g, 3, 3)
            Covariance of each error as a rotation vector, rad².
        """
        part = slice(0 if aliasing else PARTS, None if others else PARTS)
        return self.extra_at[:, part], self.extra_covariance[:, part]

    def without_aliasing(self):
        """Return a copy of the Rotations without the errors due to undersampling."""
        covariance = self.extra_covariance.copy()
        covariance[:, :PARTS] = 0.0
        return replace(self, extra_covariance=covariance, aliased=0.0 * self.aliased)


def _select_rows(table, keep):
    """Return a copy of a dataclass of arrays with the rows that an index or mask chooses."""
    columns = {f.name: getattr(table, f.name) for f in fields(table)}
    return replace(table, **{name: v[keep] for name, v in columns.items() if v is not None})


def gather_poses(segments):
    """Return the Poses of several sessions, in order of session and time.

    Rests of one power cycle that share a pose number are one pose. `segments` holds the segments
    of each session, a DataFrame or a dict of arrays.
    """
    session = np.repeat(np.arange(len(segments)), [len(table["n"]) for table in segments])

    def column(name):
        return np.concatenate([np.zeros(0), *(np.asarray(table[name]) for table in segments)])

    number = column("pose").astype(int)
    cycle = np.concatenate([np.zeros(0, int), *map(power_cycles, segments)])
    kinds = [np.asarray(table["kind"]) == STATIC for table in segments]
    is_rest = np.concatenate([np.zeros(0, bool), *kinds]) & (number >= 0)
    rests = np.column_stack([session, cycle, number])[is_rest]
    poses, pose = np.unique(rests, axis=0, return_inverse=True)
    pose, n = pose.ravel(), column("n")[is_rest]
    start, end = column("start_s")[is_rest], column("end_s")[is_rest]
    total = np.bincount(pose, n)

    def mean_powers(names, power=1):
        """Return the mean of a power of some columns over the samples of each pose, (n, c)."""
        means = [np.bincount(pose, column(name)[is_rest] ** power * n) / total for name in names]
        return np.array(means).T

    first, last = np.full(len(poses), np.inf), np.full(len(poses), -np.inf)
    np.minimum.at(first, pose, start)
    np.maximum.at(last, pose, end)
    return Poses(
        session=poses[:, 0],
        # numbered 0, 1, … over all sessions; power cycles without a pose have no number
        power_cycle=np.unique(poses[:, :2], axis=0, return_inverse=True)[1].ravel(),
        start_s=first,
        end_s=last,
        duration_s=np.bincount(pose, end - start),
        n=total.astype(int),
        f=mean_powers([f"{c}_mean" for c in ACCELERATION]),
        w=mean_powers([f"{c}_mean" for c in ANGULAR_RATE]),
        variance=mean_powers([f"{c}_std" for c in CHANNELS], power=2),
        temperature=None,
        extra_variance=np.zeros((len(poses), 6)),
        tilt=np.sqrt(mean_powers(["tilt_rad"], power=2)[:, 0]),
        to_start=np.zeros((len(poses), 3)),
        to_end=np.zeros((len(poses), 3)),
    )


def rounding_variance(samples, variance):
    r"""Return the variance that quantization adds to the mean of a channel over a rest, a float.

    Samples are rounded to multiples of the quantization step q. If the true level lies anywhere
    between two steps and the samples have white noise of standard deviation σ, rounding adds to
    the mean an error of variance ``q²/(2 π²) Σₖ exp(-4 π² k² σ²/q²) / k²``, k = 1, 2, …. It is
    q²/12 without noise, and vanishes from σ = q/2 on.

    Parameters
    ----------
    samples : ndarray, shape (m,)
        Samples of the channel. The result is zero if they have no common step.
    variance : ndarray
        Sample variance within each rest; their mean gives σ².

    References
    ----------
    B. Widrow, I. Kollár, M.-C. Liu, "Statistical theory of quantization", IEEE Transactions on
    Instrumentation and Measurement 45 (2), 1996.
    """
    levels = np.unique(samples[:DECIDING])
    steps = np.diff(levels)
    steps = steps[steps > SAME_LEVEL * np.maximum(np.abs(levels[1:]), np.abs(levels[:-1]))]
    count = steps / (q := steps.min(initial=np.inf))
    if not len(steps) or np.abs(count - np.round(count)).max() > UNEVEN:
        return 0.0
    k = np.arange(1, 100)
    # a single rest may lie on one level and show no variance, so all rests give σ²/q² together
    white = max(np.mean(variance) / q**2 - 1 / 12, 0.0)
    return q**2 / (2 * np.pi**2) * np.sum(np.exp(-4 * np.pi**2 * k**2 * white) / k**2)


def add_rounding(poses, logs):
    """Return the Poses with the variance of quantization added to `extra_variance`.

    Takes the Poses and the Log of each session.
    """
    extra = np.zeros((len(poses), len(CHANNELS)))
    for session in np.unique(poses.session):
        rows, log = poses.session == session, logs[session]
        for axis, values in enumerate(np.hstack([log.f, log.w]).T):
            extra[rows, axis] = rounding_variance(values, poses.variance[rows, axis])
    return replace(poses, extra_variance=poses.extra_variance + extra)


def _taper_weights(n, share):
    """Return weights of n samples, (n,), tapered as a cosine over a share of them at each end."""
    from_end = np.minimum(np.arange(1, n + 1), np.arange(n, 0, -1)) / (n + 1)
    return (1 - np.cos(np.pi * np.minimum(from_end / share, 1))) / 2


def add_tilt_turns(poses, logs):
    r"""Return the Poses with the turns within those that tilt, and with corrected means.

    Only poses with a tilt change, in these fields:

    - `to_start` and `to_end`. The mean specific force of a pose is the specific force at the
      attitude where the rotation since the start equals its mean over the pose. From there, the
      device turns by the mean over the pose of :math:`\int_t^{end} w` to its end, and by the mean
      of :math:`-\int_{start}^t w` to its start. w is the angular rate less the bias, which is the
      mean angular rate of the poses without a tilt.
    - `f`, `w` and `duration_s`, if the rest was not interrupted. A hand that moves at the ends of
      a rest adds its change of velocity over the duration to the mean specific force. So the means
      are weighted, with a taper of `FADE` seconds at both ends. The mean of directions that differ
      by small angles is shorter than each, by half the mean square angle; `f` is corrected for it.
    - `extra_variance`. A rest that turned by Δ rad in T seconds does not determine the bias better
      than Δ/T, so (Δ/T)² is added to the variance of its mean angular rate. Δ is √12 times the root
      mean square of the tilt, as in a turn at constant rate.

    Takes the Poses and the Log of each session.
    """
    tilted = np.flatnonzero(poses.tilt)
    if not len(tilted):
        return poses
    still = poses.tilt == 0
    bias = np.average(poses.w[still], axis=0, weights=poses.n[still]) if still.any() else 0.0
    f, w, duration_s = poses.f.copy(), poses.w.copy(), poses.duration_s.copy()
    to_start, to_end = np.zeros((2, len(poses), 3))
    for k in tilted:
        log = logs[poses.session[k]]
        rows = slice(*np.searchsorted(log.t, [poses.start_s[k], poses.end_s[k]]))
        t, force, rate = log.t[rows], log.f[rows], log.w[rows]
        middle = (rate[1:] + rate[:-1]) / 2 - bias
        turned = np.pad(np.cumsum(middle * np.diff(t)[:, None], axis=0), ((1, 0), (0, 0)))
        mean = turned.mean(axis=0)
        # a pose that was interrupted keeps the means of its parts
        if len(t) == poses.n[k]:
            weights = _taper_weights(len(t), min(FADE / duration_s[k], 0.5))
            mean, f[k], w[k] = (
                np.average(x, axis=0, weights=weights) for x in (turned, force, rate)
            )
            across = np.cross(turned - mean, f[k] / np.linalg.norm(f[k]))
            f[k] *= 1 + np.average((across**2).sum(axis=1), weights=weights) / 2
            # duration of an unweighted mean with the same variance of white noise
            duration_s[k] *= weights.mean() ** 2 / np.mean(weights**2)
        to_start[k], to_end[k] = -mean, turned[-1] - mean
    extra = poses.extra_variance.copy()
    extra[:, 3:] += 12 * (poses.tilt / poses.duration_s)[:, None] ** 2
    ends = {"to_start": to_start, "to_end": to_end}
    return replace(poses, f=f, w=w, duration_s=duration_s, extra_variance=extra, **ends)


def gather_rotations(poses, logs, segments, longest_s, clipped):
    """Return the Rotations between consecutive poses of the same session, and the Lost.

    A rotation lasts from the last sample of a pose to the first sample of the next pose. A slow
    rotation also takes the nearest part of both poses: it starts and ends too slowly to be told
    from a rest, and the angle of these parts is larger than the noise of the added time.

    A rotation is left out if it lasts longer than `longest_s`, crosses a gap of the segments, has
    a clipped angular rate, or if missing samples make its angle too uncertain (`errors_of_time`).

    Parameters
    ----------
    poses : Poses
        The poses of all sessions.
    logs, segments : sequence
        The Log and the segments, a DataFrame or a dict of arrays, of each session.
    longest_s : float
        Longest rotation, s.
    clipped : sequence of ndarray, shape (2, N)
        For each session, which samples of the angular rate and of the specific force are at the
        end of the range.
    """
    turns, candidates, lost_runs, clipped_turns = [], 0, [], 0
    # part of each pose that a slow rotation may take, s; poses that tilt have their turns already
    room = np.where(poses.tilt > 0, 0.0, poses.duration_s / 2)
    for session in np.unique(poses.session):
        log, table = logs[session], segments[session]
        pose = np.flatnonzero((poses.session[:-1] == session) & (poses.session[1:] == session))
        pose = pose[poses.start_s[pose + 1] - poses.end_s[pose] <= longest_s]
        start, end = poses.end_s[pose], poses.start_s[pose + 1]
        onset = np.maximum(ONSET * (end - start) - SEEN, 0.0)
        start, end = start - np.minimum(onset, room[pose]), end + np.minimum(onset, room[pose + 1])
        is_gap = np.asarray(table["kind"]) == GAP
        gap_start, gap_end = (np.asarray(table[c])[is_gap] for c in ("start_s", "end_s"))
        crosses_gap = ((gap_start < end[:, None]) & (gap_end > start[:, None])).any(axis=1)
        # `end_s` is exclusive: the last sample of the pose is the one before it
        first, last = np.searchsorted(log.t, start) - 1, np.searchsorted(log.t, end)
        bias, variance = poses.w[pose], poses.variance[pose, 3:]
        errors, lost = errors_of_time(log.t, log.w, first, last, bias, variance)
        accurate = np.array([e is not None for e in errors], dtype=bool) & ~crosses_gap
        # a rotation is clipped if the number of clipped samples rises between its ends
        count = np.pad(np.cumsum(clipped[session], axis=1), ((0, 0), (1, 0)))
        rate_clipped, force_clipped = count[:, last + 1] > count[:, first]
        kept = np.flatnonzero(accurate & ~rate_clipped)
        candidates += len(pose)
        lost_runs += lost[~accurate].tolist()
        clipped_turns += np.count_nonzero(accurate & rate_clipped)
        ends = first[kept], last[kept]
        aliasing = aliased_turns(log.t, log.w, *ends, bias[kept], variance[kept])
        for i, aliased, fall, steps, covariance in zip(kept, *aliasing, strict=True):
            more_steps, more = errors[i]
            steps, covariance = np.append(steps, more_steps), np.concatenate([covariance, more])
            rows = log, slice(first[i], last[i] + 1)
            turns.append((pose[i], rows, steps, covariance, aliased, fall, force_clipped[i]))
    pose, rows, steps, covariance, *others = zip(*turns, strict=True) if turns else [()] * 7

    def stack(name, *shape):
        """Return the samples of a field of the logs along all rotations, (m, k, ...)."""
        return pad_and_stack([getattr(log, name)[samples] for log, samples in rows], shape)

    t = stack("t")
    usual = np.array([np.median(np.diff(log.t)) for log, _ in rows])
    rotations = Rotations(
        np.array(pose, int),
        t[:, 0],
        t[:, -1],
        t,
        stack("w", 3),
        stack("f", 3),
        stack("temperature") if poses.temperature is not None else None,
        lost_samples(np.diff(t), usual[:, None]) > 0,
        pad_and_stack(steps).astype(int),
        pad_and_stack(covariance, (3, 3), repeat=False),
        *map(np.array, others),
    )
    return rotations, Lost(candidates, len(lost_runs), max(lost_runs, default=0), clipped_turns)


def pad_and_stack(arrays, shape=(), repeat=True):
    """Return arrays of different lengths as one array, (m, k, ...).

    k is the length of the longest array and `shape` the shape of one row. Shorter arrays are padded
    with their last row if `repeat` is true, otherwise with zeros.
    """
    stacked = np.zeros((len(arrays), max(map(len, arrays), default=2), *shape))
    for row, values in zip(stacked, arrays, strict=True):
        row[: len(values)] = values
        if repeat:
            row[len(values) :] = values[-1]
    return stacked
