"""Whether the log is what it is declared to be: units, full scales, a session that does not move.

Two yardsticks need no calibration: gravity, for the specific force at rest, and gravity's direction
from rest to rest, for the angular rate. No sensor is off by a half, so what lies at a known factor
from them is a unit or a full scale declared wrongly, and the session is rejected; what is merely
far away is told.
"""

from math import log

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import ACCELERATION as ACCELERATION_UNITS
from imuloop.core.units import ANGULAR_RATE as ANGULAR_RATE_UNITS
from imuloop.core.units import DEGREE, STANDARD_GRAVITY

# the specific force at rest is gravity within this share, else it is told
PLAUSIBLE_FORCE = 0.2
# a log that never rests: the mean specific force lies within these parts of gravity
PLAUSIBLE_MOVING = (0.5, 2.0)
# at a known factor within this share: biases of a tenth of g, scales off by some per cent
NEAR_FORCE = 0.1
# the least share for turns, and standard errors; what the turns inside moves tell, where there are
# no rests, is off by so much where a hand accelerates the device
NEAR_TURN, SIGMAS, MOVING_ERROR = 0.05, 3.0, 0.15
# turns that differ from gravity's by more are told
PLAUSIBLE_TURN_RATIO = 0.1
# how well the axes have to fit for that, and in how many steps
AGREEMENT, LEAST_STEPS = 0.9, 10
# where nothing fits well: between rotation about the vertical and a wrong unit lies a factor
LOOSE_RATIO = (0.2, 10.0)
# full scales of a sensor differ by powers of two
FULL_SCALES = (2, 4, 8, 16)
# hint of a unit where only the order of size is known
LOOSE_HINT = (0.4, 4.0)
# no sensor at rest shows more; no hand turns faster than this on average, rad/s
PLAUSIBLE_REST, PLAUSIBLE_MEAN_RATE = 1.0, 10.0
# a change of gravity's direction that no drift of a bias makes, rad: 0.15 g
MOST_TILT = 0.15
# a static session rests at least for this share of its time
LEAST_REST = 0.5
# the mean rate of half a second changes by more, rad/s, and by so many times the power of white
# noise: the device turns to and fro
MOST_CHANGE, MOST_CHANGE_SHARE = 0.01, 4.0
# a step of the specific force without a turn, of gravity
MOST_JUMP = 0.05
# stops that follow each other differ by less in a slow tilt, rad
SLOW_STEP = 0.1
# times that an integer wraps around, to be told and to make the log useless: logs that were joined
# jump so once or twice
WRAPS_TOLD, MOST_WRAPS = 3, 20
# the magnitude of the specific force is that of a computed gravity where it varies less, of itself,
# while the device turns so much that an axis changes by this share of it
COMPUTED, TURNED = 1e-4, 0.1

CHANGED = "scale or bias changed amid the log, or logs were joined: crop it with time_range"


def judged(figures, units, gravity, kind=None):
    """Return what is wrong with units, scales and kind of a session.

    Parameters
    ----------
    figures : dict
        Quality figures, `faults` among them.
    units : dict
        Raw unit of each sensor, `RawUnit`.
    gravity : float
        Local gravity, m/s^2.
    kind : str, optional
        What was done with the device, where that is known.

    Returns
    -------
    reasons, warnings : list of str
        Why the log cannot be used as declared, and what a user should look at.
    """
    found = figures["faults"]
    if not found:
        return [], []
    wrapped = {name: n for name, n in found["wraps"].items() if n >= WRAPS_TOLD}
    if wrapped:
        listed = ", ".join(f"{name} {n} times" for name, n in wrapped.items())
        text = (
            f"values jump from one end of the range to the other and stay there: {listed}; an "
            "integer that wraps around: widen it in the logger, or choose a wider full scale"
        )
        # nothing else can be told of such values
        return ([text], []) if max(wrapped.values()) >= MOST_WRAPS else ([], [text])
    changed = list(_levels(figures, found, gravity))
    reasons, warnings = [], []
    for fatal, text in (
        # of two levels the middle one says nothing
        *(changed or _force(figures, found, units["acceleration"], gravity)),
        *_turns(figures, found, units["angular_rate"], gravity),
        *(_moved(found["rests"], gravity) if kind == "static" else ()),
        *_computed(figures),
    ):
        (reasons if fatal else warnings).append(text)
    return reasons, warnings


def _known_factors(quantity, unit, known):
    """Return what a log would be off by, at rest or over a turn, and the words on each cause."""
    factors = []
    if unit.name == "count":
        others = {
            "acceleration": {"g": 1 / STANDARD_GRAVITY, "mg": 1e3 / STANDARD_GRAVITY},
            "angular_rate": {"deg/s": 1 / DEGREE, "mrad/s": 1e3},
        }[quantity]
        si = {"acceleration": "m/s^2", "angular_rate": "rad/s"}[quantity]
        for name, factor in others.items():
            text = f"nominal.{quantity}.scale is in {si} per count, and looks like {name} per count"
            factors.append((factor, text))
    else:
        for name, scale in known.items():
            if name != unit.name:
                text = f"taken as {unit.name}, it looks like {name}; see units.{quantity}"
                factors.append((unit.scale / scale, text))
    return factors


def _full_scales(quantity, unit):
    """Return the factors between full scales, and the words on each."""
    where = f"nominal.{quantity}.scale" if unit.name == "count" else "the logger's scale"
    for n in FULL_SCALES:
        for factor, words in ((n, f"1/{n} of"), (1 / n, f"{n} times")):
            text = f"the sensor's full scale was {words} the one that {where} is for"
            yield float(factor), text


def _nearest(value, factors, share):
    """Return the words on the factor that a value lies at; None if at none."""
    fits = [(abs(log(value / factor)), text) for factor, text in factors]
    away, text = min(fits, default=(np.inf, None))
    return text if away <= log(1 + share) else None


def _force(figures, found, unit, gravity):
    """Tell a specific force at rest that is not gravity."""
    rests = found["rests"]
    if rests:
        low, force, high = rests["force"]
        where, limits = "specific force at rest", (1 - PLAUSIBLE_FORCE, 1 + PLAUSIBLE_FORCE)
    else:
        low = force = high = figures["mean_specific_force"]
        where, limits = "mean specific force", PLAUSIBLE_MOVING
    if not np.isfinite(force) or limits[0] <= force / gravity <= limits[1]:
        return
    told = f"the {where} is {force:.4g} m/s^2, gravity {gravity:.4g}"
    factors = _known_factors("acceleration", unit, ACCELERATION_UNITS)
    text = force > 0 and _nearest(force / gravity, factors, NEAR_FORCE)
    if text:
        yield True, f"{told}: {text}"
        return
    # an axis that is dead, stuck or clipped takes its part of gravity away
    whole = not figures["constant"] and not any(
        found["stuck"][name]["stretches"] or found["clipped_at"][name]["rows"]
        for name in found["stuck"]
    )
    if rests and whole and high < 1.5 * low:
        text = _nearest(force / gravity, _full_scales("acceleration", unit), NEAR_FORCE)
        if text:
            yield True, f"{told}: {text}"
            return
    if force < 0.3 * gravity:
        yield False, f"{told}: has gravity been taken out of the log?"
    else:
        yield False, f"{told}: see units.acceleration and nominal.acceleration"


def _live(figures, found):
    """Tell whether the gyroscope shows turns at all: not stuck, padded or a copy."""
    return not (
        found["zero_rows"]["angular_rate"]
        or found["copies"]
        or any(
            found["stuck"][name]["stretches"] or name in figures["constant"]
            for name in ANGULAR_RATE
        )
    )


def _turns(figures, found, unit, gravity):
    """Tell an angular rate that does not turn the device as gravity says."""
    axes, rests = found["axes"], found["rests"]
    ratio = rests and rests["turn_ratio"]
    # a jump of the force is no turn
    live = _live(figures, found) and not (rests and rests["jump_m_s2"] > MOST_JUMP * gravity)
    sure = value = None
    if live and ratio:
        value = ratio["value"]
        sure = max(NEAR_TURN, SIGMAS * ratio["std"] / value)
        told = (
            f"the angular rate turns the device {value:.3g} ± {ratio['std']:.1g} times as far as "
            f"gravity turns in its axes, over {ratio['moves']} moves from rest to rest"
        )
    elif live and axes and axes["ratio"]:
        value = axes["ratio"]
        told = (
            f"the angular rate turns the device {value:.3g} times as far as gravity turns in its "
            "axes"
        )
        if axes["best"] > AGREEMENT and axes["steps_used"] >= LEAST_STEPS:
            sure = MOVING_ERROR
    rate = "; or the log's rate is off by as much"
    factors = _known_factors("angular_rate", unit, ANGULAR_RATE_UNITS)
    if value and sure and sure <= MOVING_ERROR:
        text = _nearest(value, factors, sure)
        text = text or _nearest(value, _full_scales("angular_rate", unit), sure)
        if text:
            yield True, f"{told}: {text}{rate}"
            return
    mean, rest = figures["mean_angular_rate"], found["rate_at_rest"]
    if mean > PLAUSIBLE_MEAN_RATE:
        yield (
            False,
            f"the mean angular rate is {mean:.4g} rad/s, too much for a turn by hand: "
            "see units.angular_rate",
        )
    elif value and sure and abs(log(value)) > max(log(1 + PLAUSIBLE_TURN_RATIO), sure):
        yield (
            False,
            f"{told}: its scale is off by as much; see units.angular_rate and "
            f"nominal.angular_rate{rate}",
        )
    elif value and not sure and not LOOSE_RATIO[0] <= value <= LOOSE_RATIO[1]:
        hint = "see units.angular_rate and nominal.angular_rate"
        fits = [text for f, text in factors if LOOSE_HINT[0] <= value / f <= LOOSE_HINT[1]]
        yield False, f"{told}: {fits[0] if fits else hint}{rate}"
    elif rest and rest > PLAUSIBLE_REST:
        yield (
            False,
            f"the angular rate is {rest:.4g} rad/s in the quietest stretches, too much for a bias: "
            "see units.angular_rate and nominal.angular_rate",
        )


def _moved(rests, gravity):
    """Tell a static session that moves."""
    if not rests:
        return
    declare = "a static session lies still: declare another kind, or crop it with time_range"
    turned, share = rests["turned"], rests["share"]
    # a step of the force without a turn is of the sensor
    if turned > MOST_TILT and rests["jump_m_s2"] < 0.5 * turned * gravity:
        told = f"gravity turns by up to {np.degrees(turned):.0f}° in the axes of the device"
        n = rests["attitudes"]
        if rests["next"] < SLOW_STEP:
            told += ", slowly, and farther than a drift of the bias would take it: it tilts"
        elif share >= LEAST_REST:
            told += f": it looks like a multi_position session of {n} attitudes"
        else:
            told += f", and rests for {share:.0%} of the time only: it looks like a log of motion"
        yield True, f"{told}; {declare}"
    elif share < LEAST_REST and rests["change"] > MOST_CHANGE:
        yield True, f"the device rests for {share:.0%} of the time only; {declare}"
    elif share < LEAST_REST:
        yield (
            False,
            f"only {share:.0%} of the time is nearly as quiet as the quietest parts, and nothing "
            "turns: noise or vibration changes much within the session",
        )
    elif rests["change"] > MOST_CHANGE and (rests["change_share"] or 0.0) > MOST_CHANGE_SHARE:
        yield (
            True,
            f"the mean angular rate of half a second changes by {np.degrees(rests['change']):.2g} "
            f"deg/s to the next, {rests['change_share']:.2g} times the power of its noise: the "
            f"device turns to and fro, as in flight; {declare}",
        )


def _levels(figures, found, gravity):
    """Tell a specific force at rest that goes from one level to another amid the log."""
    rests = found["rests"]
    if rests and rests["levels"]:
        levels = rests["levels"]
        yield (
            False,
            f"from {levels['from_s']:.6g} s on the specific force at rest lies on another level: "
            f"its magnitude less the bias goes from {levels['before']:.4g} to "
            f"{levels['after']:.4g} m/s^2; {CHANGED}",
        )
    elif rests and rests["jump_m_s2"] > MOST_JUMP * gravity and _live(figures, found):
        yield (
            False,
            f"at {rests['jump_s']:.6g} s the specific force at rest changes by "
            f"{rests['jump_m_s2']:.3g} m/s^2 and the gyroscope shows no turn; {CHANGED}",
        )


def _computed(figures):
    """Tell a specific force whose magnitude never changes though the device turns."""
    size, spread = figures["mean_specific_force"], figures["specific_force_std"]
    widest = max(high - low for low, high in (figures["range"][name] for name in ACCELERATION))
    if spread is not None and spread < COMPUTED * size and widest > TURNED * size:
        yield (
            False,
            f"the magnitude of the specific force is the same within {spread / size:.1g} of itself "
            "however the device turns: a gravity that was computed, corrected or filtered, not the "
            "accelerometer's output; log that",
        )
