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
from imuloop.core.tables import joined

# share of a rotation at either end that is too slow to be told from a rest, and the part of this
# end, s, that the segmentation does not count as rest
ONSET, SEEN = 0.03, 0.1
# columns that `aliased_turns` computes
ALIASING = ("aliased", "fall", "aliasing_covariance")


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
    # additional errors of a rotation: the step in the middle of each of the g parts in which they
    # arise, (m, g), and their covariance as a rotation vector on body axes, rad², (m, g, 3, 3), due
    # to undersampling (`undersampling.aliased_turns`), and due to missing samples and jitter
    extra_at: np.ndarray | None = None
    aliasing_covariance: np.ndarray | None = None
    time_covariance: np.ndarray | None = None
    # variance of each axis due to undersampling, rad², (m,)
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
    """Numbers of the rotations and rests that are not used, and why."""

    rotations: int = 0  # all rotations that are short enough to be used
    left_out: int = 0  # rotations with a gap too long, or an error that is unknown or too large
    longest: int = 0  # largest number of samples dropped in a row in a rotation left out
    clipped: int = 0  # rotations whose angular rate is clipped
    railed: int = 0  # rests whose specific force is clipped
    # a tuple for each rotation that contradicts all others: session, start, end, s, and error, rad
    contradicting: tuple = ()

    @property
    def reason(self):
        """Why rotations were left out, text; empty if none was."""
        left_out = (
            f"; {self.left_out} of {self.rotations} turns lost up to "
            f"{plural(self.longest, 'sample')} in a row and are left out"
        )
        clipped = (
            f"; {self.clipped} of {self.rotations} turns reached the end of the gyroscope's range "
            "and are left out: choose a wider range or turn more slowly"
        )
        return left_out * bool(self.left_out) + clipped * bool(self.clipped)

    @property
    def rests_reason(self):
        """Why rests were left out, text; empty if none was."""
        rests = plural(self.railed, "rest")
        reason = f"; {rests} at the end of the accelerometer's range left out: choose a wider range"
        return reason * bool(self.railed)


def gather_rotations(poses, logs, segments, longest_s):
    """Return the Rotations between consecutive poses of a session, and the Lost, those left out.

    A rotation lasts from the last sample of a pose to the first sample of the next pose. A slow
    rotation also takes the nearest part of both poses: the rotation starts and ends too slowly to
    be told from a rest, and the angle of these parts is larger than the noise of the added time.

    A rotation is left out if it lasts longer than `longest_s`, crosses a gap of the segments, has
    a clipped angular rate, or if missing samples make its angle too uncertain (`errors_of_time`).

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
        The rotations that a fit can use.
    Lost
        How many rotations were left out, and why.
    """
    # by session the table of its rotations; the first one, for a device without sessions, is empty
    none = np.zeros(0, int)
    empty = {"first": none, "start": none, "end": none, "session": none, "step": np.zeros(0)}
    empty |= {"force_clipped": none > 0, "time_covariance": np.zeros((0, PARTS, 3, 3))}
    tables = [empty | dict(zip(ALIASING, aliased_turns(*[()] * 6), strict=True))]
    candidates, lost_runs, clipped_turns = 0, [], 0
    # part of each pose that a slow rotation may take, s; none of a pose that tilts, because its
    # field `w_to_ends` already has the rotation within it
    room = np.where(poses.tilt > 0, 0.0, poses.duration_s / 2)
    for session in np.unique(poses.session):
        log, table = logs[session], segments[session]
        # poses from which a rotation starts, and its start and end
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
        # the rate at rest before the rotation
        bias, variance = poses.w[pose], poses.variance[pose, 3:]
        covariance, accurate, lost = errors_of_time(log.t, log.w, first, last, bias, variance)
        accurate &= ~crosses_gap
        # a rotation is clipped if the number of clipped samples rises between its ends
        count = np.pad(np.cumsum(log.clipped, axis=1), ((0, 0), (1, 0)))
        rate_clipped, force_clipped = count[:, last + 1] > count[:, first]
        candidates += len(pose)
        lost_runs += lost[~accurate].tolist()
        clipped_turns += np.count_nonzero(accurate & rate_clipped)
        usable = accurate & ~rate_clipped
        columns = {"first": pose, "start": first, "end": last, "force_clipped": force_clipped}
        columns |= {"session": np.full(len(pose), session), "time_covariance": covariance}
        columns["step"] = np.full(len(pose), np.median(np.diff(log.t)))
        turns = {name: column[usable] for name, column in columns.items()}
        bias, variance, start, end = bias[usable], variance[usable], turns["start"], turns["end"]
        aliasing = aliased_turns(log.t, log.w, begin=start, last=end, bias=bias, variance=variance)
        tables.append(turns | dict(zip(ALIASING, aliasing, strict=True)))
    turns = joined(tables)
    # samples of each rotation, with the last one repeated up to the length of the longest
    start, end, session = turns["start"], turns["end"], turns["session"]
    length = np.max(end - start, initial=1) + 1
    rows = np.minimum(start[:, None] + np.arange(length), end[:, None])

    def along(name, *shape):
        """Return the samples of a field of the logs along all rotations, (m, k, *shape).

        `name` is the name of the field, and `shape` is (3,) for a vector.
        """
        values = [getattr(logs[s], name)[i] for s, i in zip(session, rows, strict=True)]
        return np.reshape(values, (*rows.shape, *shape))

    t = along("t")
    rotations = Rotations(
        start_s=t[:, 0],
        end_s=t[:, -1],
        t=t,
        w=along("w", 3),
        f=along("f", 3),
        temperature=None if poses.temperature is None else along("temperature"),
        uneven=lost_samples(np.diff(t), turns["step"][:, None]) > 0,
        extra_at=middle_steps(end - start + 1),
        **{name: turns[name] for name in ("first", "force_clipped", "time_covariance", *ALIASING)},
    )
    return rotations, Lost(
        rotations=candidates,
        left_out=len(lost_runs),
        longest=max(lost_runs, default=0),
        clipped=clipped_turns,
    )
