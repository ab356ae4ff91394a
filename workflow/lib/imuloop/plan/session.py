"""A multi-position session that is only planned: its poses and rotations as a sensor logs them."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from imuloop.calibrate.recording import record
from imuloop.core.rotation import exponential
from imuloop.core.samples import CHANNELS, SENSORS, TEMPERATURE, TIME
from imuloop.core.segments import MOTION, STATIC
from imuloop.core.sphere import fibonacci_lattice
from imuloop.simulate.motion import Piece, chain, rest, shortest_turn

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
    return np.array([shortest_turn(*pair) for pair in pairwise(up)]).reshape(-1, 3)


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
    pieces = [rest(_samples(plan.initial_rest_s), 0)]
    for k, (turn, seconds) in enumerate(zip(plan.turns, moves, strict=True), 1):
        pieces += [_by_hand(turn, _samples(seconds)), rest(_samples(plan.rest_s), k)]
    motion = chain(pieces, plan.up, calibration.gravity, RATE)
    log = {TIME: motion.t}
    true = zip(SENSORS.items(), (motion.specific_force, motion.angular_rate), strict=True)
    for (name, axes), values in true:
        sensor = getattr(calibration, name)
        raw = values @ np.linalg.inv(sensor.T).T / sensor.K + sensor.b
        log |= dict(zip(axes, sensor.raw_unit.to_si(raw).T, strict=True))
    if plan.temperature:
        at = np.arange(len(motion.t)) / len(motion.t)
        log[TEMPERATURE] = np.interp(at, *np.transpose(plan.temperature))
    n, pose = np.array([(len(piece.rate), piece.pose) for piece in pieces]).T
    first = np.cumsum(n) - n
    segments = {
        "start_s": first / RATE,
        "end_s": (first + n) / RATE,
        "kind": np.where(pose >= 0, STATIC, MOTION),
        "pose": pose,
        "n": np.maximum(1, np.round(n / RATE * rate)),
        "tilt_rad": np.zeros(len(n)),
    }
    for name, deviation in zip(CHANNELS, np.sqrt(variance), strict=True):
        # what a rest of a plan shows does not change
        segments |= {f"{name}_mean": log[name][first], f"{name}_std": np.full(len(n), deviation)}
    made = record([log], [segments], np.inf).without_aliasing().of_new_runs()
    at = np.zeros((len(made.rotations), 1), int)
    added = np.tile(aliased * np.eye(3), (*at.shape, 1, 1))
    return replace(made, rotations=replace(made.rotations, added_at=at, added=added))


def _samples(seconds):
    return max(round(seconds * RATE), 4)


def _by_hand(turn, n):
    """Return the Piece of a turn, rad, by n samples, its speed as of 1 - cos."""
    share = 2 * np.pi * np.arange(n) / n
    angle, speed = (share - np.sin(share)) / (2 * np.pi), (1 - np.cos(share)) / (n / RATE)
    attitude = exponential(np.outer(angle, turn))
    return Piece(attitude, np.outer(speed, turn), np.zeros((n, 3)), exponential(turn))
