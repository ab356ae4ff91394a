"""Do the devices of a board agree on turns and gravity? What is a device's own, what is common."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from imuloop.calibrate.gyroscope import tangents
from imuloop.core.rotation import exponential, matrix, prefix_product, step_vectors

# rad; a smaller turn has no axis
LEAST_TURN = 0.1


@dataclass(frozen=True)
class Reading:
    """What a device shows of a quantity: values, SI, (n,), and covariances, (n, n).

    `noise` is of the noise alone, `covariance` holds the errors of the calibration too.
    """

    values: np.ndarray
    noise: np.ndarray
    covariance: np.ndarray

    @property
    def chi2(self):
        """χ² against zero."""
        return float(self.values @ np.linalg.solve(self.covariance, self.values))

    @property
    def p_value(self):
        """Probability of as large a χ² by noise and errors of the calibration."""
        return float(chi2.sf(self.chi2, len(self.values)))

    @property
    def error(self):
        """Root mean square of what errors of the calibration do not explain, SI."""
        left = self.noise @ np.linalg.solve(self.covariance, self.values)
        return float(np.sqrt(np.mean(left**2)))

    def less(self, other):
        """Return the difference to an independent one."""
        pairs = zip(vars(self).values(), vars(other).values(), (-1, 1, 1), strict=True)
        return Reading(*(mine + sign * theirs for mine, theirs, sign in pairs))


def mean(readings):
    """Return the mean of independent readings, weighed by the inverse of their variance."""
    weights = 1 / np.array([np.trace(r.covariance) for r in readings])
    weights /= weights.sum()
    parts = zip(*(vars(r).values() for r in readings), strict=True)
    each = zip(parts, (weights, weights**2, weights**2), strict=True)
    return Reading(*(np.tensordot(shares, np.array(part), 1) for part, shares in each))


def own_parts(readings, level):
    """Return what each device shows beside the others, and the names of those that agree.

    The device that differs most is left out of the others' mean, until none in it differs, that is
    has a p-value below `level`: what one does wrong is not put down to the others. Takes the
    Reading of at least two devices by name.
    """
    agreeing = list(readings)

    def beside(name):
        return readings[name].less(mean([readings[each] for each in agreeing if each != name]))

    while len(agreeing) > 2:
        worst = max(agreeing, key=lambda name: beside(name).chi2)
        if beside(worst).p_value >= level:
            break
        agreeing.remove(worst)
    return {name: beside(name) for name in readings}, agreeing


def readings(shared, turns, i, gravity, calibration, noise):
    """Return the Readings of device i by kind.

    - ``turn``: its angle about the axis a of each move, ``a · ∫ C (w − ρ) dt``, less that of all
      devices together, rad; ρ is the mean rate in both rests. A slight error of the rotation
      between the devices does not change it.
    - ``closure``: the direction of gravity before a move less that after it, carried back, along
      two axes square to it, rad. What all devices miss alike shows here alone.
    - ``gravity_norm``: ``|f| − g`` of each rest, m/s².

    `turns`, (3, 3) each, are the rotations of all devices to the first one.
    """
    turn, f, bias = turns[i], shared.at_rest(shared.f), shared.at_rest(shared.w)
    # of all devices together
    w, down, rest = (
        np.einsum("kij,k...j->...i", turns, x) / len(turns) for x in (shared.w, f, bias)
    )
    down, norm = down / np.linalg.norm(down, axis=1)[:, None], np.linalg.norm(f[i], axis=1)
    own_down, own_rest = f[i] / norm[:, None], bias[i] @ turn.T
    moves, levers, values, gains = [], [], [], []
    for m in shared.moves:
        rows = slice(shared.rests[m, 1] - 1, shared.rests[m + 1, 0] + 1)
        rates, t, own = w[rows] - (rest[m] + rest[m + 1]) / 2, shared.t[rows], shared.w[i, rows]
        path = matrix(prefix_product(exponential(step_vectors(rates, np.diff(t)))))
        path = np.concatenate([np.eye(3)[None], path])
        # by trapezoids
        summed = path * np.gradient(t)[:, None, None]
        summed[[0, -1]] /= 2
        together = np.einsum("nij,nj->i", summed, rates)
        if (angle := np.linalg.norm(together)) < LEAST_TURN:
            continue
        delta = own @ turn.T - (own_rest[m] + own_rest[m + 1]) / 2
        delta = np.einsum("nij,nj->i", summed, delta) - together
        square = tangents(down[[m]])[0]
        lever = np.array([together / angle, *np.cross(square, down[m])])
        value = lever @ delta
        value[1:] += square @ (turn @ own_down[m] - path[-1] @ turn @ own_down[m + 1])
        moves.append((m, t[0], t[-1]))
        levers.append(lever)
        values.append(value)
        gains.append(np.einsum("ai,nij,nk->ajk", lever, summed @ turn, own))
    count, spans = len(moves), np.array(moves).reshape(-1, 3)
    first = spans[:, 0].astype(int)
    windows = np.concatenate([spans[:, 1:], shared.t[shared.rests - [0, 1]]])
    covariance = noise.pose_mean_covariance(windows)
    at_rest = covariance[:3, count:, count:]
    # of a mean rate over a move less the means at both its rests, as alike on all axes
    less = np.eye(count, len(windows))
    less[np.arange(count), count + first] = less[np.arange(count), count + first + 1] = -0.5
    less *= np.ptp(windows[:count], axis=1)[:, None]
    angles = less @ covariance[3:].mean(axis=0) @ less.T
    tilts = np.diagonal(at_rest.mean(axis=0)) / gravity**2
    tilts = np.outer(tilts[first] + tilts[first + 1], [0, 1, 1]).ravel()
    levers, each = np.array(levers).reshape(-1, 3), np.repeat(np.arange(count), 3)
    rates = levers @ levers.T * angles[each[:, None], each] + np.diag(tilts)
    gains = np.pad(np.array(gains).reshape(-1, 3, 3), ((0, 0), (0, 0), (0, 1)))
    values, is_turn, found = np.array(values).ravel(), np.arange(3 * count) % 3 == 0, {}

    def reading(values, noise, gain, sensor):
        gain = gain.reshape(len(values), 12)
        return Reading(values, noise, noise + gain @ calibration_errors(sensor) @ gain.T)

    for kind, own in (("turn", is_turn), ("closure", ~is_turn)):
        alone = rates[np.ix_(own, own)]
        found[kind] = reading(values[own], alone, gains[own], calibration.gyroscope)
    found["gravity_norm"] = reading(
        norm - gravity,
        np.einsum("px,qx,xpq->pq", own_down, own_down, at_rest),
        np.einsum("pi,pj->pij", own_down, np.column_stack([f[i], np.ones(len(norm))])),
        calibration.accelerometer,
    )
    return found


def calibration_errors(sensor):
    """Return the covariance of M and β, row by row, (12, 12), in errors ``δx = M x + β``."""
    inverse, gain = np.linalg.inv(sensor.T), np.zeros((len(sensor.names), 3, 4))
    for row, name in zip(gain, sensor.names, strict=True):
        # not those of effects
        if "." not in name:
            i, j = int(name[1]), int(name[-1])
            column = np.eye(3)[i] if name[0] == "T" else sensor.T[:, j]
            if name[0] == "b":
                row[:, 3] = -column * sensor.K[j]
            else:
                row[:, :3] = np.outer(column, inverse[j]) / (sensor.K[j] if name[0] == "K" else 1)
    gain = gain.reshape(-1, 12)
    return gain.T @ sensor.covariance @ gain
