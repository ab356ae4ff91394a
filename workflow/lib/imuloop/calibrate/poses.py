"""Poses, gathered from the segments of all sessions.

A pose is an attitude in which the device rests. Segments are the rests, moves and gaps of a
session. Nominal SI values are raw readings less the data sheet's offset, times its scale.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from imuloop.core.noise_model import without_weight
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.segments import STATIC, power_cycles
from imuloop.segment.windows import DECIDING

# length of the taper of the weights at both ends of a rest in the hand, s
FADE = 0.25
# relative difference of two values below which they differ by their number format only
SAME_LEVEL = 1e-9
# distance from a multiple of the step, in steps, above which levels have no common step
UNEVEN = 0.1


class Table:
    """Base class of dataclasses whose fields are arrays with a row per pose or per rotation."""

    def __len__(self):
        return len(self.start_s)

    def select(self, keep):
        """Return a copy with the rows that `keep`, an index array or a mask, chooses."""
        columns = {field.name: getattr(self, field.name) for field in fields(self)}
        return replace(self, **{name: x[keep] for name, x in columns.items() if x is not None})


@dataclass(frozen=True)
class Poses(Table):
    """Means over n poses, in which the device rests. All fields are arrays with a row per pose."""

    # index of the session, and number of the power cycle, from one switching-on to the next: no two
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
    # variance that rounding to the number format and tilts add to the six means, (n, 6)
    extra_variance: np.ndarray
    # root mean square of the tilt that both sensors show in the pose, rad, (n,)
    tilt: np.ndarray
    # time from the mean attitude of the pose to its start and to its end, s, (n, 2), the first one
    # negative; zero where the device lies still
    to_ends_s: np.ndarray
    # mean angular rate over these two times, rad/s, (n, 2, 3), nominal SI
    w_to_ends: np.ndarray

    @property
    def mid_s(self):
        """Middle of each pose, s, (n,)."""
        return (self.start_s + self.end_s) / 2

    @property
    def windows(self):
        """Start and end, s, (n, 2), of a window about the middle of each pose, as long as its rest.

        A rest that was interrupted is shorter than its pose.
        """
        half = self.duration_s / 2
        return np.column_stack([self.mid_s - half, self.mid_s + half])

    def mean_covariance(self, noise):
        """Return the covariance of the pose means, (6, n, n), SI units squared, in order ax … gz.

        The covariance is the sum of the one that the NoiseModel `noise` predicts and the variance
        that rounding and tilts add, which is independent between poses. If the noise of a channel
        is not known, its covariance is diagonal: the sample variance within the pose over the
        number of samples. The fit of both sensors does not use this covariance, but one that
        includes the rotations (`ResidualCovariance`).
        """
        covariances = noise.mean_covariance(self.windows, self.power_cycle)
        for axis, covariance in enumerate(covariances):
            white = self.variance[:, axis] / self.n
            covariance += np.diag(self.extra_variance[:, axis] if covariance.any() else white)
        return covariances

    def unknown_noise(self, noise, channels):
        """Return the reason, text, why the noise of some channels is not known, or None.

        If it is not known, the means over the poses cannot be weighted in a fit. `noise` is a
        NoiseModel, and `channels` has the names of the channels. The result is None if the noise of
        all these channels is known.
        """
        chosen = [c in channels for c in CHANNELS]
        silent, lines = without_weight(self.mean_covariance(noise)[chosen])
        causes = {
            "never changes within a pose": silent,
            "shows lines and no noise beside them": lines,
        }
        for what, affected in causes.items():
            if affected.any():
                names = ", ".join(np.array(CHANNELS)[chosen][affected])
                return f"{names} {what}: its noise is not known"
        return None


def gather_poses(segments):
    """Return the Poses of several sessions, in order of session and time.

    Rests of one power cycle that share a pose number are one pose. `segments` has the table of each
    session, a DataFrame or a dict of arrays with a row per segment.
    """
    # the rests that are part of a pose: others have the number -1
    chosen = [(np.asarray(t["kind"]) == STATIC) & (np.asarray(t["pose"]) >= 0) for t in segments]

    def join(columns):
        """Return a column of all r rests, (r,), given the whole column of each session."""
        by_session = zip(columns, chosen, strict=True)
        return np.concatenate([np.zeros(0), *(np.asarray(x)[is_rest] for x, is_rest in by_session)])

    def column(name):
        """Return the column of the segments with a name, of all r rests, (r,)."""
        return join(table[name] for table in segments)

    session = np.repeat(np.arange(len(chosen)), [np.sum(is_rest) for is_rest in chosen])
    # a pose is a triple of session, power cycle and pose number; `pose` is its index, by rest
    numbers = session, join(map(power_cycles, segments)), column("pose")
    poses, pose = np.unique(np.column_stack(numbers).astype(int), axis=0, return_inverse=True)
    start, end, n = column("start_s"), column("end_s"), column("n")
    # whether each rest is part of each pose, (n, r), and its share in the mean of the pose
    of_pose = pose.ravel() == np.arange(len(poses))[:, None]
    share = of_pose * n / (of_pose @ n)[:, None]

    def mean_powers(names, power=1):
        """Return the means over each pose of c columns, raised to a power, (n, c).

        The columns have a value per rest; the rests of a pose count by their number of samples.
        """
        return share @ np.column_stack([column(name) ** power for name in names])

    return Poses(
        session=poses[:, 0],
        # numbered 0, 1, … over all sessions; power cycles without a pose have no number
        power_cycle=np.unique(poses[:, :2], axis=0, return_inverse=True)[1].ravel(),
        start_s=np.where(of_pose, start, np.inf).min(axis=1, initial=np.inf),
        end_s=np.where(of_pose, end, -np.inf).max(axis=1, initial=-np.inf),
        duration_s=of_pose @ (end - start),
        n=(of_pose @ n).astype(int),
        f=mean_powers([f"{c}_mean" for c in ACCELERATION]),
        w=mean_powers([f"{c}_mean" for c in ANGULAR_RATE]),
        variance=mean_powers([f"{c}_std" for c in CHANNELS], power=2),
        temperature=None,
        extra_variance=np.zeros((len(poses), 6)),
        tilt=np.sqrt(mean_powers(["tilt_rad"], power=2)[:, 0]),
        to_ends_s=np.zeros((len(poses), 2)),
        w_to_ends=np.zeros((len(poses), 2, 3)),
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
        Samples of the channel, from which q follows. The result is zero if they have no common
        step.
    variance : ndarray, shape (r,)
        Sample variance within each of r rests; their mean, less q²/12 by rounding, is σ².

    References
    ----------
    B. Widrow, I. Kollár, M.-C. Liu, "Statistical theory of quantization", IEEE Transactions on
    Instrumentation and Measurement 45 (2), 1996.
    """
    levels = np.unique(samples[:DECIDING])
    steps = np.diff(levels)
    # values that differ by the precision of their number format are one level
    steps = steps[steps > SAME_LEVEL * np.maximum(np.abs(levels[1:]), np.abs(levels[:-1]))]
    count = steps / (q := steps.min(initial=np.inf))
    if not len(steps) or np.abs(count - np.round(count)).max() > UNEVEN:
        return 0.0
    k = np.arange(1, 100)
    # a single rest may lie on one level and show no variance, so all rests give σ²/q² together
    white = max(np.mean(variance) / q**2 - 1 / 12, 0.0)
    return q**2 / (2 * np.pi**2) * np.sum(np.exp(-4 * np.pi**2 * k**2 * white) / k**2)


def add_rounding(poses, logs):
    """Add the variance of the means by rounding to the `extra_variance` of Poses, in place.

    `logs` has the Log of each session. The step of each channel is taken from its log.
    """
    for session in np.unique(poses.session):
        rows, log = poses.session == session, logs[session]
        for axis, values in enumerate(np.hstack([log.f, log.w]).T):
            rounding = rounding_variance(values, poses.variance[rows, axis])
            poses.extra_variance[rows, axis] += rounding


def _taper_weights(n, share):
    """Return weights of n samples, (n,), from 0 to 1, with a cosine taper at both ends.

    `share` is the share of the samples over which the weights rise at the start, and over which
    they fall at the end.
    """
    from_end = np.minimum(np.arange(1, n + 1), np.arange(n, 0, -1)) / (n + 1)
    return (1 - np.cos(np.pi * np.minimum(from_end / share, 1))) / 2


def add_tilt_turns(poses, logs):
    r"""Set the small rotations within the poses that tilt, and correct their means, in place.

    A pose tilts if both sensors show that the device moves slightly, as in a hand. These fields of
    such poses change:

    - `to_ends_s` and `w_to_ends`. The mean specific force of a pose belongs to the mean attitude,
      whose rotation since the start is the mean of all. From there the device rotates to the start
      and to the end of the pose. Each of these two rotations is a time, the negative one to the
      start, multiplied by a mean angular rate; the bias of this rate is known only after the fit.
    - `f`, `w` and `duration_s`, if the rest was not interrupted. A hand that moves at the ends of
      a rest adds its change of velocity over the duration to the mean specific force. So the means
      are weighted, with a taper of `FADE` seconds at both ends. The mean of directions that differ
      by small angles is shorter than each, by half the mean square angle; `f` is corrected for it.
    - `extra_variance`. A rest that turned by Δ rad in T seconds does not determine the bias better
      than Δ/T, so (Δ/T)² is added to the variance of its mean angular rate. Δ is √12 times the root
      mean square of the tilt, as in a turn at constant rate.

    `poses` are the Poses, and `logs` has the Log of each session.
    """
    poses.extra_variance[:, 3:] += 12 * (poses.tilt / poses.duration_s)[:, None] ** 2
    f, w = poses.f, poses.w
    for k in np.flatnonzero(poses.tilt > 0):
        log = logs[poses.session[k]]
        rows = slice(*np.searchsorted(log.t, [poses.start_s[k], poses.end_s[k]]))
        t, force, rate = log.t[rows], log.f[rows], log.w[rows]
        # time and rotation vector since the start; the rotation is the sum of the rates in the
        # middle of the steps, with the bias of the gyroscope in it
        since, middle = t - t[0], (rate[1:] + rate[:-1]) / 2
        turned = np.pad(np.cumsum(middle * np.diff(t)[:, None], axis=0), ((1, 0), (0, 0)))
        weights = np.ones(len(t))
        # a pose that was interrupted keeps the means of its parts
        if len(t) == poses.n[k]:
            weights = _taper_weights(len(t), min(FADE / poses.duration_s[k], 0.5))
            f[k], w[k] = (np.average(x, axis=0, weights=weights) for x in (force, rate))
            # rotations from the mean attitude, without the one at the mean rate
            swayed = turned - since[:, None] * w[k]
            swayed -= np.average(swayed, axis=0, weights=weights)
            across = np.cross(swayed, f[k] / np.linalg.norm(f[k]))
            f[k] *= 1 + np.average((across**2).sum(axis=1), weights=weights) / 2
            # duration of an unweighted mean with the same variance of white noise
            poses.duration_s[k] *= weights.mean() ** 2 / np.mean(weights**2)
        # rotation and time from the mean attitude to both ends
        rotation = turned[[0, -1]] - np.average(turned, axis=0, weights=weights)
        poses.to_ends_s[k] = since[[0, -1]] - np.average(since, weights=weights)
        poses.w_to_ends[k] = rotation / poses.to_ends_s[k][:, None]
