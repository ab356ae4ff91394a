"""Turns of a known angle, or at a known rate, gathered from the sessions of a device."""

import numpy as np

from imuloop.calibrate.recording import Log
from imuloop.calibrate.sessions import usable_sessions
from imuloop.core.samples import ANGULAR_RATE, read_columns, read_metadata
from imuloop.core.segments import STATIC
from imuloop.core.units import DEGREE
from imuloop.factors.known_turns import KnownTurns

# cosine of 20 degrees: if its axis is closer to gravity, a turn was made on a level table
LEVEL = 0.94


def read_turns(sessions, force):
    """Return the KnownTurns of a device, its turns by a declared angle or at a declared rate.

    `sessions` is a dict by name of dicts with the ``kind`` of the session and the paths of its
    ``samples`` and ``segments``. `force` is the SensorCalibration of the accelerometer, which
    measures the vertical. The bias of the gyroscope in the KnownTurns is its mean over all rests of
    the sessions with such turns, and zero if they have no rest.
    """
    turns, rests = [np.zeros((0, 7))], [np.zeros((0, 4))]
    for session, table in usable_sessions(sessions, "known_rotation"):
        metadata = read_metadata(session["samples"])
        log = Log.of(read_columns(session["samples"]), metadata.get("rails"))
        rows = [_measure_turn(log, turn, force) for turn in metadata.get("known_rotation", ())]
        turns += [row[None] for row in rows if row is not None]
        columns = [table["n"], *(table[f"{c}_mean"] for c in ANGULAR_RATE)]
        rests.append(np.column_stack(columns)[table["kind"] == STATIC])
    turned, seconds, target = np.split(np.concatenate(turns), [3, 4], axis=1)
    n, *rates = np.concatenate(rests).T
    bias = np.average(rates, axis=1, weights=n) if len(n) else np.zeros(3)
    return KnownTurns(turned=turned, seconds=seconds[:, 0], target=target, bias=bias)


def _measure_turn(log, turn, force):
    """Return the measured and the declared rotation of a turn, (7,), or None if it is not usable.

    The result has the integral of the measured angular rate, rad, (3 values), the duration, s, and
    the declared rotation vector, rad, (3 values). A turn with clipped samples or fewer than three
    samples is not usable. The declared rotation is about the declared axis of the body. If this
    axis lies within 20 degrees of gravity at the start of the turn, the turn is taken to be made on
    a level table, about the vertical that the accelerometer measures.

    `log` is the Log of the session. `turn` is a dict with the ``axis``, such as -z, with the
    ``angle``, deg, or the ``rate``, deg/s, and with ``start`` and ``end``, s, if it is only a part
    of the log. `force` is the SensorCalibration of the accelerometer.
    """
    start, end = turn.get("start", log.t[0]), turn.get("end", log.t[-1])
    first, last = np.searchsorted(log.t, [start, end])
    rows = slice(first, last + 1)
    t = log.t[rows]
    if len(t) < 3 or log.clipped[0, rows].any():
        return None
    duration = np.ptp(t)
    angle = turn["angle"] if "angle" in turn else turn["rate"] * duration
    sign, letter = turn["axis"][0], turn["axis"][-1]
    axis = np.eye(3)["xyz".index(letter)] * (-1 if sign == "-" else 1)
    # upward direction from about twenty samples around the start
    up = force.aligned(log.f[max(first - 10, 0) : first + 10]).mean(axis=0)
    up /= np.linalg.norm(up)
    if abs(up @ axis) > LEVEL:
        axis = up * np.sign(up @ axis)
    turned = np.trapezoid(log.w[rows], t, axis=0)
    return np.concatenate([turned, [duration], angle * DEGREE * axis])
