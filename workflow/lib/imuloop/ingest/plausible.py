"""Whether the log is what it is declared to be: units, full scales, a session that does not move.

Two yardsticks need no calibration: gravity, for the specific force at rest, and gravity's direction
from rest to rest, for the angular rate. No sensor is off by a half, so what lies at a known factor
from them is a unit or a full scale declared wrongly, and the session is rejected; what is merely
far away is a warning. Increments of velocity and angle that nobody declared are off by the step of
the log in both sensors.
"""

from math import log, sqrt

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import ACCELERATION as ACCELERATION_UNITS
from imuloop.core.units import ANGULAR_RATE as ANGULAR_RATE_UNITS
from imuloop.core.units import DEGREE, INCREMENTS
from imuloop.core.units import TIME as TIME_UNITS
from imuloop.ingest.faults import turns
from imuloop.ingest.stamps import declare
from imuloop.ingest.stops import WINDOW

# the specific force at rest is gravity within this share; that of a log that never rests lies in
# these parts of it; at a known factor within the last share: biases of a tenth of g, scale errors
PLAUSIBLE_FORCE, PLAUSIBLE_MOVING, NEAR_FORCE = 0.2, (0.5, 2.0), 0.1
# the least share for turns, and standard errors; what the turns inside moves show, where there are
# no rests, is off by so much where a hand accelerates the device
NEAR_TURN, SIGMAS, MOVING_ERROR = 0.05, 3.0, 0.15
# the mean force of increments that never rest lies this near to gravity's; where turns say nothing,
# so many attitudes have to hold one force
NEAR_MOVING, LEAST_ATTITUDES = 0.5, 4
# in fewer it has to lie this near, beside noise of the angular rate below that of any MEMS
# gyroscope, rad/s/√Hz: no log of a better one has its gravity taken out
NEAR_ALONE, LEAST_NOISE = 0.05, 1e-5
# turns that differ from gravity's by more are worth a warning
PLAUSIBLE_TURN_RATIO = 0.1
# how well the axes have to fit for that, and in how many steps
AGREEMENT, LEAST_TURNS = 0.9, 10
# full scales of a sensor differ by powers of two
FULL_SCALES = (2, 4, 8, 16)
# on average no sensor at rest shows more, and no hand turns faster, rad/s
PLAUSIBLE_REST, PLAUSIBLE_MEAN_RATE = 1.0, 10.0
# a static session rests for this share of its time; its gravity turns by less than no drift of a
# bias makes, 0.15 g, rad
LEAST_REST, MOST_TILT = 0.5, 0.15
# the mean rate of half a second changes by more, rad/s, and by so many times the power of white
# noise: the device turns to and fro
MOST_CHANGE, MOST_CHANGE_SHARE = 0.01, 4.0
# a step of the specific force without a turn, of gravity
MOST_JUMP = 0.05
# times that an integer wraps around, to be named and to make the log useless: logs that were joined
# jump so once or twice
LEAST_WRAPS, MOST_WRAPS = 3, 20
# fastest log in milliseconds, Hz. Its turns are gravity's within these factors, which allow for
# deg/s taken as rad/s. A log in seconds, whole but for so much, that skips some is slower than the
# last, Hz
MOST_RATE, TURNS_IN_MS, WHOLE, EACH_SECOND = 1e4, (0.2, 100.0), 1e-6, 0.7


def judged(figures, units, gravity, kind=None, nominal=None):
    """Return why a session cannot be used as declared, and what a user should look at, as texts.

    `figures` are quality figures with `faults`, `units` the `RawUnit` of each sensor, `gravity` is
    the local one, m/s^2; `kind` what was done with the device, where that is known; `nominal` the
    declared scales of counts, or those of the data sheet, by quantity.
    """
    found, reasons, warnings = figures["faults"], [], []
    if not found:
        return [], []
    wrapped = {name: n for name, n in found["wraps"].items() if n >= LEAST_WRAPS}
    if wrapped:
        listed = ", ".join(f"{name} {n} times" for name, n in wrapped.items())
        text = (
            f"values jump from one end of the range to the other and stay there: {listed}; an "
            "integer that wraps around: widen it in the logger, or choose a wider full scale"
        )
        # nothing else can be said of such values
        if max(wrapped.values()) >= MOST_WRAPS:
            return [text], []
        warnings.append(text)
    turned = _turn_ratio(figures, gravity)
    if cause := _increments(figures, units, gravity, *turned):
        reasons.append(cause)
    else:
        scales = (nominal or {}).get("acceleration")
        _force(figures, units["acceleration"], gravity, scales, reasons, warnings)
        _turns(figures, units["angular_rate"], kind, *turned, reasons, warnings)
    if kind == "static" and found["rests"]:
        _moved(found["rests"], gravity, reasons, warnings)
    return reasons, warnings


def milliseconds(columns, figures, points, gravity, rate=None):
    """Return why stamps that are taken as seconds are milliseconds; None if they may be seconds.

    Takes columns of samples and their quality figures, `points` of row number and time, s, local
    gravity, m/s^2, and the declared rate, Hz.
    """
    taken, factor, why = figures["rate_hz"], 1 / TIME_UNITS["ms"], None
    if not figures["faults"] or not taken or taken * factor > MOST_RATE:
        return None
    if rate:
        if rate > taken * factor / 2:
            why = f"the declared rate is {_about(rate / taken)} times the rate in seconds"
    elif (ratio := _turns_at(columns, figures, taken * factor, gravity)) and (
        TURNS_IN_MS[0] < ratio < TURNS_IN_MS[1]
    ):
        why = f"turns measured by the gyroscope are {_about(ratio * factor)} times those of gravity"
    elif taken < EACH_SECOND and np.abs(points[:, 1] - np.rint(points[:, 1])).max() < WHOLE:
        why = f"they are whole, and {taken:.3g} Hz is unusual for an IMU"
    return why and f"the stamps look like milliseconds: {why}; {declare('ms')}, or s if they are"


def _turns_at(columns, figures, rate, gravity):
    """Return how far the angular rate turns samples of a rate beside gravity; None if unsure."""
    axes, rests = turns(columns, rate)
    found = {"axes": axes, "rests": rests}
    ratio, sure, _ = _turn_ratio(figures | {"faults": figures["faults"] | found}, gravity)
    return ratio if sure else None


def _about(number):
    """Return a number to two digits, as words have it."""
    return f"{float(f'{number:.2g}'):,.0f}"


def _known_factors(quantity, unit):
    """Return what a log would be off by, at rest or over a turn, and the words on each cause."""
    known = {"acceleration": ACCELERATION_UNITS, "angular_rate": ANGULAR_RATE_UNITS}[quantity]
    if unit.name == "count":
        si, *others = known
        where = f"nominal.{quantity}.scale is in {si} per count, and looks like"
        return [(1 / known[name], f"{where} {name} per count") for name in others]
    return [
        (unit.scale / scale, f"taken as {unit.name}, it looks like {name}; see units.{quantity}")
        for name, scale in known.items()
        if name != unit.name
    ]


def _summed_factors(quantity, unit, rate):
    """Return what increments taken as rates are off by, and what to declare in their place."""
    known, where = INCREMENTS[quantity], f"nominal.{quantity}.scale:"
    if unit.name == "count":
        return [(1 / (s * rate), f"{where} {unit.scale * s * rate:.6g}") for s in known.values()]
    return [(unit.scale / (s * rate), f"units.{quantity}: {name}") for name, s in known.items()]


def _full_scales(quantity, unit):
    """Return the factors between full scales, and the words on each."""
    where = f"nominal.{quantity}.scale or range.{quantity}"
    where = where if unit.name == "count" else "the logger's scale"
    words = {n: f"1/{n} of" for n in FULL_SCALES} | {1 / n: f"{n} times" for n in FULL_SCALES}
    return [
        (factor, f"the sensor's full scale was {text} the one that {where} is for")
        for factor, text in words.items()
    ]


def _nearest(value, factors, share):
    """Return the words on the factor that a value lies at; None if at none."""
    fits = [(abs(log(value / factor)), text) for factor, text in factors]
    away, text = min(fits, default=(np.inf, None))
    return text if away <= log(1 + share) else None


def _mean_force(figures, gravity):
    """Return the specific force's low, middle and high, if it is plausible, and a line on it."""
    if rests := figures["faults"]["rests"]:
        where, force = "specific force at rest", rests["force"]
        limits = (1 - PLAUSIBLE_FORCE, 1 + PLAUSIBLE_FORCE)
    else:
        where, force = "mean specific force", 3 * [figures["mean_specific_force"]]
        limits = PLAUSIBLE_MOVING
    plausible = not np.isfinite(force[1]) or limits[0] <= force[1] / gravity <= limits[1]
    return force, plausible, f"the {where} is {force[1]:.4g} m/s^2, gravity {gravity:.4g}"


def _in_attitudes(rests, low, high):
    """Tell whether one force is held in many attitudes, as gravity's is."""
    return rests and rests["attitudes"] >= LEAST_ATTITUDES and high < low * (1 + NEAR_FORCE)


def _increments(figures, units, gravity, value, sure, turns):
    """Return why a log holds increments that are taken as rates, or None.

    Both sensors are then off by its step. Where the turns say nothing, one force in many attitudes
    is gravity, or noise that is off too shows it. Wrong units may look the same, as mm/s and mrad
    over 1 ms: they come first.
    """
    rests, rate = figures["faults"]["rests"], figures["rate_hz"]
    (low, force, high), plausible, line = _mean_force(figures, gravity)
    if plausible or not force > 0:
        return None
    seen = [("acceleration", force / gravity, NEAR_FORCE if rests else NEAR_MOVING)]
    if sure and sure <= MOVING_ERROR:
        seen.append(("angular_rate", value, sure))
        line, off = f"{line}, and {turns}", "both sensors are off by"
    elif _in_attitudes(rests, low, high):
        line, off = f"{line}, in {rests['attitudes']} attitudes", "gravity is off by"
    elif 0 < (noise := _noise_of_rate(rests)) < LEAST_NOISE:
        seen = [("acceleration", force / gravity, NEAR_ALONE)]
        line = f"{line}, and the angular rate has noise of {noise:.2g} rad/s/√Hz"
        off = "gravity is off by"
    else:
        return None
    declare = [_nearest(f, _summed_factors(q, units[q], rate), share) for q, f, share in seen]
    others = [_nearest(f, _known_factors(q, units[q]), share) for q, f, share in seen]
    if not all(declare) or all(others):
        return None
    see = "" if len(seen) > 1 else "; see units.angular_rate too"
    return (
        f"{line}: {off} the step of {1 / rate:.4g} s, so the log looks like increments of velocity "
        f"and angle per sample; declare {' and '.join(declare)}{see}"
    )


def _noise_of_rate(rests):
    """Return the noise of the angular rate at rest, rad/s/√Hz, 0 where it is not known."""
    share = rests and rests["change_share"]
    # of the difference of two means, of three axes
    return rests["change"] * sqrt(WINDOW / share / 6) if share else 0.0


def _force(figures, unit, gravity, scales, reasons, warnings):
    """Say what is wrong with a specific force at rest that is not gravity."""
    found, rests = figures["faults"], figures["faults"]["rests"]
    if rests and rests["gap_turn"] > MOST_TILT:
        warnings.append(
            f"gravity turns by {np.degrees(rests['gap_turn']):.0f}° within the gap at "
            f"{rests['gap_s']:.6g} s: the device was turned while nothing was logged, and this "
            "turn is left out"
        )
    if rests and rests["jump_m_s2"] > MOST_JUMP * gravity and _live(figures):
        # of two levels the middle one says nothing
        warnings.append(
            f"at {rests['jump_s']:.6g} s the specific force at rest changes by "
            f"{rests['jump_m_s2']:.3g} m/s^2 and the gyroscope shows no turn; scale or bias "
            "changed amid the log, or logs were joined: crop it with time_range"
        )
        return
    (low, force, high), plausible, line = _mean_force(figures, gravity)
    if plausible:
        return
    cause = force > 0 and _nearest(
        force / gravity, _known_factors("acceleration", unit), NEAR_FORCE
    )
    # an axis that is dead, stuck or clipped takes its part of gravity away
    whole = not figures["constant"] and not any(
        found["stuck"][name]["stretches"] or found["clipped_at"][name]["rows"]
        for name in found["stuck"]
    )
    if not cause and force > 0 and rests and whole and high < 1.5 * low:
        cause = _nearest(force / gravity, _full_scales("acceleration", unit), NEAR_FORCE)
    see = "see units.acceleration and nominal.acceleration"
    if cause:
        reasons.append(f"{line}: {cause}")
    elif unit.name in ("m/s^2", "g") and _whole(figures, unit):
        declare = "units.acceleration: count" + ("" if scales else ", and nominal.acceleration")
        reasons.append(
            f"{line}: taken as {unit.name}, whole numbers that look like counts; declare "
            f"{declare}; see units.angular_rate too"
        )
    elif _in_attitudes(rests, low, high):
        share = f"{force / gravity:.2g} times its size"
        warnings.append(
            f"{line}: gravity is in it, in {rests['attitudes']} attitudes, {share}: {see}"
        )
    elif force < 0.3 * gravity:
        summed = _summed_factors("acceleration", unit, figures["rate_hz"])
        declare = rests and _nearest(force / gravity, summed, NEAR_FORCE)
        step = f", or is it increments per sample ({declare})" if declare else ""
        warnings.append(
            f"{line}: has gravity been taken out of the log{step}? If not, see units.acceleration"
        )
    else:
        warnings.append(f"{line}: {see}")


def _whole(figures, unit):
    """Tell whether the acceleration was logged in whole numbers."""
    steps = [figures["quantisation_step"][name] for name in ACCELERATION]
    return all(step and abs(step / unit.scale - 1) < 1e-6 for step in steps)


def _live(figures):
    """Tell whether the gyroscope shows turns at all: not stuck, padded or a copy."""
    found = figures["faults"]
    dead = [n for n in ANGULAR_RATE if found["stuck"][n]["stretches"] or n in figures["constant"]]
    return not (found["zero_rows"]["angular_rate"] or found["copies"] or dead)


def _turn_ratio(figures, gravity):
    """Return how far the rate turns the device beside gravity, how sure that is, and the words."""
    axes, rests = figures["faults"]["axes"], figures["faults"]["rests"]
    ratio, line = rests and rests["turn_ratio"], "the angular rate turns the device"
    # a jump of the force is no turn
    if not _live(figures) or (rests and rests["jump_m_s2"] > MOST_JUMP * gravity):
        return None, None, ""
    far = "times as far as gravity turns in its axes"
    if ratio:
        value, std = ratio["value"], ratio["std"]
        over = f"over {ratio['moves']} moves from rest to rest"
        sure = max(NEAR_TURN, SIGMAS * std / value)
        return value, sure, f"{line} {value:.3g} ± {std:.1g} {far}, {over}"
    if axes and axes["ratio"]:
        fits = axes["best"] > AGREEMENT and axes["steps_used"] >= LEAST_TURNS
        return axes["ratio"], MOVING_ERROR if fits else None, f"{line} {axes['ratio']:.3g} {far}"
    return None, None, ""


def _turns(figures, unit, kind, value, sure, line, reasons, warnings):
    """Say what is wrong with an angular rate that does not turn the device as gravity says."""
    off = "; or the log's rate is off by as much"
    # what the end of the range cuts off looks like a scale
    clipped = figures["faults"]["clipped_at"]
    cut = any(clipped[n]["rows"] or figures["clipped"][n] for n in ANGULAR_RATE)
    if value and sure and sure <= MOVING_ERROR:
        cause = _nearest(value, _known_factors("angular_rate", unit), sure)
        if not (cause or cut):
            cause = _nearest(value, _full_scales("angular_rate", unit), sure)
        if cause:
            reasons.append(f"{line}: {cause}{off}")
            return
    mean, most = figures["mean_angular_rate"], PLAUSIBLE_MEAN_RATE
    if mean > (PLAUSIBLE_REST if kind == "static" else most):
        degrees = "is it deg/s? " if unit.name == "rad/s" and mean * DEGREE < most else ""
        warnings.append(
            f"the mean angular rate is {mean:.4g} rad/s, too much for a "
            f"{'turn by hand' if mean > most else 'bias'}: {degrees}see units.angular_rate"
        )
    elif value and sure and not cut and abs(log(value)) > max(log(1 + PLAUSIBLE_TURN_RATIO), sure):
        see = "see units.angular_rate and nominal.angular_rate"
        warnings.append(f"{line}: its scale is off by as much; {see}{off}")


def _moved(rests, gravity, reasons, warnings):
    """Say how a static session moves."""
    declare = "a static session lies still: declare another kind, or crop it with time_range"
    turned, share, change = rests["turned"], rests["share"], rests["change"]
    # a step of the force without a turn is of the sensor
    if turned > MOST_TILT and rests["jump_m_s2"] < 0.5 * turned * gravity:
        reasons.append(
            f"gravity turns by up to {np.degrees(turned):.0f}° in the axes of the device, which "
            f"rests for {share:.0%} of the time, in {rests['attitudes']} attitudes; {declare}"
        )
    elif share < LEAST_REST and change > MOST_CHANGE:
        reasons.append(f"the device rests for {share:.0%} of the time only; {declare}")
    elif share < LEAST_REST:
        warnings.append(
            f"only {share:.0%} of the time is nearly as quiet as the quietest parts, and nothing "
            "turns: noise or vibration changes much within the session"
        )
    elif change > MOST_CHANGE and (rests["change_share"] or 0.0) > MOST_CHANGE_SHARE:
        reasons.append(
            f"the mean angular rate of half a second changes by {np.degrees(change):.2g} "
            f"deg/s to the next, {rests['change_share']:.2g} times the power of its noise: the "
            f"device turns to and fro, as in flight; {declare}"
        )
