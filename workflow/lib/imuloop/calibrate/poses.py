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

# at both ends of a rest in the hand its samples count less and less, s
FADE = 0.25
# share of a move over which it begins and ends too slowly to be told from a rest, and how much
# of that no rest has, s
ONSET, SEEN = 0.03, 0.1
# of a value: closer ones differ by the rounding of their number format alone
SAME_LEVEL = 1e-9
# of a step: levels farther from its multiples have no common step
UNEVEN = 0.1


@dataclass(frozen=True)
class Poses:
    """Means over n static poses, arrays with a row per pose."""

    # session, and power cycle (`imuloop.core.segments.power_cycles`): no two sessions share one,
    # and noise of different power cycles is independent
    session: np.ndarray
    power_cycle: np.ndarray
    start_s: np.ndarray  # first and last instant, s on the session's clock
    end_s: np.ndarray
    duration_s: np.ndarray  # s at rest, less than end - start where a rest was interrupted
    n: np.ndarray  # samples
    f: np.ndarray  # mean specific force, m/s^2, and angular rate, rad/s, (n, 3), SI as logged
    w: np.ndarray
    variance: np.ndarray  # sample variance of the six channels within the pose, (n, 6)
    temperature: np.ndarray | None  # mean, degC; None unless every session logs one
    # variance that rounding (`rounded_means`) and tilts add to the six means, (n, 6)
    extra_variance: np.ndarray
    # root mean square of the tilt that both sensors show in the pose, rad, (n,)
    tilt: np.ndarray
    # turns from the attitude of the mean to that at the start and at the end, rad, on body axes,
    # (n, 3); zero where the device lies still
    to_start: np.ndarray
    to_end: np.ndarray

    def __len__(self):
        return len(self.n)

    def select(self, keep):
        """Return the poses of an index or mask."""
        return _selected(self, keep)

    @property
    def mid_s(self):
        """Middle of each pose, s."""
        return (self.start_s + self.end_s) / 2

    @property
    def windows(self):
        """Windows about the middle of each pose, as long as its samples, shape (n, 2), s."""
        half = self.duration_s / 2
        return np.column_stack([self.mid_s - half, self.mid_s + half])

    def mean_covariance(self, noise):
        """Return the covariance of the pose means, (6, n, n), SI units squared, in order ax … gz.

        Of the poses alone; the fit of both sensors takes `ResidualCovariance`, moves included.
        It is that of `NoiseModel.mean_covariance`, and what rounding and tilts add, independent
        from pose to pose. An axis whose noise is not known gets the white part alone, the variance
        within the pose over its samples.
        """
        whole = noise.mean_covariance(self.windows, self.power_cycle)
        for axis, each in enumerate(whole):
            white = self.variance[:, axis] / self.n
            each += np.diag(self.extra_variance[:, axis] if each.any() else white)
        return whole

    def unknown_noise(self, noise, channels):
        """Return why means of some channels have no weight by a NoiseModel, or None if they do."""
        own = [c in channels for c in CHANNELS]
        silent, lines = without_weight(self.mean_covariance(noise)[own])
        for found, what in (
            (silent, "never changes within a pose"),
            (lines, "shows lines and no noise beside them"),
        ):
            if found.any():
                names = ", ".join(np.array(CHANNELS)[own][found])
                return f"{names} {what}: its noise is not known"
        return None


@dataclass(frozen=True)
class Rotations:
    """Angular rate between consecutive poses, m of k samples, padded with steps of zero."""

    first: np.ndarray  # pose that each starts from, (m,); it ends at the next
    start_s: np.ndarray  # first and last sample, s
    end_s: np.ndarray
    t: np.ndarray  # time of the samples, s, (m, k)
    w: np.ndarray  # angular rate, rad/s, and specific force, m/s^2, (m, k, 3)
    f: np.ndarray
    temperature: np.ndarray | None  # degC, (m, k)
    # steps over which samples are missing, (m, k - 1)
    uneven: np.ndarray | None = None
    # steps about which an error is added, (m, g), and its covariance, rad²: first, in `PARTS` of
    # them, what samples too far apart lose (`undersampling.aliased_turns`), then errors of time
    extra_at: np.ndarray | None = None
    extra_covariance: np.ndarray | None = None
    # variance of each axis by samples too far apart, rad², (m,), and the power of frequency by
    # which it falls
    aliased: np.ndarray | None = None
    fall: np.ndarray | None = None
    # whether the specific force reached the end of its range, (m,)
    force_clipped: np.ndarray | None = None

    def __len__(self):
        return len(self.first)

    @cached_property
    def steps(self):
        """Time steps, s, shape (m, k - 1); zero where padded."""
        return np.diff(self.t, axis=1)

    def select(self, keep):
        """Return the rotations of an index or mask."""
        return _selected(self, keep)

    def errors(self, aliasing=True, others=True):
        """Return steps about which an error is added, (m, g), and its covariance, (m, g, 3, 3).

        By samples too far apart, and by others.
        """
        part = slice(0 if aliasing else PARTS, None if others else PARTS)
        return self.extra_at[:, part], self.extra_covariance[:, part]

    def without_aliasing(self):
        """Return the same, as if their samples were close enough."""
        covariance = self.extra_covariance.copy()
        covariance[:, :PARTS] = 0.0
        return replace(self, extra_covariance=covariance, aliased=0.0 * self.aliased)


def _selected(table, keep):
    """Return a copy of a dataclass of arrays with the chosen rows."""
    columns = {f.name: getattr(table, f.name) for f in fields(table)}
    return replace(table, **{name: v[keep] for name, v in columns.items() if v is not None})


def gather_poses(segments):
    """Return the Poses of several sessions, in order of session and time.

    Rests that share a number are one pose. Takes the segments of each session, a DataFrame or a
    dict of arrays.
    """
    session = np.repeat(np.arange(len(segments)), [len(table["n"]) for table in segments])

    def column(name):
        return np.concatenate([np.zeros(0), *(np.asarray(table[name]) for table in segments)])

    number = column("pose").astype(int)
    cycle = np.concatenate([np.zeros(0, int), *map(power_cycles, segments)])
    kinds = [np.asarray(table["kind"]) == STATIC for table in segments]
    held = np.concatenate([np.zeros(0, bool), *kinds]) & (number >= 0)
    rests = np.column_stack([session, cycle, number])[held]
    poses, pose = np.unique(rests, axis=0, return_inverse=True)
    pose, n = pose.ravel(), column("n")[held]
    start, end = column("start_s")[held], column("end_s")[held]
    total = np.bincount(pose, n)

    def pooled(names, power=1):
        means = [np.bincount(pose, column(name)[held] ** power * n) / total for name in names]
        return np.array(means).T

    first, last = np.full(len(poses), np.inf), np.full(len(poses), -np.inf)
    np.minimum.at(first, pose, start)
    np.maximum.at(last, pose, end)
    return Poses(
        session=poses[:, 0],
        # 0, 1, ... from session to session: one without a pose does not count
        power_cycle=np.unique(poses[:, :2], axis=0, return_inverse=True)[1].ravel(),
        start_s=first,
        end_s=last,
        duration_s=np.bincount(pose, end - start),
        n=total.astype(int),
        f=pooled([f"{c}_mean" for c in ACCELERATION]),
        w=pooled([f"{c}_mean" for c in ANGULAR_RATE]),
        variance=pooled([f"{c}_std" for c in CHANNELS], power=2),
        temperature=None,
        extra_variance=np.zeros((len(poses), 6)),
        tilt=np.sqrt(pooled(["tilt_rad"], power=2)[:, 0]),
        to_start=np.zeros((len(poses), 3)),
        to_end=np.zeros((len(poses), 3)),
    )


def rounded_means(samples, variance):
    r"""Return the variance that rounding to the sensor's steps adds to means of its samples.

    Of a level anywhere between steps q, under white noise σ, the mean is wrong by a variance of
    ``q²/(2 π²) Σₖ exp(-4 π² k² σ²/q²) / k²``: q²/12 without noise, nothing from σ = q/2 on, and
    nothing for samples, (m,), without common steps. Takes the sample variance about each mean.

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
    # about one level the variance may be nothing: that of all says what the noise is
    white = max(np.mean(variance) / q**2 - 1 / 12, 0.0)
    return q**2 / (2 * np.pi**2) * np.sum(np.exp(-4 * np.pi**2 * k**2 * white) / k**2)


def rounded(poses, logs):
    """Return the Poses with what rounding adds to the variance of their means.

    Takes the Poses and the Log of each session.
    """
    extra = np.zeros((len(poses), len(CHANNELS)))
    for session in np.unique(poses.session):
        own, log = poses.session == session, logs[session]
        for axis, values in enumerate(np.hstack([log.f, log.w]).T):
            extra[own, axis] = rounded_means(values, poses.variance[own, axis])
    return replace(poses, extra_variance=poses.extra_variance + extra)


def _tapered(n, share):
    """Return weights of n samples that rise and fall as a cosine over a share at either end."""
    from_end = np.minimum(np.arange(1, n + 1), np.arange(n, 0, -1)) / (n + 1)
    return (1 - np.cos(np.pi * np.minimum(from_end / share, 1))) / 2


def turns_within(poses, logs):
    r"""Return the poses with means of those that tilt, and the turns from there to both ends.

    A hand's velocity at the ends of a rest, over its length, is an error of the mean specific
    force: the samples of its first and last `FADE` count less and less (`_tapered`). The mean of
    directions that differ by small turns is shorter than each, by half their mean square.

    Of specific force u the mean over a rest is that at an instant where the turn since the start
    equals its mean. So to the end it is turned by the mean over the rest of :math:`\int_t^{end} w`,
    to the start by the mean of :math:`-\int_{start}^t w`. The bias is the mean rate of the poses
    that lie still. A rest that turned by Δ in T seconds says nothing of the bias below Δ/T, which
    is added to the variance of its mean rate; Δ is √12 times the tilt's root mean square, as of a
    steady turn. Takes the Poses and the Log of each session.
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
        # one that was interrupted keeps the means of its parts
        if len(t) == poses.n[k]:
            weights = _tapered(len(t), min(FADE / duration_s[k], 0.5))
            mean, f[k], w[k] = (
                np.average(x, axis=0, weights=weights) for x in (turned, force, rate)
            )
            across = np.cross(turned - mean, f[k] / np.linalg.norm(f[k]))
            f[k] *= 1 + np.average((across**2).sum(axis=1), weights=weights) / 2
            # as long as a plain mean that is as good against white noise
            duration_s[k] *= weights.mean() ** 2 / np.mean(weights**2)
        to_start[k], to_end[k] = -mean, turned[-1] - mean
    extra = poses.extra_variance.copy()
    extra[:, 3:] += 12 * (poses.tilt / poses.duration_s)[:, None] ** 2
    ends = {"to_start": to_start, "to_end": to_end}
    return replace(poses, f=f, w=w, duration_s=duration_s, extra_variance=extra, **ends)


def gather_rotations(poses, logs, segments, longest_s, clipped):
    """Return the Rotations between consecutive poses of the same session, and the Lost.

    A rotation lasts from the last sample of a pose to the first of the next. A slow one reaches
    into both poses: what it begins and ends with is too slow to be told from a rest, and as an
    angle more than the noise of the time added. It is left out where it lasts longer than asked,
    where a gap interrupts it, where the angular rate reached the end of its range, and where it
    lost too much elsewhere (`errors_of_time`). Takes the Log and the segments of each session, and
    which samples have the angular rate and the specific force at the end of their range, (2, N).
    """
    turns, short_enough, left_out, beyond = [], 0, [], 0
    # what a pose that tilts turns to its ends is known
    room = np.where(poses.tilt > 0, 0.0, poses.duration_s / 2)
    for session in np.unique(poses.session):
        log, table = logs[session], segments[session]
        k = np.flatnonzero((poses.session[:-1] == session) & (poses.session[1:] == session))
        k = k[poses.start_s[k + 1] - poses.end_s[k] <= longest_s]
        start, end = poses.end_s[k], poses.start_s[k + 1]
        onset = np.maximum(ONSET * (end - start) - SEEN, 0.0)
        start, end = start - np.minimum(onset, room[k]), end + np.minimum(onset, room[k + 1])
        gap = np.asarray(table["kind"]) == GAP
        open_s, close_s = (np.asarray(table[c])[gap] for c in ("start_s", "end_s"))
        interrupted = ((open_s < end[:, None]) & (close_s > start[:, None])).any(axis=1)
        # `end_s` is open: the pose's last sample is the one before it
        begin, last = np.searchsorted(log.t, start) - 1, np.searchsorted(log.t, end)
        at_rest = poses.w[k], poses.variance[k, 3:]
        errors, lost = errors_of_time(log.t, log.w, begin, last, *at_rest)
        known = np.array([e is not None for e in errors], dtype=bool) & ~interrupted
        # of angular rate and specific force whether one of the samples is clipped
        before = np.pad(np.cumsum(clipped[session], axis=1), ((0, 0), (1, 0)))
        rate_clipped, force_clipped = before[:, last + 1] > before[:, begin]
        whole = np.flatnonzero(known & ~rate_clipped)
        short_enough += len(k)
        left_out += lost[~known].tolist()
        beyond += np.count_nonzero(known & rate_clipped)
        at_rest = (values[whole] for values in at_rest)
        aliased = aliased_turns(log.t, log.w, begin[whole], last[whole], *at_rest)
        for i, variance, fall, at, covariance in zip(whole, *aliased, strict=True):
            more_at, more = errors[i]
            at, covariance = np.append(at, more_at), np.concatenate([covariance, more])
            rows = log, slice(begin[i], last[i] + 1)
            turns.append((k[i], rows, at, covariance, variance, fall, force_clipped[i]))
    first, rows, at, covariance, *others = zip(*turns, strict=True) if turns else [()] * 7

    def along(name, *shape):
        return _padded([getattr(log, name)[own] for log, own in rows], shape)

    t = along("t")
    usual = np.array([np.median(np.diff(log.t)) for log, _ in rows])
    rotations = Rotations(
        np.array(first, int),
        t[:, 0],
        t[:, -1],
        t,
        along("w", 3),
        along("f", 3),
        along("temperature") if poses.temperature is not None else None,
        # steps of zero are padded
        lost_samples(np.diff(t), usual[:, None]) > 0,
        _padded(at).astype(int),
        _padded(covariance, (3, 3), repeat=False),
        *map(np.array, others),
    )
    return rotations, Lost(short_enough, len(left_out), max(left_out, default=0), beyond)


def _padded(arrays, shape=(), repeat=True):
    """Return arrays of several lengths as one, (m, k, ...), the last row repeated, or of zeros."""
    found = np.zeros((len(arrays), max(map(len, arrays), default=2), *shape))
    for row, own in zip(found, arrays, strict=True):
        row[: len(own)] = own
        if repeat:
            row[len(own) :] = own[-1]
    return found
