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
# columns of the table of rotations: of the candidates, and those that `aliased_turns` computes
CANDIDATES = ("first", "start", "end", "force_clipped", "time_covariance")
ALIASING = ("aliased", "fall", "aliasing_covariance")
# the table without a row
NO_ROTATIONS = {name: np.zeros(0, dtype=int) for name in ("first", "start", "end")}
NO_ROTATIONS |= {"force_clipped": np.zeros(0, dtype=bool)}
NO_ROTATIONS |= {"aliased": np.zeros(0), "fall": np.zeros(0)}
NO_ROTATIONS |= dict.fromkeys(
    ("time_covariance", "aliasing_covariance"), np.zeros((0, PARTS, 3, 3))
)


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

    A rotation is left out if it lasts longer than `longest_s`, crosses a gap, has a clipped angular
    rate, or if missing samples make its angle too uncertain.

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
    # by session the table of its rotations; the first one, for a device without sessions, is empty
    tables, candidates, lost_runs, clipped_turns = [NO_ROTATIONS], 0, [], 0
    for session in np.unique(poses.session):
        log = logs[session]
        turns = _find_candidates(poses, session, log, segments[session], longest_s)
        accurate, clipped = turns["accurate"], turns["rate_clipped"]
        candidates += len(accurate)
        lost_runs += turns["lost"][~accurate].tolist()
        clipped_turns += np.count_nonzero(accurate & clipped)
        usable = {name: turns[name][accurate & ~clipped] for name in CANDIDATES}
        # the rate at rest before the rotation
        bias, variance = poses.w[usable["first"]], poses.variance[usable["first"], 3:]
        aliasing = aliased_turns(log.t, log.w, usable["start"], usable["end"], bias, variance)
        tables.append(usable | dict(zip(ALIASING, aliasing, strict=True)))
    turns = joined(tables)
    # samples of each rotation, with the last one repeated up to the length of the longest
    start, end, session = turns.pop("start"), turns.pop("end"), poses.session[turns["first"]]
    length = np.max(end - start, initial=1) + 1
    rows = np.minimum(start[:, None] + np.arange(length), end[:, None])

    def along(name, *shape):
        """Return the samples of a field of the logs along all rotations, (m, k, *shape).

        `name` is the name of the field, and `shape` is (3,) for a vector.
        """
        values = [getattr(logs[s], name)[i] for s, i in zip(session, rows, strict=True)]
        return np.reshape(values, (*rows.shape, *shape))

    t, usual_step = along("t"), np.array([logs[s].step for s in session])
    rotations = Rotations(
        start_s=t[:, 0],
        end_s=t[:, -1],
        t=t,
        w=along("w", 3),
        f=along("f", 3),
        temperature=None if poses.temperature is None else along("temperature"),
        uneven=lost_samples(np.diff(t), usual_step[:, None]) > 0,
        extra_at=middle_steps(end - start + 1),
        **turns,
    )
    return rotations, Lost(
        rotations=candidates,
        left_out=len(lost_runs),
        longest=max(lost_runs, default=0),
        clipped=clipped_turns,
    )


def _find_candidates(poses, session, log, segments, longest_s):
    """Return the c rotations of a session that are short enough, a dict of columns, (c, …) each.

    A rotation lasts from the last sample of a pose to the first sample of the next pose. A slow
    rotation also takes the nearest part of both poses: it starts and ends too slowly to be told
    from a rest, and the angle of these parts is larger than the noise of the added time.

    Parameters
    ----------
    poses : Poses
        The poses of all sessions.
    session : int
        Index of the session.
    log, segments : Log, DataFrame or dict of arrays
        Its log and the table of its segments.
    longest_s : float
        Longest rotation, s.

    Returns
    -------
    dict of ndarray
        ``first``, the index of the pose that the rotation starts from; ``start`` and ``end``, the
        indices of its first and last sample; ``rate_clipped`` and ``force_clipped``, whether a
        sensor reached the end of its range; ``time_covariance``, the covariance of its error by
        missing samples and jitter; ``lost``, the largest number of samples dropped in a row; and
        ``accurate``, whether its angle is known in spite of them.
    """
    first = np.flatnonzero((poses.session[:-1] == session) & (poses.session[1:] == session))
    first = first[poses.start_s[first + 1] - poses.end_s[first] <= longest_s]
    start_s, end_s = poses.end_s[first], poses.start_s[first + 1]
    # the part of either pose that a slow rotation takes; none of a pose that tilts, because its
    # fields `to_start` and `to_end` already have the rotation within it
    onset = np.maximum(ONSET * (end_s - start_s) - SEEN, 0.0)
    room = np.where(poses.tilt > 0, 0.0, poses.duration_s / 2)
    start_s = start_s - np.minimum(onset, room[first])
    end_s = end_s + np.minimum(onset, room[first + 1])
    # the end of a pose is exclusive: its last sample is the one before
    start, end = np.searchsorted(log.t, start_s) - 1, np.searchsorted(log.t, end_s)
    # errors by missing samples, next to the noise of the rate at rest before the rotation
    bias, variance = poses.w[first], poses.variance[first, 3:]
    covariance, accurate, lost = errors_of_time(log.t, log.w, start, end, bias, variance)
    is_gap = np.asarray(segments["kind"]) == GAP
    gap_start, gap_end = (np.asarray(segments[c])[is_gap] for c in ("start_s", "end_s"))
    crosses_gap = ((gap_start < end_s[:, None]) & (gap_end > start_s[:, None])).any(axis=1)
    # the number of clipped samples before each sample rises within a rotation that has one
    count = np.pad(np.cumsum(log.clipped, axis=1), ((0, 0), (1, 0)))
    rate_clipped, force_clipped = count[:, end + 1] > count[:, start]
    return {
        "first": first,
        "start": start,
        "end": end,
        "rate_clipped": rate_clipped,
        "force_clipped": force_clipped,
        "time_covariance": covariance,
        "lost": lost,
        "accurate": accurate & ~crosses_gap,
    }
