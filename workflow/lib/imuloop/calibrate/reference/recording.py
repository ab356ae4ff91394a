"""The sessions with a reference, and the windows in which sensor and reference are compared."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from imuloop.calibrate.recording import Log
from imuloop.core.samples import GAP_STEPS, ORIENTATION, POSITION, read_columns, read_metadata

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
class ReferenceRecording:
    """The usable reference sessions of a device."""

    names: tuple[str, ...]
    logs: tuple[ReferenceLog, ...]
    _designs: dict = field(default_factory=dict, repr=False)

    def windows(self, kind):
        """Return session, first, middle and last row of each window, (m,) each.

        Of `kind` rotation, of `TURN` s and one soon after the other, or position, of twice `HALF`
        s. No sample is missing in them; where there are too many, they lie farther apart.
        """
        if kind not in self._designs:
            length = TURN if kind == "rotation" else 2 * HALF
            total = sum(np.ptp(log.t) for log in self.logs)
            apart = max(length, total / MOST_WINDOWS / np.clip(len(self.logs), 1, 1.5))
            self._designs[kind] = np.concatenate(
                [np.zeros((0, 4), int)]
                + [_windows(log, s, kind, length, apart) for s, log in enumerate(self.logs)]
            ).T
        return self._designs[kind]


def _windows(log, session, kind, length, apart):
    """Return session, first, middle and last row of the windows of a log, (m, 4)."""
    step = np.median(np.diff(log.t))
    broken = np.concatenate([[0], np.cumsum(np.diff(log.t) > GAP_STEPS * step)])
    known = np.isfinite(log.attitude[:, 0, 0])
    if kind == "position":
        lost = np.cumsum(~known)
        known = known & np.isfinite(log.place[:, 0])
    count, half, found, i = round(length / step), round(length / step / 2), [], 0
    while i + count < len(log.t):
        middle, last = i + half, i + (2 * half if kind == "position" else count)
        whole = known[i] and known[last] and broken[i] == broken[last]
        if kind == "position":
            whole = whole and known[middle] and lost[i] == lost[last]
        if whole:
            found.append((session, i, middle, last))
            i += max(round(apart / step), last - i + max(1, round(BETWEEN / step)))
        else:
            i += max(1, count // 20)
    return np.array(found, int).reshape(-1, 4)
