"""A multi-position session that is only planned: its poses and rotations as a sensor logs them."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from imuloop.calibrate.recording import record
from imuloop.core.rotation import exponential, matrix
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TEMPERATURE, TIME
from imuloop.core.segments import MOTION, STATIC, segment_table
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
    up, pieces, spans = np.asarray(plan.up, dtype=float), [], []
    at = _steps(plan.initial_rest_s)
    pieces.append((np.tile(up, (at, 1)), np.zeros((at, 3))))
    spans.append((0, at, STATIC))
    for turn, seconds in zip(
        plan.turns, np.broadcast_to(plan.move_s, len(plan.turns)), strict=True
    ):
        n = _steps(seconds)
        share = np.arange(n) / n
        course = share - np.sin(2 * np.pi * share) / (2 * np.pi)
        attitude = matrix(exponential(course[:, None] * turn))
        speed = (1 - np.cos(2 * np.pi * share)) / (n / RATE)
        pieces.append((np.einsum("nji,j->ni", attitude, up), speed[:, None] * turn))
        up = matrix(exponential(turn)).T @ up
        rest = _steps(plan.rest_s)
        pieces.append((np.tile(up, (rest, 1)), np.zeros((rest, 3))))
        spans += [(at, at + n, MOTION), (at + n, at + n + rest, STATIC)]
        at += n + rest
    directions, rates = (np.concatenate(part) for part in zip(*pieces, strict=True))
    samples = pd.DataFrame({TIME: np.arange(at) / RATE})
    for columns, sensor, x in (
        (ACCELERATION, calibration.accelerometer, calibration.gravity * directions),
        (ANGULAR_RATE, calibration.gyroscope, rates),
    ):
        raw = x @ np.linalg.inv(sensor.T).T / sensor.K + sensor.b
        samples[list(columns)] = sensor.raw_unit.to_si(raw)
    if plan.temperature:
        samples[TEMPERATURE] = np.interp(np.arange(at) / at, *np.transpose(plan.temperature))
    first, last, kinds = zip(*spans, strict=True)
    poses = np.where(np.array(kinds) == STATIC, (np.arange(len(kinds)) + 1) // 2, -1)
    segments = segment_table(samples, np.divide(first, RATE), np.divide(last, RATE), kinds, poses)
    made = record([samples], [segments], np.inf)
    n = np.maximum(1, np.rint(made.poses.duration_s * rate)).astype(int)
    return replace(
        made, poses=replace(made.poses, n=n, variance=np.tile(variance, (len(made.poses), 1)))
    )


def _steps(seconds):
    return max(4, round(seconds * RATE))
