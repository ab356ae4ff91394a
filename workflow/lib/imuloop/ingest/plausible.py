"""Whether a log is what it is declared to be: units, full scales, increments, milliseconds.

Two yardsticks need no calibration: gravity, for the specific force at rest, and the direction of
gravity from rest to rest, for the angular rate. No sensor is off by a half. So what lies at a known
factor from them is a unit or a full scale declared wrongly; what is merely far away is doubtful.
Increments of velocity and angle are off by the step of the log in both sensors.

Most functions take the `checks.Evidence` on a log and return what a message needs, or None.
"""

from math import log

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import ACCELERATION as ACCELERATION_UNITS
from imuloop.core.units import ANGULAR_RATE as ANGULAR_RATE_UNITS
from imuloop.core.units import INCREMENTS
from imuloop.core.units import TIME as TIME_UNITS
from imuloop.ingest.rests import measure_turns

# the specific force at rest is gravity within this share; the mean of a log without rests is
# gravity within this factor
PLAUSIBLE_FORCE, PLAUSIBLE_MOVING = 0.2, 2.0
# a ratio is at a known factor within this share, as biases of a tenth of g and scale errors leave
# it, or within so many standard errors; a ratio whose error is larger than the last says nothing
NEAR, SIGMAS, MOST_ERROR = 0.1, 3.0, 0.15
# turns inside moves say as little as the last where the axes agree better, which a hand that
# accelerates the device does not leave; one force in so many attitudes is gravity
AGREEMENT, LEAST_ATTITUDES = 0.9, 4
# full scales of a sensor differ by powers of two
FULL_SCALES = (2, 4, 8, 16)
# a step of the specific force that needs a turn, of its size
MOST_JUMP = 0.05
# fastest log in milliseconds, slowest in whole seconds, Hz
MOST_RATE, EACH_SECOND = 1e4, 0.7

_UNITS = {"acceleration": ACCELERATION_UNITS, "angular_rate": ANGULAR_RATE_UNITS}


def milliseconds(columns, figures, stamps, rate=None):
    """Return why stamps that are taken as seconds are milliseconds; None if they may be seconds.

    Takes columns of samples, their quality figures, their times as stamped, s, and the declared
    rate, Hz.
    """
    taken, factor, why = figures["rate_hz"], 1 / TIME_UNITS["ms"], None
    if not figures["faults"] or not taken or taken * factor > MOST_RATE:
        return None
    axes, rests = measure_turns(columns, taken * factor, columns["t"])
    ratio, error, _ = turn_ratio(
        figures | {"faults": figures["faults"] | {"axes": axes, "rests": rests}}
    )
    if rate:
        if rate > taken * factor / 2:
            why = f"the declared rate is {_about(rate / taken)} times the rate in seconds"
    # between the ratio that a sound log has and that of deg/s taken as rad/s
    elif error and 0.2 < ratio < 100:
        why = f"turns measured by the gyroscope are {_about(ratio * factor)} times those of gravity"
    elif taken < EACH_SECOND and np.allclose(stamps, np.rint(stamps), 0, 1e-6):
        why = f"they are whole, and {taken:.3g} Hz is unusual for an IMU"
    remedy = "declare units.time: ms, or s if they are"
    return why and f"the stamps look like milliseconds: {why}; {remedy}"


def _about(number):
    """Return a number to two digits, as words have it."""
    return f"{float(f'{number:.2g}'):,.0f}"


def unit_factors(quantity, unit):
    """Return what a log is off by if its unit is another one, and the words on each."""
    scale, words = unit.scale, f"taken as {unit.name}, it looks like {{}}; see units.{quantity}"
    if unit.name == "count":
        scale, words = 1, f"nominal.{quantity}.scale is in SI per count, and looks like {{}}"
    known = _UNITS[quantity].items()
    return [(scale / si, words.format(name)) for name, si in known if si != scale]


def increment_factors(quantity, unit, rate):
    """Return what a log is off by if it holds increments, and what to declare for each."""
    scale, words = unit.scale, f"units.{quantity}: {{0}}"
    if unit.name == "count":
        scale, words = 1, f"nominal.{quantity}.scale: {{1:.6g}}"
    steps = {name: si * rate for name, si in INCREMENTS[quantity].items()}
    return [(scale / f, words.format(name, unit.scale * f)) for name, f in steps.items()]


def full_scale_factors(quantity, unit):
    """Return what a log is off by if the full scale is another one, and the words on each."""
    counts = f"nominal.{quantity}.scale or range.{quantity}"
    words = f"the one that {counts if unit.name == 'count' else 'the logger'} has"
    factors = [*FULL_SCALES, *(1 / n for n in FULL_SCALES)]
    return [(f, f"the sensor's full scale was {1 / f:g} times {words}") for f in factors]


def nearest(value, factors, share=NEAR):
    """Return the words on the factor that a value lies at, within a share; None if at none."""
    fits = [(abs(log(value / factor)), words) for factor, words in factors if value > 0]
    away, words = min(fits, default=(np.inf, None))
    return words if away <= log(1 + share) else None


def _cause(e, quantity, ratio, cut, share=NEAR):
    """Return which unit a ratio of a sensor looks like, or full scale if its range is not cut."""
    unit = e.units[quantity]
    cause = nearest(ratio, unit_factors(quantity, unit), share)
    return cause or (not cut and nearest(ratio, full_scale_factors(quantity, unit), share))


def force_off(e):
    """Return (ratio, rests, words) where the specific force is not gravity, else None.

    The ratio is that of the force at rest, or of its mean, to gravity.
    """
    rests, low = e.faults["rests"], 1 / PLAUSIBLE_MOVING
    force, high = e.figures["mean_specific_force"], PLAUSIBLE_MOVING
    if rests:
        force, low, high = rests["force"][1], 1 - PLAUSIBLE_FORCE, 1 + PLAUSIBLE_FORCE
    if low <= force / e.gravity <= high or not np.isfinite(force):
        return None
    where = "specific force at rest" if rests else "mean specific force"
    return force / e.gravity, rests, f"the {where} is {force:.4g} m/s^2, gravity {e.gravity:.4g}"


def _spread(rests, share):
    """Return whether the force at rest differs by less than a share."""
    return rests and rests["force"][2] < rests["force"][0] * (1 + share)


def _is_gravity(rests):
    """Return whether one force is held in many attitudes, as gravity's is."""
    return _spread(rests, NEAR) and rests["attitudes"] >= LEAST_ATTITUDES


def increments(e):
    """Return why a log holds increments that are taken as rates.

    Both sensors are then off by its step. Where the turns say nothing, one force in many attitudes
    is gravity. Wrong units may look the same, as mm/s and mrad over 1 ms: they come first.
    """
    ratio, rests, words = force_off(e) or (0, None, "")
    turned, error, turns = turn_ratio(e.figures)
    off, rate = {"acceleration": (ratio, NEAR if rests else 0.5)}, e.figures["rate_hz"]
    if error and error <= MOST_ERROR:
        off["angular_rate"] = turned, error
        words = f"{words}, and {turns}: both sensors are off by"
    elif _is_gravity(rests):
        words = f"{words}, in {rests['attitudes']} attitudes: gravity is off by"
    else:
        return None
    found = [nearest(f, increment_factors(q, e.units[q], rate), s) for q, (f, s) in off.items()]
    others = [nearest(f, unit_factors(q, e.units[q]), s) for q, (f, s) in off.items()]
    if not all(found) or all(others):
        return None
    see = "; see units.angular_rate too" if len(off) == 1 else ""
    return {"words": words, "step": 1 / rate, "unit": f"{' and '.join(found)}{see}"}


def unit_of_force(e):
    """Return which unit, full scale or counts the specific force looks like, where it is off."""
    ratio, rests, words = force_off(e) or (0, None, "")
    unit, axes = e.units["acceleration"], e.faults["stuck"]
    # an axis that is dead, stuck or clipped takes its part of gravity away
    cut = [n for n in axes if axes[n]["stretches"] or e.faults["clipped_at"][n]["rows"]]
    cause = _cause(
        e, "acceleration", ratio, cut or e.figures["constant"] or not _spread(rests, 0.5)
    )
    steps = [(e.figures["quantisation_step"][name] or 0) / unit.scale for name in ACCELERATION]
    if ratio and not cause and unit.name in ("m/s^2", "g") and np.allclose(steps, 1, 1e-6):
        scale = "" if (e.nominal or {}).get("acceleration") else ", and nominal.acceleration"
        cause = f"taken as {unit.name}, whole numbers that look like counts; declare "
        cause += f"units.acceleration: count{scale}; see units.angular_rate too"
    return cause and f"{words}: {cause}"


def size_of_force(e):
    """Return the words on a specific force that is off by no known factor, before the remedy."""
    if not (off := force_off(e)):
        return None
    ratio, rests, words = off
    if _is_gravity(rests):
        words += f": gravity is in it, in {rests['attitudes']} attitudes, {ratio:.2g} of it"
    elif ratio < 0.3:
        why = "has gravity been taken out of the log, or does it hold increments per sample?"
        return f"{words}: {why} If not, "
    return f"{words}; "


def is_live(figures):
    """Return whether the gyroscope shows turns at all: it is not stuck, padded or a copy."""
    found, constant = figures["faults"], figures["constant"]
    dead = [n for n in ANGULAR_RATE if found["stuck"][n]["stretches"] or n in constant]
    return not (found["zero_rows"]["angular_rate"] or found["copies"] or dead)


def jump_of_force(e):
    """Return the rests if they show a step of the specific force which no turn goes with."""
    return e.faults["rests"] if _jumps(e.faults["rests"]) and is_live(e.figures) else None


def _jumps(rests):
    """Return whether rests show a step of the specific force which no turn goes with."""
    return rests and rests["jump_m_s2"] > MOST_JUMP * rests["force"][1]


def turn_ratio(figures):
    """Return how far the angular rate turns the device beside gravity, its error, and the words.

    The ratio is None where nothing is known of it, its error where it says little.
    """
    axes, rests = figures["faults"]["axes"], figures["faults"]["rests"]
    words = "the angular rate turns the device {:.3g} times as far as gravity turns in its axes"
    # a jump of the force is no turn
    if not is_live(figures) or _jumps(rests):
        return None, None, ""
    if ratio := rests and rests["turn_ratio"]:
        value, std = ratio["value"], ratio["std"]
        words = f"{words.format(value)}, over {ratio['moves']} moves from rest to rest"
        return value, max(NEAR / 2, SIGMAS * std / value), words
    if axes and axes["ratio"]:
        error = MOST_ERROR if axes["best"] > AGREEMENT else None
        return axes["ratio"], error, words.format(axes["ratio"])
    return None, None, ""


def is_cut(e):
    """Return whether the angular rate reaches the end of its range, which looks like a scale."""
    clipped = e.faults["clipped_at"]
    return any(clipped[n]["rows"] or e.figures["clipped"][n] for n in ANGULAR_RATE)


def unit_of_rate(e):
    """Return which unit or full scale the angular rate looks like, where turns show it."""
    value, error, words = turn_ratio(e.figures)
    if not error or error > MOST_ERROR:
        return None
    cause = _cause(e, "angular_rate", value, is_cut(e), error)
    return cause and f"{words}: {cause}"


def scale_of_rate(e):
    """Return the words on an angular rate that turns the device too far, by no known factor."""
    value, error, words = turn_ratio(e.figures)
    far = error and abs(log(value)) > log(1 + max(NEAR, error))
    return far and not is_cut(e) and f"{words}: its scale is off by as much"
