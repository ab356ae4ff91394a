"""Was an accelerometer moved by a disturbance? Then what follows is a record of its own."""

import numpy as np

from imuloop.diagnose.static_means import part_of
from imuloop.diagnose.static_model import StaticModel, everything
from imuloop.diagnose.static_scan import BESIDE
from imuloop.diagnose.static_search import StaticSearch
from imuloop.diagnose.static_terms import Steps

# probability that a device which was not moved counts as moved
MOVED = 1e-3


def separated(records, least):
    """Return records that are cut where a disturbance left another attitude.

    A gyroscope at rest does not see the attitude; an accelerometer does, and a tilt is no effect
    of the sensor. Where the means on either side of a disturbance differ by more than their noise,
    slow noise and whatever else changes the record slowly included, each side has its own level.

    Parameters
    ----------
    records : sequence of StaticRecord
        One a session.
    least : int
        Means that a part needs; what is shorter is left out.

    Returns
    -------
    list of StaticRecord
        The same records where nothing was moved.
    """
    edges = [(r, float(t)) for r in records for t in _edges(r)]
    if not edges:
        return list(records)
    model = StaticModel(records)
    search = StaticSearch(everything(model), {}, MOVED, len(edges))
    patterns = model.patterns([Steps((t,), (r.session,)) for r, t in edges])
    base = ()
    while True:
        trials = [search.test(base, p) for p in patterns if p not in base]
        best = min((t for t in trials if t), key=lambda t: t.log_p, default=None)
        if best is None or best.log_p >= search.threshold(len(base)):
            break
        base = (*base, best.pattern)
    found = []
    for record in records:
        times = [p.effect.times[0] for p in base if p.effect.sessions == (record.session,)]
        number = np.searchsorted(np.sort(times), record.windows[:, 0], side="right")
        parts = [part_of(record, number == k) for k in np.unique(number)]
        found += [p for p in parts if len(p.windows) >= least]
    return found


def _edges(record):
    """Return the starts of stretches that have windows enough before and in them, s."""
    first = np.flatnonzero(np.diff(record.stretch)) + 1
    sizes = np.diff(np.concatenate([[0], first, [len(record.windows)]]))
    far = (sizes[:-1] >= BESIDE) & (sizes[1:] >= BESIDE)
    return record.windows[first[far], 0]
