"""Attitudes integrated from a gyroscope, and their errors beside a reference."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from imuloop.core.rotation import exponential, matrix, prefix_product, step_vectors
from imuloop.core.samples import ANGULAR_RATE

# s; over which attitudes are integrated for the report
DURATIONS = (0.1, 0.3, 1.0, 3.0, 10.0)
# s, and samples at most, of the stretch that the report shows
SHOWN, POINTS = 10.0, 400
STAGES = ("logged", "calibrated", "final")


@dataclass(frozen=True)
class Carried:
    """A part of the data, integrated by models that never saw it."""

    session: int
    t: np.ndarray  # s
    attitude: np.ndarray  # of the reference, not-a-number where lost
    up: np.ndarray  # in the reference's world
    # from the start, one for each of `STAGES`: as logged; with T, K and its session's bias; with
    # the set-up and the effects that the search chooses without the part
    attitudes: tuple
    floor: tuple  # rad² of the reference at an instant, and rad²/s, of each axis

    def errors(self, i, j):
        """Return the error of each attitude from samples i to samples j, rad, (n, 3) each."""
        turn = self.attitude[i].swapaxes(-1, -2) @ self.attitude[j]
        moved = (turn.swapaxes(-1, -2) @ A[i].swapaxes(-1, -2) @ A[j] for A in self.attitudes)
        return [Rotation.from_matrix(m).as_rotvec() if len(m) else np.zeros((0, 3)) for m in moved]


def carried(choices, before):
    """Return each part of the data as `Carried`; `before` as of `judged_residuals`."""
    problem, found = choices.problem, []
    sensor, recording, parts = problem.sensor, problem.recording, problem.part_of_pose
    windows, white = sensor.windows(recording), sensor.white(ANGULAR_RATE)
    for part, s in np.unique(np.column_stack([parts, windows.session]), axis=0).tolist():
        own, held_out = (parts == part) & (windows.session == s), frozenset({part})
        rows = slice(windows.first[own].min(), windows.last[own].max() + 1)
        models = (before.problem, ()), (problem, choices.nested(held_out))
        rates = [sensor.rates(m.fitted(base, held_out), recording)[s] for m, base in models]
        log, attitudes = recording.logs[s], []
        t, C = log.t[rows], log.attitude[rows]
        for w in (log.w, *rates):
            q = prefix_product(exponential(step_vectors(w[rows], np.diff(t))))
            attitudes.append(np.concatenate([np.eye(3)[None], matrix(q)]))
        up = np.nanmean(np.einsum("nij,nj->ni", C, log.f[rows]), axis=0)
        up, floor = up / np.linalg.norm(up), (2 * log.noise[0] ** 2, white)
        found.append(Carried(s, t, C, up, tuple(attitudes), floor))
    return found


def errors_over(parts):
    """Return root mean square errors of attitude and of the vertical after some times, rad.

    Of each of `STAGES`; ``floor`` is what white noise of both sensor and reference alone gives.
    """
    found = []
    for seconds in DURATIONS:
        squares = []
        for part in parts:
            t, C = part.t, part.attitude
            count = round(seconds / np.median(np.diff(t)))
            i = np.arange(0, len(t) - count, max(1, count // 2))
            j = i + count
            known = np.isfinite(C[i, 0, 0]) & np.isfinite(C[j, 0, 0])
            known &= t[j] - t[i] < 1.5 * seconds
            i, j = i[known], j[known]
            up, row = np.einsum("nij,i->nj", C[j], part.up), []
            for error in part.errors(i, j):
                along = np.einsum("nj,nj->n", error, up)
                row.append(((error**2).sum(axis=1), (error**2).sum(axis=1) - along**2))
            floor = np.full(len(i), part.floor[0] + part.floor[1] * seconds)
            squares.append([*row, (3 * floor, 2 * floor)])
        each = np.concatenate(squares, axis=2)
        if each.shape[2]:
            sizes = np.sqrt(each.mean(axis=2)).tolist()
            stages = zip((*STAGES, "floor"), sizes, strict=True)
            entry = {k: dict(zip(("rotation", "vertical"), v, strict=True)) for k, v in stages}
            found.append({"seconds": seconds, "n": each.shape[2]} | entry)
    return found


def series(parts, names):
    """Return the stretch of `SHOWN` s that turned most: the reference beside what was integrated.

    Of those in which the reference is lost least; `names` are those of the sessions. None where no
    part is so long.
    """
    stretches = []
    for part in parts:
        t, known = part.t, np.isfinite(part.attitude[:, 0, 0])
        steps = part.attitudes[-1][:-1].swapaxes(1, 2) @ part.attitudes[-1][1:]
        turned = np.append(0, np.cumsum(Rotation.from_matrix(steps).magnitude()))
        i = np.flatnonzero(known & (t <= t[-1] - SHOWN))[:: max(1, len(t) // 1000)]
        j = np.minimum(np.searchsorted(t, t[i] + SHOWN), len(t) - 1)
        seen = np.append(0, np.cumsum(known))
        share = ((seen[j] - seen[i]) / (j - i)).round(2)
        if len(i):
            k = np.lexsort((turned[j] - turned[i], share))[-1]
            stretches.append((share[k], turned[j[k]] - turned[i[k]], part, i[k], j[k]))
    if not stretches:
        return None
    *_, part, i, j = max(stretches, key=lambda s: s[:2])
    at = np.arange(i, j + 1, max(1, -(-(j - i) // POINTS)))
    at = at[np.isfinite(part.attitude[at, 0, 0])]
    start, up = part.attitude[i] @ part.attitudes[-1][i].T, part.up
    errors = part.errors(np.full(len(at), i), at)
    found = {
        "t_s": part.t[at],
        "reference": np.einsum("nij,i->nj", part.attitude[at], up),
        "sensor": np.einsum("nij,i->nj", start @ part.attitudes[-1][at], up),
        **{k: np.linalg.norm(e, axis=1) for k, e in zip(STAGES, errors, strict=True)},
    }
    # to a microradian: a picture shows no more
    shown = {name: values.round(6).tolist() for name, values in found.items()}
    return {"session": names[part.session], **shown}
