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

    Turns with clipped samples or fewer than three samples are left out. The axis of a turn is the
    declared axis of the body. If this axis lies within 20 degrees of gravity at the start of the
    turn, the axis is the direction of gravity instead, which the accelerometer measures.

    `sessions` is a dict by name of dicts with the ``kind`` of the session and the paths of its
    ``samples`` and ``segments``. `force` is the SensorCalibration of the accelerometer.
    """
    turns, rests = [], []
    for session, table in usable_sessions(sessions, "known_rotation"):
        metadata = read_metadata(session["samples"])
        if not (declared_turns := metadata.get("known_rotation")):
            continue
        log = Log.of(read_columns(session["samples"]), metadata.get("rails"))
        t, still = log.t, table["kind"] == STATIC
        means = np.column_stack([table[f"{c}_mean"][still] for c in ANGULAR_RATE])
        rests.append((means, table["n"][still]))
        for turn in declared_turns:
            first, last = np.searchsorted(t, [turn.get("start", t[0]), turn.get("end", t[-1])])
            rows = slice(first, last + 1)
            if len(t[rows]) < 3 or log.clipped[0, rows].any():
                continue
            length = np.ptp(t[rows])
            turned = np.trapezoid(log.w[rows], t[rows], axis=0)
            angle = turn["angle"] if "angle" in turn else turn["rate"] * length
            # the declared axis is a sign and a letter, such as -z
            axis = np.eye(3)["xyz".index(turn["axis"][-1])] * (-1) ** (turn["axis"][0] == "-")
            # upward direction from about twenty samples around the start
            up = force.aligned(log.f[max(first - 10, 0) : first + 10]).mean(axis=0)
            up /= np.linalg.norm(up)
            if abs(up @ axis) > LEVEL:
                axis = up * np.sign(up @ axis)
            turns.append((turned, length, angle * DEGREE * axis))
    # the bias is the mean over all rests, weighted by their number of samples
    means, n = (np.concatenate(x) for x in zip(*rests, strict=True)) if rests else ([], [])
    bias = np.average(means, axis=0, weights=n) if len(n) else np.zeros(3)
    turned, seconds, target = zip(*turns, strict=True) if turns else ([], [], [])
    return KnownTurns(
        turned=np.reshape(turned, (-1, 3)),
        seconds=np.array(seconds),
        target=np.reshape(target, (-1, 3)),
        bias=bias,
    )
