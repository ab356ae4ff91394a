"""Records cut where a disturbance has moved the device."""

import numpy as np

from imuloop.diagnose.records.scan import BESIDE
from imuloop.diagnose.records.static import StaticProblem, fitted_effects
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.steps import Steps
from imuloop.estimate.search import Search

# probability that a device which was not moved counts as moved
MOVED = 1e-3


def separate(records, least):
    """Return records that are cut where a disturbance left another attitude.

    A gyroscope at rest does not see the attitude; an accelerometer does, and a tilt is no effect
    of the sensor. Where the means on either side of a disturbance differ by more than their noise,
    slow noise and whatever else changes the record slowly included, and the magnitude of gravity
    is the same, each side has its own level. A part with fewer than `least` means is left out.
    """
    edges = [(r, float(t)) for r in records for t in _edges(r)]
    if not edges:
        return list(records)
    settings = DiagnoseSettings(significance=MOVED)
    search = Search(StaticProblem(records, {}, settings, len(edges)), frozenset())
    steps, base = [Steps((t,), (r.session,)) for r, t in edges], ()
    while True:
        trials = search.tests(base, [s for s in steps if s not in base])
        best = min((t for t in trials if t), key=lambda t: t.log_p, default=None)
        if best is None or best.log_p >= search.threshold(len(base)):
            break
        base = (*base, best.effect)
    jumps, found = fitted_effects(search, base), []
    for record in records:
        starts, times, last = record.windows[:, 0], [], -np.inf
        own = [jump for jump in jumps if jump.effect.sessions == (record.session,)]
        for jump in sorted(own, key=lambda jump: jump.effect.times):
            (t,) = jump.effect.times
            before = (starts >= last) & (starts < t)
            if is_tilt(jump, record.values[before].mean(axis=0)):
                times.append(t)
            last = t
        number = np.searchsorted(times, starts, side="right")
        parts = [record.part(number == k) for k in np.unique(number)]
        found += [p for p in parts if len(p.windows) >= least]
    return found


def is_tilt(jump, level):
    """Return whether a jump of specific force may be a turn: what it leaves is as large.

    ``|f + h| = |f|`` where ``u·h + |h|²/2|f|`` is zero, u the direction of f; three standard errors
    are allowed. A bias that jumps along gravity is none. `jump` is the fitted step h, `level` the
    specific force f, m/s^2.
    """
    h, std = (np.array(list(v.values())) for v in (jump.values, jump.std))
    size = np.linalg.norm(level)
    along = level @ h / size + h @ h / (2 * size)
    return bool(abs(along) <= 3 * np.linalg.norm(level / size * std))


def _edges(record):
    """Return the starts of stretches that have windows enough before and in them, s."""
    first = np.flatnonzero(np.diff(record.stretch)) + 1
    sizes = np.diff(np.concatenate([[0], first, [len(record.windows)]]))
    far = (sizes[:-1] >= BESIDE) & (sizes[1:] >= BESIDE)
    return record.windows[first[far], 0]
