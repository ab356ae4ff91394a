"""A multi-position session that is only planned: its poses and rotations as a sensor logs them."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.calibrate.poses import Poses, Rotations
from imuloop.calibrate.recording import Log, Recording, pose_means
from imuloop.core.rotation import exponential, matrix
from imuloop.core.sphere import fibonacci_lattice

# what a first session should hold: seconds at rest before all, poses, seconds of a rest and a move
INITIAL_REST_S, POSES, REST_S, MOVE_S = 50.0, 40, 4.0, 2.0
# a turn of 360 degrees by hand, s
FULL_TURN_S = 5.0
# samples a second of a plan: enough to follow a hand that turns
RATE = 25.0
_CANDIDATES = fibonacci_lattice(500)


@dataclass(frozen=True)
class Plan:
    """Rests, and turns about fixed axes between them.

    Attributes
    ----------
    up : ndarray, shape (3,)
        Upward direction on body axes in the first rest.
    turns : ndarray, shape (m, 3)
        Rotation vectors, rad, on body axes; there are m + 1 rests.
    initial_rest_s, rest_s : float
        Seconds of the first rest, and of each other one.
    move_s : float or ndarray, shape (m,)
        Seconds of the turns.
    temperature : tuple of (float, float)
        Share of the session and degC, linear between them; none without.
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
    """Return n directions, each the farthest from all before it and from those given.

    Parameters
    ----------
    directions : array_like, shape (k, 3)
        Unit vectors; k may be 0.
    n : int
        How many.

    Returns
    -------
    ndarray, shape (n, 3)
        Unit vectors.
    """
    nearest = (_CANDIDATES @ np.reshape(directions, (-1, 3)).T).max(axis=1, initial=-1.0)
    found = []
    for _ in range(n):
        found.append(_CANDIDATES[nearest.argmin()])
        nearest = np.maximum(nearest, _CANDIDATES @ found[-1])
    return np.array(found)


def turns_between(up):
    """Return the shortest turns that bring one upward direction after the other up.

    Parameters
    ----------
    up : array_like, shape (n, 3)
        Unit vectors on body axes.

    Returns
    -------
    ndarray, shape (n - 1, 3)
        Rotation vectors, rad.
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

    Poses come first: rests in one attitude only leave the segmentation nothing to choose by.

    Parameters
    ----------
    axis : int
        Body axis.
    n : int
        Number of turns.
    poses : ndarray, shape (k, 3)
        Upward directions of the poses.
    move_s : float
        Seconds of a move; a turn takes `FULL_TURN_S` at least.
    **habits
        Of the Plan.
    """
    up = np.concatenate([poses, np.roll(np.eye(3)[axis], 1)[None]])
    turns = np.zeros((n, 3))
    turns[:, axis] = 2 * np.pi * (-1.0) ** np.arange(n)
    seconds = np.repeat([move_s, max(FULL_TURN_S, move_s)], [len(poses), n])
    return Plan(up[0], np.concatenate([turns_between(up), turns]), move_s=seconds, **habits)


def planned_recording(plan, calibration, variance, rate):
    """Return the recording that a device would log of a plan, without noise.

    The effects of its calibration are left out: they are small, and what is asked of the
    recording, derivatives and covariances, does not change by more than they do.

    Parameters
    ----------
    plan : Plan
        What is done with the device.
    calibration : Calibration
        Of the device.
    variance : array_like, shape (6,)
        Sample variance at rest of the six channels, SI squared.
    rate : float
        Samples a second of the device, Hz.

    Returns
    -------
    Recording
        SI, as logged.
    """
    up = np.asarray(plan.up, dtype=float)
    moves = [_steps(s) for s in np.broadcast_to(plan.move_s, len(plan.turns))]
    rests = [_steps(plan.initial_rest_s), *[_steps(plan.rest_s)] * len(moves)]
    ups, turns = [up], np.asarray(plan.turns, dtype=float).reshape(-1, 3)
    for whole in matrix(exponential(turns)):
        ups.append(whole.T @ ups[-1])
    # rest, move, rest, …, rest: the number of each sample's part, even at rest
    parts = np.empty(2 * len(moves) + 1, dtype=int)
    parts[::2], parts[1::2] = rests, moves
    part = np.repeat(np.arange(len(parts)), parts)
    moving, move = part % 2 == 1, part[part % 2 == 1] // 2
    directions, rates = np.array(ups)[part // 2], np.zeros((len(part), 3))
    turn, n = turns[move], np.array(moves, dtype=int)[move]
    share = (np.flatnonzero(moving) - (np.cumsum(parts) - parts)[part[moving]]) / n
    course = share - np.sin(2 * np.pi * share) / (2 * np.pi)
    attitude = matrix(exponential(course[:, None] * turn))
    directions[moving] = np.einsum("nji,nj->ni", attitude, directions[moving])
    rates[moving] = ((1 - np.cos(2 * np.pi * share)) / (n / RATE))[:, None] * turn
    logged = []
    for sensor, values, size in (
        (calibration.accelerometer, directions, calibration.gravity),
        (calibration.gyroscope, rates, 1.0),
    ):
        raw = size * values @ np.linalg.inv(sensor.T).T / sensor.K + sensor.b
        logged.append(sensor.raw_unit.to_si(raw))
    t, temperature = np.arange(len(logged[0])) / RATE, None
    if plan.temperature:
        temperature = np.interp(np.arange(len(t)) / len(t), *np.transpose(plan.temperature))
    log = Log(t, *logged, temperature)
    return _recorded(log, np.array(rests), np.array(moves, dtype=int), variance, rate)


def _recorded(log, rests, moves, variance, rate):
    """Return the recording of a log whose rests and moves have so many samples, in turn."""
    last = np.cumsum(rests) + np.concatenate([[0], np.cumsum(moves)])
    first, n = last - rests, len(rests)
    start, end = first / RATE, last / RATE
    # a rest of a plan does not change
    f, w = log.f[first], log.w[first]
    poses = Poses(
        session=np.zeros(n, dtype=int),
        # none of those that a calibration knows
        run=np.full(n, -1),
        start_s=start,
        end_s=end,
        duration_s=end - start,
        n=np.maximum(1, np.rint((end - start) * rate)).astype(int),
        f=f,
        w=w,
        variance=np.tile(variance, (n, 1)),
        temperature=None,
    )
    if log.temperature is not None:
        poses = replace(poses, temperature=pose_means(poses, (log,), [log.temperature]))
    # from the last sample of a rest to the first of the next, that one repeated
    steps = np.arange(moves.max(initial=0) + 2)
    at = np.minimum(last[:-1, None] - 1 + steps, first[1:, None])
    rotations = Rotations(
        first=np.arange(n - 1),
        start_s=log.t[at[:, 0]],
        end_s=log.t[at[:, -1]],
        t=log.t[at],
        w=log.w[at],
        f=log.f[at],
        temperature=None if log.temperature is None else log.temperature[at],
    )
    return Recording(poses, rotations, (log,))


def _steps(seconds):
    return max(4, round(seconds * RATE))
