"""Separation of static records at disturbances that moved the device."""

import numpy as np

from imuloop.diagnose.records.scan import BESIDE
from imuloop.diagnose.records.static import StaticProblem, fitted_effects
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.steps import Steps
from imuloop.estimate.search import Search

# probability that a device which was not moved counts as moved
MOVED = 1e-3


def cut_at_tilts(records, least):
    """Return the StaticRecords of an accelerometer, cut where a disturbance tilted the device.

    A tilt changes the means of an accelerometer, and it is no effect of the sensor. A record is cut
    at a disturbance if the means before and after it differ by more than the noise, slow noise
    included, and if the magnitude of gravity is the same. A piece with fewer than `least` windows
    is left out. A record has the means over windows of one rest.
    """
    steps = [Steps((t,), (r.session,)) for r in records for t in _disturbances(r)]
    if not steps:
        return list(records)
    problem = StaticProblem(
        records=records,
        variants={},
        settings=DiagnoseSettings(significance=MOVED),
        tests=len(steps),
    )
    # the most significant step is added, then the next, until none is
    search, significant = Search(problem, held_out=frozenset()), ()
    while True:
        trials = search.tests(significant, [s for s in steps if s not in significant])
        best = min((t for t in trials if t), key=lambda t: t.log_p, default=None)
        if best is None or best.log_p >= search.threshold(len(significant)):
            break
        significant = (*significant, best.effect)
    jumps, pieces = fitted_effects(search, significant), []
    for record in records:
        starts, cuts, last = record.windows[:, 0], [], -np.inf
        in_record = [jump for jump in jumps if jump.effect.sessions == (record.session,)]
        for jump in sorted(in_record, key=lambda jump: jump.effect.times):
            (t,) = jump.effect.times
            before = (starts >= last) & (starts < t)
            if is_tilt(jump, record.values[before].mean(axis=0)):
                cuts.append(t)
            last = t
        piece = np.searchsorted(cuts, starts, side="right")
        pieces += [record.part(piece == k) for k in np.unique(piece)]
    return [piece for piece in pieces if len(piece.windows) >= least]


def is_tilt(jump, level):
    """Return whether a jump of specific force may be a tilt, which keeps its magnitude.

    `jump` is the FittedEffect of the step h, `level` the specific force f before it, (3,), m/s^2.
    ``|f + h| = |f|`` if ``u·h + |h|²/2|f|`` is zero, with the direction u of f. Three standard
    errors are allowed. A jump along gravity is no tilt.
    """
    h, std = (np.array(list(v.values())) for v in (jump.values, jump.std))
    size = np.linalg.norm(level)
    along = level @ h / size + h @ h / (2 * size)
    return bool(abs(along) <= 3 * np.linalg.norm(level / size * std))


def _disturbances(record):
    """Return the times, s, of disturbances with enough windows just before and after them, a list.

    They are the starts of the undisturbed stretches that follow them.
    """
    first = np.flatnonzero(np.diff(record.stretch)) + 1
    sizes = np.diff(np.concatenate([[0], first, [len(record.windows)]]))
    enough = (sizes[:-1] >= BESIDE) & (sizes[1:] >= BESIDE)
    return record.windows[first[enough], 0].tolist()
