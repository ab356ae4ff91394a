"""Attitudes, parameters and standard errors in the words of advice."""

import numpy as np

from imuloop.report.effect_units import data_sheet
from imuloop.report.numbers import MILLIRADIAN, duration, joined, number, with_unit
from imuloop.report.results import XYZ

# where an axis stands apart from the vertical by less, degrees, it is simply up or down
UPRIGHT = 10.0


def attitude_words(up):
    """Return an attitude in words, from the upward direction on the sensor's axes.

    Parameters
    ----------
    up : array_like, shape (3,)
        Unit vector.

    Returns
    -------
    str
        As ``x axis down, tilted 30° towards +y``: the axis nearest to the vertical, and which other
        axes rise by the tilt.
    """
    up = np.asarray(up, dtype=float)
    main = int(np.abs(up).argmax())
    text = f"{XYZ[main]} axis {'up' if up[main] > 0 else 'down'}"
    tilt = np.degrees(np.arccos(np.clip(abs(up[main]), 0, 1)))
    if tilt < UPRIGHT:
        return text
    rest = [i for i in range(3) if i != main]
    most = max(abs(up[i]) for i in rest)
    toward = [f"{'+' if up[i] > 0 else '−'}{XYZ[i]}" for i in rest if abs(up[i]) > most / 2]
    return f"{text}, tilted {tilt:.0f}° towards {joined(toward)}"


def parameter_words(sensor, name):
    """Return a parameter in words: ``the gyroscope's z scale factor``."""
    words = {"K": "scale factor", "b": "bias"}
    if "." in name:
        effect, parameter = name.split(".", 1)
        return f"the {sensor}'s {effect} {parameter}"
    if name[0] == "T":
        first, second = (XYZ[int(i)] for i in name[1:])
        return f"the {sensor}'s misalignment {first}{second}"
    return f"the {sensor}'s {XYZ[int(name[1])]} {words[name[0]]}"


def sigma_words(unit, *values):
    """Return standard errors, SI, in the data sheets' unit: ``310 to 140 ppm``.

    Parameters
    ----------
    unit : str
        SI unit.
    *values : float
        One, or before and after.
    """
    display = MILLIRADIAN if unit == "rad" else data_sheet(unit)
    return with_unit(" to ".join(number(v * display.factor, 2) for v in values), display.unit)


def candidate_words(entry):
    """Return what a candidate for the next recording asks to do."""
    length = duration(entry["duration_s"], 2)
    if entry["name"] == "again":
        return f"the same session once more ({length})"
    if entry["name"] == "static":
        return f"{length} at rest"
    first = attitude_words(entry["up"])
    text = f"{entry['poses']} more poses in the largest holes of the sphere, the first with {first}"
    if entry["name"] == "turns":
        axis = entry["axis"]
        text += f", then {entry['turns']} turns of 360° about {axis}, both ways, with {axis} level"
    if entry["name"] == "heat_and_cool":
        span = number(entry["span_K"], 2)
        text += f", while the device is heated by {span}\u202fK and cooled again"
    return f"{text} ({length})"
