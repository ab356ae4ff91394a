"""Rotations from one pose to the next, gathered from the logs of all sessions.

A pose is an attitude in which the device rests. Nominal SI values are raw readings less the data
sheet's offset, times its scale.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imuloop.calibrate.errors_of_time import errors_of_time
from imuloop.calibrate.poses import Table
from imuloop.calibrate.undersampling import PARTS, aliased_turns, middle_steps
from imuloop.core.errors import plural
from imuloop.core.gaps import lost_samples
from imuloop.core.segments import GAP

# share of a rotation at either end that is too slow to be told from a rest, and the part of this
# end, s, that the segmentation does not count as rest
ONSET, SEEN = 0.03, 0.1


@dataclass(frozen=True)
class Rotations(Table):
    """The samples of m rotations between consecutive poses of a session.

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
    # errors that arise in each of g parts of a rotation: index of the time step in the middle of
    # each part, (m, g), and the covariance of the error as a rotation vector on body axes, rad²,
    # (m, g, 3, 3), by undersampling (`undersampling.aliased_turns`), and by missing samples and
    # jitter
    extra_at: np.ndarray | None = None
    aliasing_covariance: np.ndarray | None = None
    time_covariance: np.ndarray | None = None
    # variance of the rotation vector on each axis by undersampling, rad², (m,)
    aliased: np.ndarray | None = None
    # exponent p of the power law f⁻ᵖ of the spectrum from which `aliased` is predicted, (m,)
    fall: np.ndarray | None = None
    # whether the specific force reached the end of its range, (m,)
    force_clipped: np.ndarray | None = None

    @cached_property
    def steps(self):
        """Time steps, s, (m, k - 1); zero in the padding."""
        return np.diff(self.t, axis=1)


@dataclass(frozen=True)
class Lost:
    """Numbers of rotations and rests that a fit does not use, and why."""

    rotations: int = 0  # all rotations that are short enough to be used
    left_out: int = 0  # rotations with a gap too long, or an error that is unknown or too large
    longest: int = 0  # largest number of samples dropped in a row in a rotation left out
    clipped: int = 0  # rotations whose angular rate is clipped
    railed: int = 0  # rests whose specific force is clipped
    # a tuple for each rotation that contradicts all others: session, start, end, s, and error, rad
    contradicting: tuple = ()

    @property
    def reason(self):
        """Text on why rotations were left out; empty if none was."""
        text = ""
        if self.left_out:
            lost = plural(self.longest, "sample")
            text += f"; {self.left_out} of {self.rotations} turns lost up to {lost} in a row and "
            text += "are left out"
        if self.clipped:
            text += f"; {self.clipped} of {self.rotations} turns reached the end of the "
            text += "gyroscope's range and are left out: choose a wider range or turn more slowly"
        return text

    @property
    def rests_reason(self):
        """Text on why rests were left out; empty if none was."""
        if not self.railed:
            return ""
        rests = plural(self.railed, "rest")
        return f"; {rests} at the end of the accelerometer's range left out: choose a wider range"


def gather_rotations(poses, logs, segments, longest_s):
    """Return the Rotations between consecutive poses of a session, and a count of those left out.

    A rotation is left out if it lasts longer than `longest_s`, crosses a gap or has a clipped
    angular rate. It is also left out if missing samples make its angle too uncertain;
    `errors_of_time` decides on this.

    Parameters
    ----------
    poses : Poses
        The poses of all sessions.
    logs, segments : sequence
        For each session its Log, and the table of its segments, a DataFrame or a dict of arrays.
    longest_s : float
        Longest rotation, s.

    Returns
    -------
    Rotations
        The m rotations that a fit can use.
    Lost
        How many rotations were left out, and why.
    """
    # the c rotations that are short enough: index of the pose that each starts from, its session,
    # the rate at rest there, and the ends
    first = np.flatnonzero(poses.session[:-1] == poses.session[1:])
    first = first[poses.start_s[first + 1] - poses.end_s[first] <= longest_s]
    session, bias, variance = poses.session[first], poses.w[first], poses.variance[first, 3:]
    start_s, end_s = _find_ends(poses, first)
    # these are filled in session by session
    start, end, lost = np.zeros((3, len(first)), dtype=int)
    accurate, rate_clipped, force_clipped = np.zeros((3, len(first)), dtype=bool)
    step, aliased, fall = np.zeros((3, len(first)))
    time_covariance, aliasing_covariance = np.zeros((2, len(first), PARTS, 3, 3))
    for s in np.unique(session):
        log, table, rows = logs[s], segments[s], session == s
        step[rows] = np.median(np.diff(log.t))
        # the end of a pose is exclusive: its last sample is the one before
        start[rows] = np.searchsorted(log.t, start_s[rows]) - 1
        end[rows] = np.searchsorted(log.t, end_s[rows])
        turns = {"begin": start[rows], "last": end[rows]}
        turns |= {"bias": bias[rows], "variance": variance[rows]}
        time_covariance[rows], accurate[rows], lost[rows] = errors_of_time(log.t, log.w, **turns)
        is_gap = np.asarray(table["kind"]) == GAP
        gap_start, gap_end = (np.asarray(table[c])[is_gap] for c in ("start_s", "end_s"))
        crosses = (gap_start < end_s[rows, None]) & (gap_end > start_s[rows, None])
        accurate[rows] &= ~crosses.any(axis=1)
        # the number of clipped samples before each sample rises within a rotation that has one
        count = np.pad(np.cumsum(log.clipped, axis=1), ((0, 0), (1, 0)))
        rate_clipped[rows], force_clipped[rows] = count[:, end[rows] + 1] > count[:, start[rows]]
        rows &= accurate & ~rate_clipped
        aliased[rows], fall[rows], aliasing_covariance[rows] = aliased_turns(
            log.t, log.w, start[rows], end[rows], bias=bias[rows], variance=variance[rows]
        )
    usable = accurate & ~rate_clipped
    start, end, session = start[usable], end[usable], session[usable]
    # samples of each rotation, with the last one repeated up to the length of the longest
    length = np.max(end - start, initial=1) + 1
    samples = np.minimum(start[:, None] + np.arange(length), end[:, None])

    def along(name, *shape):
        """Return a field of the logs at the k samples of each of m rotations, (m, k, *shape).

        `name` is the name of the field, and `shape` is (3,) for a vector and empty for a number.
        """
        values = [getattr(logs[s], name)[i] for s, i in zip(session, samples, strict=True)]
        return np.reshape(values, (*samples.shape, *shape))

    t = along("t")
    rotations = Rotations(
        first=first[usable],
        start_s=t[:, 0],
        end_s=t[:, -1],
        t=t,
        w=along("w", 3),
        f=along("f", 3),
        temperature=None if poses.temperature is None else along("temperature"),
        uneven=lost_samples(np.diff(t), step[usable, None]) > 0,
        extra_at=middle_steps(end - start + 1),
        aliasing_covariance=aliasing_covariance[usable],
        time_covariance=time_covariance[usable],
        aliased=aliased[usable],
        fall=fall[usable],
        force_clipped=force_clipped[usable],
    )
    return rotations, Lost(
        rotations=len(first),
        left_out=int(np.sum(~accurate)),
        longest=int(lost[~accurate].max(initial=0)),
        clipped=int(np.sum(accurate & rate_clipped)),
    )


def _find_ends(poses, first):
    """Return the start and the end of each of c rotations, s, (c,) each.

    A rotation lasts from the end of a pose to the start of the next pose. A rotation longer than
    ``SEEN / ONSET`` seconds also includes the nearest part of both poses, because it starts and
    ends too slowly to be told from a rest. A pose that tilts gives no such part, because its field
    `w_to_ends` already has the rotation within the pose. `poses` are the Poses, and `first` has the
    index of the pose that each rotation starts from, (c,).
    """
    start_s, end_s = poses.end_s[first], poses.start_s[first + 1]
    # length of the slow part at either end, less the part that is not counted as rest anyway
    onset = np.maximum(ONSET * (end_s - start_s) - SEEN, 0.0)
    room = np.where(poses.tilt > 0, 0.0, poses.duration_s / 2)
    return start_s - np.minimum(onset, room[first]), end_s + np.minimum(onset, room[first + 1])
