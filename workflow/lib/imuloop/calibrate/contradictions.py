"""Turns that contradict all others, and the time at which a sensor changed amid a recording.

By equal weights: poses and turns that contradict others say nothing of the noise.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from imuloop.estimate.least_squares import keep_last_result
from imuloop.factors.factors import Factors
from imuloop.factors.gravity_norm import gravity_norm
from imuloop.model.state import BASE, COUNT, State

# what contradicts is off by so many times what the others are, and a turn that is left out by more
# than effects of sensors, rad
TIMES = 10.0
TURN = 0.05
# errors up to here count by their square, above by their size
EVEN = 1e-3
# turns from which most can contradict one, and the share of them that may be left out
FEWEST, SHARE = 12, 0.1
# poses and turns from which nine parameters leave errors, and the share of all that these are; how
# many on the other side of a change, which share of them contradicts, and by how much at least: of
# gravity, rad
PARTS = {"accelerometer": 12, "gyroscope": 8}
LONG = 1 / 3
CHANGED, MOST = 3, 0.5
LEAST = {"accelerometer": 5e-3, "gyroscope": 0.015}
# misalignment, rad, scale factor, 1, and bias, of gravity, that a data sheet allows at most
LOOSE = 0.1
# singular value over the largest, columns of length one, below which it is taken for this share
UNSEEN = 1e-9
# by how much the errors before a change may differ with the poses that count to them
UNEVEN = 2.0


@dataclass(frozen=True)
class Errors:
    """Errors of m poses or turns by one calibration of all, and what they depend on."""

    values: np.ndarray  # (m, c): of c components
    design: np.ndarray  # (m, c, 9): derivative by nine parameters of the sensor
    # (m, c, c): covariance of the errors by the direction of gravity, zero at poses
    spread: np.ndarray

    def robust(self):
        """Return the errors about a soft-L1 fit of the parameters, (m, c)."""
        y, rows = self.values.ravel(), self.design.reshape(-1, 9)
        p = robust(lambda p: y + rows @ p, lambda p: rows, np.zeros(9))
        return self.values + self.design @ p

    def scores(self, usual, leverage):
        """Return the size of each error over its standard deviation, (m,).

        Takes the standard deviation of a usual error, and the derivative by the parameters times
        a root of their covariance for usual errors of one, (m, c, 9).
        """
        unit = np.eye(self.values.shape[1])
        own = usual**2 * (unit + leverage @ leverage.swapaxes(1, 2)) + self.spread
        return np.sqrt(np.einsum("mc,mcd,md->m", self.values, np.linalg.pinv(own), self.values))


def inverse_root(rows):
    """Return R, (p, p), with ``R Rᵀ = (Jᵀ J)⁻¹`` of rows J, (n, p): large where J shows nothing."""
    size = np.linalg.norm(rows, axis=0)
    size[size == 0] = 1.0
    square = np.concatenate([rows / size, np.zeros((len(size),) * 2)])
    _, values, axes = np.linalg.svd(square, full_matrices=False)
    return axes.T / np.maximum(values, UNSEEN * (values[0] or 1.0)) / size[:, None]


def fitted(poses):
    """Fit gravity's norm at Poses with soft-L1 loss, and loosely to the data sheet.

    Returns the parameters of the accelerometer, (9,), specific force in shares of gravity, a root
    of their covariance, (9, 9), and the RestRows: what the poses do not determine is as the data
    sheet has it.
    """
    K = np.full(3, 1 / np.median(np.linalg.norm(poses.f, axis=1)))
    start, nothing = np.concatenate([np.zeros(3), K, np.zeros(3)]), np.zeros((len(poses), 3, 0))
    loose = np.diag(1 / (LOOSE * np.concatenate([np.ones(3), K, 1 / K])))

    def linearise(x):
        sensor = State(np.append(x, np.zeros(COUNT - 9))).sensor("accelerometer")
        return gravity_norm(sensor, poses.f, 1.0, nothing)

    rows = keep_last_result(linearise)
    x = robust(
        lambda x: np.append(rows(x).residual, EVEN * loose @ (x - start)),
        lambda x: np.concatenate([rows(x).jacobian[:, 0], EVEN * loose]),
        start,
    )
    found = rows(x)
    usual = np.median(np.abs(found.residual)) / 0.67
    usual *= np.sqrt(len(poses) / max(len(poses) - 9, 1))
    root = inverse_root(np.concatenate([found.jacobian[:, 0], usual * loose]))
    return x, usual * root, found


def pose_errors(poses):
    """Return the Errors of gravity's norm at Poses about a soft-L1 fit, share of gravity."""
    *_, rows = fitted(poses)
    return Errors(rows.residual, rows.jacobian, np.zeros((len(poses), 1, 1)))


def turn_errors(recording):
    """Return the Errors of Rotations, rad, by the data sheet's misalignment and scale factor.

    A turn carries gravity's direction from pose to pose, as a soft-L1 fit of the accelerometer has
    it. The bias is the mean rate of both poses: it may drift. Takes a Recording.
    """
    poses, moves = recording.poses, recording.rotations
    bias = (poses.w[moves.first] + poses.w[moves.first + 1]) / 2
    recording = replace(recording, rotations=replace(moves, w=moves.w - bias[:, None]))
    x, root, _ = fitted(poses)
    state = State(np.concatenate([x, np.repeat([0.0, 1.0, 0.0], [6, 3, 3])]))
    at = Factors(1.0).about(recording, state).at(state.x)
    values, design = at.residual[4 * len(poses) :], at.jacobian[4 * len(poses) :]
    design = design.reshape(len(moves), 2, COUNT)
    # how well the directions are known
    known = design[..., BASE["accelerometer"]] @ root
    by_turn = design[..., BASE["gyroscope"]][..., :9]
    return Errors(values.reshape(-1, 2), by_turn, known @ known.swapaxes(1, 2))


def live(poses):
    """Tell whether Poses have a specific force and a rate each: a dead sensor contradicts none."""
    norm = np.linalg.norm(poses.f, axis=1)
    return len(norm) > 0 and bool(np.all(norm > 0) and np.isfinite(poses.w).all())


def robust(residuals, derivative, start):
    """Return the parameters of a least-squares fit with soft-L1 loss."""
    how = {"loss": "soft_l1", "f_scale": EVEN, "x_scale": "jac"}
    return least_squares(residuals, start, derivative, **how).x


def odd_turns(recording):
    """Return which turns of a Recording contradict all others, and by how much, rad, (m,) each.

    None where more than a few do. What a turn too quick for the log may lose contradicts nothing,
    nor does a turn from or to a direction of gravity that the poses do not determine.
    """
    rotations = recording.rotations
    if len(rotations) < FEWEST or not live(recording.poses):
        return np.zeros(len(rotations), dtype=bool), np.zeros(len(rotations))
    turns = turn_errors(recording)
    errors = np.linalg.norm(turns.robust(), axis=1)
    doubt = np.einsum("mcc->m", turns.spread) + np.einsum("mgii->m", rotations.extra_covariance)
    odd = errors > np.maximum(TIMES * np.maximum(np.median(errors), np.sqrt(doubt)), TURN)
    return odd & (odd.sum() <= max(1, SHARE * len(odd))), errors


def first_changed(errors, fewest, least):
    """Return the number of the first error that contradicts those before it; None if none does.

    Takes the Errors, the fewest that determine their parameters, and the least size of an error
    that contradicts. Parts contradict each other where no parameters fit both, and those of one
    predict most errors of the other to be far smaller than they are, by as much as that part
    determines them. It is as long as its errors stay even.
    """
    n, found, left = len(errors.values), [], np.linalg.norm(errors.robust(), axis=1)
    if np.sum(left > least) < CHANGED * MOST:
        return None
    for k in range(CHANGED, n - CHANGED + 1):
        before, after = np.arange(k), np.arange(k, n)
        for known, other in ((before, after), (after, before)):
            if len(known) < max(fewest, LONG * n):
                continue
            rows, y = errors.design[known].reshape(-1, 9), errors.values[known].ravel()
            root = inverse_root(rows)
            p = -root @ (root.T @ (rows.T @ y))
            usual = np.sqrt(np.sum((y + rows @ p) ** 2) / (len(y) - len(p)))
            design = errors.design[other]
            predicted = Errors(errors.values[other] + design @ p, design, errors.spread[other])
            far = predicted.scores(usual, design @ root) > TIMES
            if np.mean(far & (np.linalg.norm(predicted.values, axis=1) > least)) >= MOST:
                found.append((len(known), usual, k))
    if not found:
        return None
    smallest = min(usual for _, usual, _ in found)
    return max((count, k) for count, usual, k in found if usual <= UNEVEN * smallest)[1]


def changed_at(sensor, recording):
    """Return when a sensor changed amid a Recording, s, and a description; None if it did not."""
    poses, rotations = recording.poses, recording.rotations
    if sensor == "accelerometer":
        table, what, name = poses, "poses", "the accelerometer"
    else:
        table, what = rotations, "turns"
        name = "the gyroscope, or an axis of the accelerometer,"
    # two sessions have two clocks
    if len(table) < PARTS[sensor] + CHANGED or not live(poses) or np.ptp(poses.session):
        return None
    errors = pose_errors(poses) if table is poses else turn_errors(recording)
    k = first_changed(errors, PARTS[sensor], LEAST[sensor])
    if k is None:
        return None
    time = (table.end_s[k - 1] + table.start_s[k]) / 2
    return time, (
        f"{name} changed at about {time:.4g} s: the "
        f"{k} {what} before contradict the {len(table) - k} after; was its range, scale, "
        "mounting or clock changed there, or were logs joined? Calibrate one part: time_range"
    )


def change(sensor, recording):
    """Return when and how a sensor changed amid a Recording, in words, or None if it did not."""
    found = changed_at(sensor, recording)
    return found and found[1]
