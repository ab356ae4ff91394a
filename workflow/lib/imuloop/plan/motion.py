"""The motion of the next recording: about which axes to turn, and how fast."""

from dataclasses import replace
from itertools import combinations

import numpy as np

from imuloop.calibrate.sensor_pair import OfSensor
from imuloop.core.effect import find_effect
from imuloop.plan.information import RATE_IN_USE, Information
from imuloop.plan.session import QUARTERS

# what turns show of an accelerometer, and the power of the rate that it grows with
SOUGHT = {"lever_arm": 2, "rate_sensitivity": 1}
# s of a turn: the slowest that are enough are asked for, else the fastest
SECONDS = (2.0, 1.0, 0.5)
# sets of axes, the fewest first, and how many times as far from the levels is as good as all three
SETS = tuple(axes for n in (1, 2, 3) for axes in combinations(range(3), n))
AS_GOOD = 1.25


def turns_in_motion(diagnosed, floor, planned):
    """Return the turns that show arms and sensitivities to rate that are not known.

    A parameter is known where what a standard error of it does at `RATE_IN_USE` is the noise of a
    mean of one second, its level. Asked for are the slowest quarter and half turns that bring all
    there, about the fewest axes that do, or do as well as all three. What is physically possible
    is known beforehand. What the final calibration holds is known as well as there.

    Takes the Diagnosed with its motion, that noise, m/s^2, (3,), and what gives the Recording of
    turns from their axis and seconds. The dict, empty where all are known, is that of
    ``diagnosis.json``, of the parameter that is the farthest from its level.
    """
    shapes = {OfSensor(find_effect(n)(), "accelerometer"): power for n, power in SOUGHT.items()}
    known = Information.of(diagnosed, *diagnosed.motion, tuple(shapes))
    names, level = known.about.names, {}
    possible = np.zeros(len(names))
    for effect, power in shapes.items():
        for p in effect.parameters:
            name = f"{effect.sensor}.{effect.name}.{p}"
            level[name] = float(floor["xyz012".index(p[1]) % 3] / RATE_IN_USE**power)
            if name not in known.held:
                possible[names.index(name)] = effect.limit**-2.0
    known = replace(known, matrix=known.matrix + np.diag(possible))

    def farthest(std):
        """Return how far the parameter that is farthest from its level is, and its name."""
        return max(((std[name] or np.inf) / level[name], name) for name in level)

    now = known.std()
    far, worst = farthest(now)
    if not 1 < far < np.inf:
        return {}
    moving = replace(known, about=known.about.of_moves(np.ones(len(QUARTERS), dtype=bool)))
    for seconds in SECONDS:
        more = [moving.of_recording(planned(axis, seconds)) for axis in range(3)]
        after = {axes: known.std(sum(more[axis] for axis in axes)) for axes in SETS}
        distance = {axes: farthest(std)[0] for axes, std in after.items()}
        if (least := distance[SETS[-1]]) <= 1:
            break
    axes = next(axes for axes in SETS if distance[axes] <= max(1, AS_GOOD * least))
    return {
        "parameter": worst.removeprefix("accelerometer."),
        "unit": known.about.units[names.index(worst)],
        "std": now[worst],
        "level": level[worst],
        "axes": ["xyz"[axis] for axis in axes],
        "turns": len(QUARTERS),
        "seconds": seconds,
        "std_after": after[axes][worst],
    }
