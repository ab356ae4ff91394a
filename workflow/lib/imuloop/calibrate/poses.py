"""Poses, gathered from the segments of all sessions.

A pose is an attitude in which the device rests. Segments are the rests, moves and gaps of a
session. Nominal SI values are raw readings less the data sheet's offset, times its scale.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from imuloop.core.noise_model import without_weight
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.segments import STATIC, power_cycles
from imuloop.segment.windows import DECIDING

# length at both ends of a rest in the hand over which the weights of its samples fall to zero, s
FADE = 0.25
# relative difference of two values below which they differ by their number format only
SAME_LEVEL = 1e-9
# distance from a multiple of the step, in steps, above which levels have no common step
UNEVEN = 0.1


class Table:
    """Base class of a table: a dataclass of arrays that have a row per pose or per rotation."""

    def __len__(self):
        return len(self.start_s)

    def select(self, keep):
        """Return a copy with the rows that `keep`, an index array or a mask, chooses."""
        columns = {field.name: getattr(self, field.name) for field in fields(self)}
        return replace(self, **{name: x[keep] for name, x in columns.items() if x is not None})


@dataclass(frozen=True)
class Poses(Table):
    """Means over the samples of n poses, in which the device rests.

    Each field has a row per pose.
    """

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
    # root mean square of the tilt within the pose, as both sensors show it, rad, (n,)
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
        """Window about the middle of each pose: its start and end, s, (n, 2).

        The window lasts as long as the device rested. This is shorter than the pose if the rest was
        interrupted.
        """
        half = self.duration_s / 2
        return np.column_stack([self.mid_s - half, self.mid_s + half])

    def mean_covariance(self, noise):
        """Return the covariance of the means over n poses, SI units squared, (6, n, n).

        The first axis is the channel, ax … gz; the others are the poses. The covariance of a
        channel is the one that the NoiseModel `noise` predicts, plus the variance by rounding and
        tilts, which is independent between poses. If the noise of the channel is not known, the
        covariance is diagonal instead: the sample variance within a pose over its number of
        samples.
        """
        covariances = noise.mean_covariance(self.windows, self.power_cycle)
        for axis, covariance in enumerate(covariances):
            noise_is_known = covariance.any()
            white = self.variance[:, axis] / self.n
            covariance += np.diag(self.extra_variance[:, axis] if noise_is_known else white)
        return covariances

    def unknown_noise(self, noise, channels):
        """Return a text on why the noise of some channels is not known; None if the noise is known.

        A fit weights the means over the poses by the inverse of their covariance. The noise of a
        channel counts as not known if the covariance by the NoiseModel `noise` is singular.
        `channels` has the names of the channels, such as ``ax``.
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

    `segments` has a table for each session, a DataFrame or a dict of arrays. A row of such a table
    is a segment: a rest, a move or a gap. Rests of one power cycle that share a pose number are one
    pose. The means of a pose are over the samples of all its rests.
    """
    # the rests that are part of a pose: others have the number -1
    chosen = [(np.asarray(t["kind"]) == STATIC) & (np.asarray(t["pose"]) >= 0) for t in segments]

    def join(columns):
        """Return one column of the r rests of all sessions, (r,); `columns` has it by session."""
        by_session = zip(columns, chosen, strict=True)
        return np.concatenate([np.zeros(0), *(np.asarray(x)[is_rest] for x, is_rest in by_session)])

    def column(name):
        """Return the column `name` of the tables, for the r rests of all sessions, (r,)."""
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
        """Return the means of c columns `names`, to the `power`, over each of n poses, (n, c)."""
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
        # means of squared deviations, for the variance, and of squared tilts
        variance=mean_powers([f"{c}_std" for c in CHANNELS], power=2),
        tilt=np.sqrt(mean_powers(["tilt_rad"], power=2)[:, 0]),
        # these are set from the logs afterwards
        temperature=None,
        extra_variance=np.zeros((len(poses), 6)),
        to_ends_s=np.zeros((len(poses), 2)),
        w_to_ends=np.zeros((len(poses), 2, 3)),
    )


def rounding_variance(samples, variance):
    r"""Return the variance that rounding adds to the mean of a channel over a rest, a float.

    Samples are rounded to multiples of a step q, the smallest distance between their values. The
    true value at rest lies anywhere between two multiples, and the samples have white noise of
    standard deviation σ. The rounding error of the mean then has the variance
    ``q²/(2 π²) Σₖ exp(-4 π² k² σ²/q²) / k²``, k = 1, 2, …. The variance is q²/12 without noise, and
    less than 1 % of q²/12 if σ is larger than q/2.

    Parameters
    ----------
    samples : ndarray, shape (m,)
        Samples of the channel. If their values are not multiples of a step, the result is zero.
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
    q = steps.min(initial=np.inf)
    # if there is a common step, all distances of neighbouring levels are whole numbers of it
    multiples = steps / q
    if not len(steps) or np.abs(multiples - np.round(multiples)).max() > UNEVEN:
        return 0.0
    k = np.arange(1, 100)
    # a single rest may lie on one level and show no variance, so all rests give σ²/q² together
    noise = max(np.mean(variance) / q**2 - 1 / 12, 0.0)
    return q**2 / (2 * np.pi**2) * np.sum(np.exp(-4 * np.pi**2 * k**2 * noise) / k**2)


def add_rounding(poses, logs):
    """Add the variance of the means by rounding to the `extra_variance` of Poses, in place.

    `poses` are the Poses, and `logs` has the Log of each session. Each channel of a log has its own
    rounding step: the distance between the values that its number format can have.
    """
    for session in np.unique(poses.session):
        rows, log = poses.session == session, logs[session]
        for axis, values in enumerate(np.hstack([log.f, log.w]).T):
            rounding = rounding_variance(values, poses.variance[rows, axis])
            poses.extra_variance[rows, axis] += rounding


def add_tilt_turns(poses, logs):
    r"""Correct Poses, in place, for small rotations within a pose, as of a device held in a hand.

    The fit takes a pose as one attitude. If the device tilts in a pose, this is the mean attitude.
    Let φ(t) be the rotation since the start of the pose, the integral of the angular rate, and φ̄
    its mean over the pose. The rotation from the mean attitude is then φ(t) - φ̄. In poses that
    tilt these fields change:

    - `to_ends_s` and `w_to_ends`. The rotation from the mean attitude to the start of the pose is
      -φ̄, and to its end φ(end) - φ̄. Each of these two rotations is stored as a time and the mean
      angular rate over this time. The time is counted from the mean time of the samples, so the one
      to the start is negative. The bias in this rate is known only after the fit.
    - `extra_variance` of the angular rate grows, because a slow rotation looks like a bias. What is
      added is ω², where ω is the rate of a steady rotation that lasts as long as the pose and has
      the same root mean square of the tilt.
    - `f` and `w` become weighted means, unless the rest was interrupted. A hand that moves at the
      ends of a rest accelerates the device. So the weights fall to zero over `FADE` seconds at
      both ends. `f` is also made longer: the mean of unit vectors at the angles ε from their mean
      direction has the length ``1 - mean(ε²)/2``.
    - `duration_s` becomes the duration of an unweighted mean with the same white noise.

    `poses` are the Poses, and `logs` has the Log of each session.
    """
    # the angle of a steady rotation is √12 times its root mean square
    poses.extra_variance[:, 3:] += 12 * (poses.tilt / poses.duration_s)[:, None] ** 2
    for k in np.flatnonzero(poses.tilt > 0):
        log = logs[poses.session[k]]
        rows = slice(*np.searchsorted(log.t, [poses.start_s[k], poses.end_s[k]]))
        t, f, w = log.t[rows], log.f[rows], log.w[rows]
        # time since the start, and the rotation since then with the bias in it
        since, turned = t - t[0], cumulative_trapezoid(w, t, axis=0, initial=0)
        weights = np.ones(len(t))
        # a pose that was interrupted has samples between its rests, and keeps their means
        if len(t) == poses.n[k]:
            # a cosine taper over the same share of the samples at both ends, half of them at most
            position = np.arange(1, len(t) + 1) / (len(t) + 1)
            tapered = min(FADE / poses.duration_s[k], 0.5)
            rise = np.minimum(np.minimum(position, 1 - position) / tapered, 1)
            weights = (1 - np.cos(np.pi * rise)) / 2
            mean_f, mean_w = (np.average(x, axis=0, weights=weights) for x in (f, w))
            # the sway: what remains of the rotation without its mean and the one at the mean rate
            sway = turned - since[:, None] * mean_w
            sway -= np.average(sway, axis=0, weights=weights)
            # gravity turns by the part of the sway that is across it
            across = np.cross(sway, mean_f / np.linalg.norm(mean_f))
            square = np.average((across**2).sum(axis=1), weights=weights)
            poses.f[k], poses.w[k] = mean_f * (1 + square / 2), mean_w
            poses.duration_s[k] *= weights.mean() ** 2 / np.mean(weights**2)
        rotation = turned[[0, -1]] - np.average(turned, axis=0, weights=weights)
        poses.to_ends_s[k] = since[[0, -1]] - np.average(since, weights=weights)
        poses.w_to_ends[k] = rotation / poses.to_ends_s[k][:, None]
