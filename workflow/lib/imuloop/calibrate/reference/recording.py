"""The sessions with a reference, and the windows in which sensor and reference are compared."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from imuloop.calibrate.recording import Log
from imuloop.core.gaps import gap_limit
from imuloop.core.samples import ORIENTATION, POSITION, read_columns, read_metadata

# s; length of a window of rotation, and half of one of position
TURN, HALF = 1.0, 0.2
# s between windows, which then have no noise of the reference in common
BETWEEN = 0.03
# windows of one kind, of several sessions half as many again: dense matrices have three
# rows for each
MOST_WINDOWS = 200


@dataclass(frozen=True)
class ReferenceLog(Log):
    """The log of a session with its reference at the same instants, not-a-number where lost.

    `attitude`, (N, 3, 3), takes axes near the sensor's to the world's: the reference's own times
    the rotation between both bodies, as far as whole turns show it. The rest of that rotation is
    fitted. `place`, (N, 3), is in metres; `noise` the standard deviations of both, rad and m.
    """

    attitude: np.ndarray
    place: np.ndarray
    noise: tuple[float, float]


def read_reference(sessions):
    """Return the ReferenceRecording of a device; sessions as of `calibrate.calibrate.usable`."""
    chosen = {}
    for name, session in sessions.items():
        known = read_metadata(session["samples"]).get("reference")
        if session["kind"] != "reference_motion" or known is None or "noise" not in known:
            continue
        samples = read_columns(session["samples"])
        q = np.column_stack([samples[c] for c in ORIENTATION])
        attitude = np.full((len(q), 3, 3), np.nan)
        seen = np.isfinite(q[:, 0])
        turned = Rotation.from_quat(q[seen], scalar_first=True).as_matrix()
        attitude[seen] = turned @ np.array(known["frame"])
        place = np.column_stack([samples[c] for c in POSITION])
        noise = (known["noise"]["orientation"], known["noise"]["position"] or 0.0)
        log = Log.of(samples)
        chosen[name] = ReferenceLog(log.t, log.f, log.w, log.temperature, attitude, place, noise)
    return ReferenceRecording(tuple(chosen), tuple(chosen.values()))


@dataclass(frozen=True)
class Windows:
    """Windows in which sensor and reference are compared: number of the log, and rows, (m,)."""

    logs: tuple[ReferenceLog, ...]
    session: np.ndarray
    first: np.ndarray
    middle: np.ndarray
    last: np.ndarray

    def __len__(self):
        return len(self.session)

    @cached_property
    def rows(self):
        """Rows of all samples of each window, (m, k); the last is repeated."""
        length = np.max(self.last - self.first, initial=-1) + 1
        return np.minimum(self.first[:, None] + np.arange(length), self.last[:, None])

    def of_logs(self, values, rows=None):
        """Return what the logs hold at some rows of each window, or at all, (m, …).

        Takes the name of a channel, or an array for each log.
        """
        if isinstance(values, str):
            values = [getattr(log, values) for log in self.logs]
        rows = self.rows if rows is None else rows
        return np.array([values[s][i] for s, i in zip(self.session, rows, strict=True)])


class Places(Windows):
    """Windows of position: a second difference, and the mean of force that it is compared to."""

    @cached_property
    def weights(self):
        """Weight of each sample in a mean that falls linearly from the middle, (m, k)."""
        t, middle = self.of_logs("t"), self.of_logs("t", self.middle)[:, None]
        steps = np.diff(t, axis=1)
        trapezoid = (np.pad(steps, ((0, 0), (1, 0))) + np.pad(steps, ((0, 0), (0, 1)))) / 2
        half = np.ptp(t, axis=1)[:, None] / 2
        found = np.maximum(half - np.abs(t - middle), 0) * trapezoid
        return found / found.sum(axis=1, keepdims=True)

    @cached_property
    def attitudes(self):
        """Attitude of each sample times its weight, (m, k, 3, 3)."""
        return self.of_logs("attitude") * self.weights[..., None, None]

    @cached_property
    def acceleration(self):
        """Second difference of the place, m/s^2, (m, 3)."""
        rows = np.column_stack([self.first, self.middle, self.last])
        half = np.ptp(self.of_logs("t", rows), axis=1)[:, None] / 2
        return np.diff(self.of_logs("place", rows), 2, axis=1)[:, 0] / half**2

    @cached_property
    def up(self):
        """Up, by the median of the force as logged in the session, (m, 3)."""
        mean = np.einsum("mkij,mkj->mi", self.attitudes, self.of_logs("f")) - self.acceleration
        sessions = range(len(self.logs))
        up = np.array([np.median(mean[self.session == s], axis=0) for s in sessions])
        return (up / np.linalg.norm(up, axis=1, keepdims=True))[self.session]


@dataclass(frozen=True)
class ReferenceRecording:
    """The usable reference sessions of a device."""

    names: tuple[str, ...]
    logs: tuple[ReferenceLog, ...]

    @cached_property
    def turns(self):
        """The Windows of rotation, of `TURN` s and one soon after the other."""
        return Windows(self.logs, *self._windows("rotation", TURN))

    @cached_property
    def places(self):
        """The Places, windows of twice `HALF` s."""
        return Places(self.logs, *self._windows("position", 2 * HALF))

    def _windows(self, kind, length):
        """Return session, first, middle and last row of each window, (m,) each.

        No sample is missing in them; where there are too many, they lie farther apart.
        """
        total = sum(np.ptp(log.t) for log in self.logs)
        apart = max(length, total / MOST_WINDOWS / np.clip(len(self.logs), 1, 1.5))
        found = [_windows(log, s, kind, length, apart) for s, log in enumerate(self.logs)]
        return np.concatenate([np.zeros((0, 4), int), *found]).T


def _windows(log, session, kind, length, apart):
    """Return session, first, middle and last row of the windows of a log, (m, 4)."""
    step = np.median(np.diff(log.t))
    broken = np.concatenate([[0], np.cumsum(np.diff(log.t) > gap_limit(step))])
    known = np.isfinite(log.attitude[:, 0, 0])
    if kind == "position":
        lost = np.cumsum(~known)
        known = known & np.isfinite(log.place[:, 0])
    count, half, found, i = round(length / step), round(length / step / 2), [], 0
    # twice a rounded half may be one row more than the rounded whole
    to_last = 2 * half if kind == "position" else count
    while i + max(count, to_last) < len(log.t):
        middle, last = i + half, i + to_last
        whole = known[i] and known[last] and broken[i] == broken[last]
        if kind == "position":
            whole = whole and known[middle] and lost[i] == lost[last]
        if whole:
            found.append((session, i, middle, last))
            i += max(round(apart / step), last - i + max(1, round(BETWEEN / step)))
        else:
            i += max(1, count // 20)
    return np.array(found, int).reshape(-1, 4)
