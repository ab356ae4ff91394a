"""Which way the axes of the two sensors lie to each other, shown by the turns of a log.

While a device turns, the direction u of gravity in its axes obeys ``du/dt = u × ω``. Over two
neighbouring windows of T seconds, whose means are u₁ and u₂, this is without approximation

    u₂ - u₁ = ∫ w u × P (r - b) dt

with w rising from 0 to 1 over the first window and falling over the second, and P one of the 48
signed permutations of the axes: the identity in a good log. Gravity tells P alone: which of the two
sensors is at fault it cannot tell, nor whether the accelerometer's three signs are all wrong.
"""

from itertools import permutations, product

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.ingest.thinning import means, thinned

# windows of turns, of averages over at least so long, s
TURN_WINDOW, FINE = 0.25, 0.04
# of a log at most twice so many steps of turns are kept, evenly spread
KEPT = 4096

# a step of a turn turns gravity by at least so much, rad; its force is gravity's within this share
LEAST_STEP, MOST_SHAKEN = 0.1, 0.3
# of a row group about so many steps are used, and so many rests for the bias
TURNS, RESTS = 1024, 256
# steps in which a mapping has to beat the identity, and how many for each that says otherwise
LEAST_STEPS, STEPS_AGAINST = 3, 4
# agreement that a mapping needs, its lead, and the lead that leaves another one possible
AGREEMENT, LEAD, NEAR_BEST = 0.8, 0.05, 0.03
# signed permutations, the identity first
MAPPINGS = np.array(
    [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
    ]
)
# u × r as a sum of products
CROSS = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(2, 0, 1)


class Axes:
    """How well each mapping of the angular rate's axes explains how gravity turns, over a log."""

    def __init__(self, rate):
        self.rows = max(round(FINE * rate), 1)
        self.fine = max(round(TURN_WINDOW * rate / self.rows), 1)
        self.dt = self.rows / rate
        # du, ∫ w u, ∫ w u r of a step; rate of a rest
        self.steps, self.rests = [np.empty((0, 15))], [np.empty((0, 3))]
        self.gravity = None

    def add(self, x):
        """Take in a row group."""
        width = self.rows * self.fine
        n = len(x["ax"]) // width
        if n < 2:
            return
        force = np.array([means(x[name][: n * width], self.rows) for name in ACCELERATION])
        size = np.linalg.norm(force, axis=0)
        known = size[np.isfinite(size)]
        self.gravity = self.gravity or (np.median(known) if len(known) else None)
        if not self.gravity:
            return
        calm = (np.abs(size / self.gravity - 1) < MOST_SHAKEN).reshape(n, -1).all(axis=1)
        u = (force / np.where(size > 0, size, 1.0)).reshape(3, n, -1)
        change = np.diff(u.mean(axis=2), axis=1)
        angle, calm = np.linalg.norm(change, axis=0), calm[1:] & calm[:-1]
        rests = _some(np.flatnonzero(calm & (angle < LEAST_STEP / 4)), RESTS)
        turns = _some(np.flatnonzero(calm & (angle > LEAST_STEP)), TURNS)
        rate = [x[name][: n * width].reshape(n, width) for name in ANGULAR_RATE]
        self.rests.append(_finite(np.array([r[rests].mean(axis=1) for r in rate]).T))
        # both windows of a step, one after the other
        both = np.array([np.concatenate([r[turns], r[turns + 1]], axis=1) for r in rate])
        rise = (np.arange(self.fine) + 0.5) / self.fine * self.dt
        weighted = np.concatenate([u[:, turns], u[:, turns + 1]], axis=2)
        weighted *= np.concatenate([rise, rise[::-1]])
        moment = np.einsum("int,jnt->nij", weighted, means(both, self.rows)).reshape(-1, 9)
        self.steps.append(_finite(np.hstack([change[:, turns].T, weighted.sum(axis=2).T, moment])))

    def fit(self):
        """Return how well the axes fit, as `axes` in quality.schema.yaml; None of too few turns."""
        steps, rests = (thinned(np.concatenate(x), KEPT) for x in (self.steps, self.rests))
        if len(steps) < LEAST_STEPS:
            return None
        change = steps[:, :3]
        bias = np.median(rests, axis=0) if len(rests) else np.zeros(3)
        # ∫ w u (r - b), then its share by the cross product for each mapping
        moment = steps[:, 6:].reshape(-1, 3, 3) - steps[:, 3:6, None] * bias
        by_axis = np.einsum("ijk,njl->nkli", CROSS, moment)
        turned = np.einsum("pkl,nkli->pni", MAPPINGS, by_axis)
        size = np.sqrt((turned**2).sum(axis=2))
        # what hardly turns gravity says nothing of the direction
        size = np.maximum(size, 0.1 * np.median(size[0]) + 1e-12) * np.linalg.norm(change.T, axis=0)
        # a damaged file may hold 1e306
        cosine = np.nan_to_num((turned * change).sum(axis=2) / size)
        agreement = cosine.mean(axis=1)
        best = int(np.argmax(agreement))
        lead = cosine[best] - cosine[0]
        favour, against = int((lead > 0.2).sum()), int((lead < -0.2).sum())
        power, common = (turned[best] ** 2).sum(), (turned[best] * change).sum()
        ratio = np.divide(power, common)
        possible = agreement > agreement[best] - NEAR_BEST
        sure = agreement[best] > AGREEMENT and lead.mean() > LEAD
        fits = None
        if sure and favour >= max(LEAST_STEPS, STEPS_AGAINST * against) and not possible[0]:
            same = (MAPPINGS[possible] == MAPPINGS[best]).all(axis=(0, 2))
            fits = [int(v) for v in (MAPPINGS[best] @ [1, 2, 3]) * same]
        return {
            "agreement": float(agreement[0]),
            "best": float(agreement[best]),
            "ratio": float(ratio) if common > 0 and np.isfinite(ratio) else None,
            "steps": [favour, against],
            "steps_used": len(steps),
            "mapping": fits if fits and any(fits) else None,
        }


def _finite(rows):
    """Return the rows that are finite."""
    return rows[np.isfinite(rows).all(axis=1)]


def _some(at, n):
    """Return n to 2 n of the places, evenly spread."""
    return at[:: max(len(at) // n, 1)]
