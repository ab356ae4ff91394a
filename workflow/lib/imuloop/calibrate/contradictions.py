"""Turns that contradict all others, and the time at which a sensor changed amid a recording.

By equal weights: poses and turns that contradict others say nothing of the noise.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from imuloop.calibrate.accelerometer import AccelerometerModel
from imuloop.calibrate.gyroscope import GyroscopeModel, cross_matrix

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
# by how much the errors before a change may differ with the poses that count to them
UNEVEN = 2.0


def pose_errors(poses):
    """Return the errors of gravity's norm at Poses, share of gravity, (n, 1), about a robust fit.

    With their derivative by nine parameters, (n, 1, 9), and the directions of gravity, (n, 3). The
    parameters are those that most poses agree on.
    """
    model = AccelerometerModel(poses.f, np.zeros((len(poses), 3, 0)), 1.0)
    x = model.start()
    if len(poses) >= PARTS["accelerometer"]:
        x = robust(lambda x: model.residuals(x)[0], lambda x: model.residuals(x)[1], x)
    values, design = model.residuals(x)
    force = model.values(x)
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    return values[:, None], design[:, None], up


def turn_errors(poses, rotations):
    """Return the errors of Rotations, rad, (m, 2), by the data sheet, and their derivative.

    That is by misalignment and scale factor, (m, 2, 9). A turn carries gravity's direction from
    pose to pose, as `pose_errors` has it. Its bias is the mean rate of both poses: one may drift.
    """
    base = np.repeat([0.0, 1.0, 0.0], [6, 3, 3])
    bias = (poses.w[rotations.first] + poses.w[rotations.first + 1]) / 2
    rotations = replace(rotations, w=rotations.w - bias[:, None])
    no_effect = np.zeros((len(poses), 3, 0)), np.zeros((*rotations.w.shape, 0))
    up, ends = pose_errors(poses)[2], (poses.to_start, poses.to_end)
    model = GyroscopeModel(poses.w, no_effect[0], rotations, no_effect[1], up, *ends)
    carried, start = model.carried(base), model.departures
    by_turn = (carried @ cross_matrix(start))[:, None]
    design = model.summed(by_turn @ model.path(base).middle, base)
    return (carried @ start[..., None])[..., 0], design[..., :9]


def live(poses):
    """Tell whether Poses have a specific force and a rate each: a dead sensor contradicts none."""
    norm = np.linalg.norm(poses.f, axis=1)
    return len(norm) > 0 and bool(np.all(norm > 0) and np.isfinite(poses.w).all())


def robust(residuals, derivative, start):
    """Return the parameters of the least errors, large ones by their size."""
    how = {"loss": "soft_l1", "f_scale": EVEN, "x_scale": "jac"}
    return least_squares(residuals, start, derivative, **how).x


def odd_turns(poses, rotations):
    """Return which Rotations contradict all others, a mask, and by how much, rad, (m,) each.

    None where more than a few do. What a turn too quick for the log may lose contradicts nothing.
    """
    if len(rotations) < FEWEST or not live(poses):
        return np.zeros(len(rotations), dtype=bool), np.zeros(len(rotations))
    values, design = turn_errors(poses, rotations)
    rows = design.reshape(-1, 9)
    p = robust(lambda p: values.ravel() + rows @ p, lambda p: rows, np.zeros(9))
    errors = np.linalg.norm(values + design @ p, axis=1)
    lost = np.sqrt(np.einsum("mgii->m", rotations.extra_covariance))
    odd = errors > np.maximum(TIMES * np.maximum(np.median(errors), lost), TURN)
    return odd & (odd.sum() <= max(1, SHARE * len(odd))), errors


def first_changed(values, design, fewest, least):
    """Return the first of n errors from which they contradict those before; None if none does.

    Takes the errors, (n, c), their derivative, (n, c, p), the fewest that determine p parameters,
    and the least size of an error that contradicts. One side gives the parameters, by which most
    errors of the other are then far beyond its own. It is as long as its own stay even.
    """
    n, found = len(values), []
    for k in range(CHANGED, n - CHANGED + 1):
        before, after = np.arange(k), np.arange(k, n)
        for known, other in ((before, after), (after, before)):
            if len(known) < max(fewest, LONG * n):
                continue
            rows, y = design[known].reshape(-1, design.shape[-1]), values[known].ravel()
            p = np.linalg.lstsq(rows, -y)[0]
            usual = np.sqrt(np.sum((y + rows @ p) ** 2) / (len(y) - len(p)))
            errors = np.linalg.norm(values[other] + design[other] @ p, axis=1)
            if np.mean(errors > max(TIMES * usual, least)) >= MOST:
                found.append((len(known), usual, k))
    if not found:
        return None
    smallest = min(usual for _, usual, _ in found)
    return max((count, k) for count, usual, k in found if usual <= UNEVEN * smallest)[1]


def change(sensor, poses, rotations):
    """Return when and how a sensor changed amid a recording, in words, or None if it did not."""
    # two sessions have two clocks
    if not live(poses) or np.ptp(poses.session):
        return None
    if sensor == "accelerometer":
        (*errors, _), table, what = pose_errors(poses), poses, "poses"
        name = "the accelerometer"
    else:
        errors, table, what = turn_errors(poses, rotations), rotations, "turns"
        name = "the gyroscope, or an axis of the accelerometer,"
    k = first_changed(*errors, PARTS[sensor], LEAST[sensor])
    if k is None:
        return None
    return (
        f"{name} changed at about {(table.end_s[k - 1] + table.start_s[k]) / 2:.4g} s: the "
        f"{k} {what} before contradict the {len(table) - k} after; was its range, scale, "
        "mounting or clock changed there, or were logs joined? Calibrate one part: time_range"
    )
