"""The motion of the next recording: about which axes to turn, and how fast."""

from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.linalg import block_diag

from imuloop.calibrate.pose_fits import Solution
from imuloop.core.effect import find_effect
from imuloop.core.samples import SENSORS
from imuloop.plan.information import (
    RATE_IN_USE,
    Information,
    combined,
    held_by,
    of_recording,
)
from imuloop.plan.session import QUARTERS

# what turns show of an accelerometer, and the power of the rate that it grows with
SOUGHT = {"lever_arm": 2, "rate_sensitivity": 1}
# s of a turn: the slowest that are enough are asked for, else the fastest
SECONDS = (2.0, 1.0, 0.5)
# sets of axes, the fewest first, and how many times as far from the levels is as good as all three
SETS = tuple(axes for n in (1, 2, 3) for axes in combinations(range(3), n))
AS_GOOD = 1.25


def turns_in_motion(sensor, solution, calibration, recording, floor, planned):
    """Return the turns that show arms and sensitivities to rate that are not known.

    A parameter is known where what a standard error of it does at `RATE_IN_USE` is the noise of a
    mean of one second, its level. Asked for are the slowest quarter and half turns that bring all
    there, about the fewest axes that do, or do as well as all three. What is physically possible
    is known beforehand. What the final calibration holds is known as well as there.

    Takes MotionPoses, the Solution with what was found, the final Calibration, the Recording of the
    moves, that noise, m/s^2, (3,), and what gives the Recording of turns from their axis and
    seconds. The dict, empty where all are known, is that of ``diagnosis.json``, of the parameter
    that is the farthest from its level.
    """
    shapes = {find_effect(name)(): power for name, power in SOUGHT.items()}
    effects = (*solution.effects, *(e for e in shapes if e not in solution.effects))
    names = [*sensor.names, *(f"{k}.{p}" for k, e in enumerate(effects) for p in e.parameters)]
    sought = {f"{effects.index(e)}.{p}": (e, p) for e in shapes for p in e.parameters}
    level = {
        name: float(floor["xyz012".index(p[1]) % 3] / RATE_IN_USE ** shapes[e])
        for name, (e, p) in sought.items()
    }
    fit = solution.fit
    x = np.append(fit.x, np.zeros(len(names) - len(fit.x)))
    excess = max(1.0, fit.reduced_chi2) if fit.dof > 0 else 1.0
    solution = Solution(effects, replace(fit, x=x))
    held, covariance = _held(calibration, effects)
    open_to = {n: e.limit for n, (e, _) in sought.items() if n not in held}
    possible = np.diag([open_to[n] ** -2.0 if n in open_to else 0.0 for n in names])
    now = combined(names, held, covariance, of_recording(sensor, solution, recording) / excess)
    errors = dict(zip(held, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    information = Information(sensor, solution, tuple(names), errors, now + possible)

    def known(more=None):
        """Return standard errors by name, and that farthest from its level: how far, and whose."""
        std = information.std(more)
        return std, *max(((std[n] or np.inf) / level[n], n) for n in sought)

    std, far, worst = known()
    if not 1 < far < np.inf:
        return {}
    model = replace(sensor, quiet=np.ones(len(QUARTERS), dtype=bool), of_rotation=0.0)
    for seconds in SECONDS:
        more = [of_recording(model, solution, planned(axis, seconds)) / excess for axis in range(3)]
        after = {axes: known(sum(more[axis] for axis in axes)) for axes in SETS}
        if (least := after[SETS[-1]][1]) <= 1:
            break
    axes = next(axes for axes in SETS if after[axes][1] <= max(1, AS_GOOD * least))
    effect, parameter = sought[worst]
    return {
        "parameter": f"{effect.name}.{parameter}",
        "unit": effect.parameters[parameter],
        "std": std[worst],
        "level": level[worst],
        "axes": ["xyz"[axis] for axis in axes],
        "turns": len(QUARTERS),
        "seconds": seconds,
        "std_after": after[axes][0][worst],
    }


def _held(calibration, effects):
    """Return names, as here, and covariance of what a Calibration holds of these parameters."""
    places = {(e.sensors[0], e.name): k for k, e in enumerate(effects)}
    names, blocks = [], []
    for sensor in SENSORS:
        own, covariance = held_by(getattr(calibration, sensor))
        at = []
        for i, name in enumerate(own):
            effect, _, parameter = name.rpartition(".")
            place = places.get((sensor, effect)) if effect else sensor
            if place is not None:
                names.append(f"{place}.{parameter}")
                at.append(i)
        blocks.append(covariance[np.ix_(at, at)])
    return names, block_diag(*blocks)
