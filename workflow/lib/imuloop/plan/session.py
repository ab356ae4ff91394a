"""A planned multi-position session: its poses and rotations as a sensor would log them."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.calibrate.recording import record
from imuloop.core.rotation import exponential, matrix
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TEMPERATURE, TIME
from imuloop.core.segments import MOTION, STATIC
from imuloop.core.sphere import fibonacci_lattice

# what a first session should hold: seconds at rest before all, poses, seconds of a rest and a move
INITIAL_REST_S, POSES, REST_S, MOVE_S = 50.0, 40, 4.0, 2.0
# a turn of 360 degrees by hand, s
FULL_TURN_S = 5.0
# samples per second of a plan: enough to follow a hand that turns
RATE = 25.0
_CANDIDATES = fibonacci_lattice(500)


@dataclass(frozen=True)
class Plan:
    """Rests, and turns about fixed axes between them.

    `up` is the upward direction in the first of m + 1 rests, `turns` are rotation vectors, rad,
    (m, 3), both on body axes. The temperature, degC, is linear between shares of the session.
    """

    up: np.ndarray
    turns: np.ndarray
    initial_rest_s: float = INITIAL_REST_S
    rest_s: float = REST_S
    move_s: float | np.ndarray = MOVE_S
    temperature: tuple = ()

    @property
    def duration_s(self):
        """Length of the session, s."""
        moves = np.broadcast_to(self.move_s, len(self.turns))
        return float(self.initial_rest_s + len(self.turns) * self.rest_s + moves.sum())


def holes(directions, n):
    """Return n unit vectors, each the farthest from all before it and from those given, (k, 3)."""
    nearest = (_CANDIDATES @ np.reshape(directions, (-1, 3)).T).max(axis=1, initial=-1.0)
    found = []
    for _ in range(n):
        found.append(_CANDIDATES[nearest.argmin()])
        nearest = np.maximum(nearest, _CANDIDATES @ found[-1])
    return np.array(found)


def turns_between(up):
    """Return the shortest turns, rad, (n - 1, 3), that bring one of n directions after another up.

    On body axes.
    """
    before, after = np.asarray(up)[:-1], np.asarray(up)[1:]
    axis = np.cross(after, before)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    # opposite directions: about any axis square to them
    any_axis = np.cross(before, np.eye(3)[np.abs(before).argmin(axis=1)])
    axis = np.where(sine > 1e-9, axis, any_axis)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return axis * np.arctan2(sine, (before * after).sum(axis=1, keepdims=True))


def full_turns(axis, n, poses, *, move_s=MOVE_S, **habits):
    """Return the Plan of n turns of 360 degrees about a level body axis, there and back.

    Poses come first, at these upward directions, (k, 3): rests in one attitude only leave the
    segmentation nothing to choose by. A move lasts `move_s`, a turn `FULL_TURN_S` at least; the
    rest goes to the Plan.
    """
    up = np.concatenate([poses, np.roll(np.eye(3)[axis], 1)[None]])
    turns = np.zeros((n, 3))
    turns[:, axis] = 2 * np.pi * (-1.0) ** np.arange(n)
    seconds = np.repeat([move_s, max(FULL_TURN_S, move_s)], [len(poses), n])
    return Plan(up[0], np.concatenate([turns_between(up), turns]), move_s=seconds, **habits)


def planned_recording(plan, calibration, variance, rate, aliased=0.0):
    """Return the Recording that a device would log of a plan, without noise, SI as logged.

    The effects of its calibration are left out: they are small, and what is asked of the
    recording, derivatives and covariances, does not change by more than they do. Takes the sample
    variance at rest of the six channels, SI squared, the samples per second, Hz, and the variance
    that this rate adds to each axis of a turn, rad².
    """
    moves = np.broadcast_to(plan.move_s, len(plan.turns))
    # rest, move, rest, …, rest: the number of each sample's part, even at rest
    seconds = np.full(2 * len(moves) + 1, plan.rest_s)
    seconds[0], seconds[1::2] = plan.initial_rest_s, moves
    n = np.maximum(np.round(seconds * RATE), 4).astype(int)
    edges = np.concatenate([[0], np.cumsum(n)])
    part = np.repeat(np.arange(len(n)), n)
    turns = np.zeros((len(n), 3))
    turns[1::2] = plan.turns
    up = [np.asarray(plan.up, dtype=float)]
    for whole in matrix(exponential(turns[1::2])):
        up.append(whole.T @ up[-1])
    share = (np.arange(len(part)) - edges[part]) / n[part]
    turned = share - np.sin(2 * np.pi * share) / (2 * np.pi)
    attitude = matrix(exponential(turned[:, None] * turns[part]))
    directions = np.einsum("nji,nj->ni", attitude, np.array(up)[part // 2])
    speed = (1 - np.cos(2 * np.pi * share)) / (n[part] / RATE)
    log = {TIME: np.arange(len(part)) / RATE}
    for sensor, names, values in (
        (calibration.accelerometer, ACCELERATION, calibration.gravity * directions),
        (calibration.gyroscope, ANGULAR_RATE, speed[:, None] * turns[part]),
    ):
        raw = values @ np.linalg.inv(sensor.T).T / sensor.K + sensor.b
        log |= dict(zip(names, sensor.raw_unit.to_si(raw).T, strict=True))
    if plan.temperature:
        at = np.arange(len(part)) / len(part)
        log[TEMPERATURE] = np.interp(at, *np.transpose(plan.temperature))
    rest = np.arange(len(n)) % 2 == 0
    # what a rest of a plan shows does not change
    means = {f"{name}_mean": log[name][edges[:-1]] for name in CHANNELS}
    deviations = zip(CHANNELS, np.sqrt(variance), strict=True)
    segments = {
        "start_s": edges[:-1] / RATE,
        "end_s": edges[1:] / RATE,
        "kind": np.where(rest, STATIC, MOTION),
        "pose": np.where(rest, np.arange(len(n)) // 2, -1),
        "n": np.maximum(1, np.round(n / RATE * rate)),
        "tilt_rad": np.zeros(len(n)),
        **means,
        **{f"{name}_std": np.full(len(n), size) for name, size in deviations},
    }
    made = record([log], [segments], np.inf).without_aliasing().of_new_power_cycles()
    at = np.zeros((len(made.rotations), 1), int)
    extra = np.tile(aliased * np.eye(3), (*at.shape, 1, 1))
    return replace(made, rotations=replace(made.rotations, extra_at=at, extra_covariance=extra))
