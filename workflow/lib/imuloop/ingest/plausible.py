"""Tests of whether a log fits its declared units and full scales, by gravity.

Gravity checks both sensors without a calibration: its size is the specific force at rest, and its
direction turns in the axes of the device as the gyroscope shows. So each sensor has a `Ratio` of
its reading to gravity, which is 1 in a good log. No real sensor is off by a half. A ratio that
differs from 1 is compared with the factors of all other `readings` of the log: another unit,
another full scale, and increments of velocity and angle. The nearest factor within the error of the
ratio is the cause.
"""

from dataclasses import dataclass
from math import inf

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import FACTORS, INCREMENTS
from imuloop.core.units import TIME as TIME_UNITS
from imuloop.ingest.rests import measure_turns

# the specific force is plausible if it is gravity within the first factor at rest, and within the
# second factor as the mean of a log without rests
AT_REST, MOVING = 1.25, 2.0
# relative error of a ratio by a bias of a tenth of g or a scale error; the largest error of a ratio
# that is used, which turns inside moves have; these are used if the axes of both sensors agree by
# more than the third number, as accelerations by the hand lower the agreement
NEAR, MOST_ERROR, AGREEMENT = 0.1, 0.15, 0.9
# full scales of a sensor differ by powers of two
FULL_SCALES = (2, 4, 8, 16, 1 / 2, 1 / 4, 1 / 8, 1 / 16)
# the specific force jumps if a step without a turn exceeds this share of gravity
MOST_JUMP = 0.05
# rate of the fastest usual log, and least usual rate with stamps in whole seconds, Hz
MOST_RATE, LEAST_RATE = 1e4, 0.7


@dataclass(frozen=True)
class Ratio:
    """The ratio of a sensor's reading to gravity.

    The ratio of the reading to gravity has a `value`, a relative `error`, and `words`. It is the
    specific force over gravity's magnitude, or the turns by the angular rate over the turns of
    gravity's direction. The sensor is off if the value differs from 1 by more than the factor
    `most`. `is_cut` tells that a part of the signal is missing, which looks like another range.
    """

    value: float
    error: float
    most: float
    words: str
    is_cut: bool

    @property
    def is_off(self):
        """Whether the ratio differs from 1."""
        return np.isfinite(self.value) and not 1 / self.most <= self.value <= self.most

    def nearest(self, known, error=None):
        """Return the words of the nearest reading if it is within the relative error, else None.

        `known` are readings, a list of (factor, words). `error` replaces the error of the ratio.
        """
        distances = [(abs(np.log(self.value / factor)), words) for factor, words in known]
        distance, words = min(distances, default=(inf, None))
        return words if distance <= np.log(1 + (error or self.error)) else None


def readings(e, quantity, kind):
    """Return the factors by which wrong readings of a log are off, a list of (factor, words).

    `e` is the `checks.Evidence` on the log. A wrong reading takes the `quantity` in another unit,
    at another full scale, or as increments: `kind` is "unit", "full scale" or "increments".
    """
    unit, nominal = e.units[quantity], f"nominal.{quantity}.scale"
    counts = unit.name == "count"
    scale = 1 if counts else unit.scale
    if kind == "unit":
        words = f"taken as {unit.name}, it looks like {{}}; see units.{quantity}"
        words = f"{nominal} is in SI per count, and looks like {{}}" if counts else words
        known = FACTORS[quantity].items()
        return [(scale / si, words.format(name)) for name, si in known if si != scale]
    if kind == "full scale":
        other = f"the one that {f'{nominal} or range.{quantity}' if counts else 'the logger'} has"
        return [(n, f"the sensor's full scale was {1 / n:g} times {other}") for n in FULL_SCALES]
    words = f"{nominal}: {{1:.6g}}" if counts else f"units.{quantity}: {{0}}"
    steps = {name: si * e.figures["rate_hz"] for name, si in INCREMENTS[quantity].items()}
    return [(scale / n, words.format(name, unit.scale * n)) for name, n in steps.items()]


def ratio_of(e, quantity):
    """Return the Ratio of a sensor by the `Evidence` on a log, or None if the log shows none."""
    return force_ratio(e) if quantity == "acceleration" else turn_ratio(e.figures)


def force_ratio(e):
    """Return the Ratio of the specific force to gravity, at rest if the `Evidence` has rests."""
    rests, faults = e.faults["rests"], e.faults
    force, where, most = e.figures["mean_specific_force"], "mean specific force", MOVING
    cut = bool(e.figures["constant"]) or not rests
    if rests:
        (low, force, high), where, most = rests["force"], "specific force at rest", AT_REST
        # an axis that is dead, stuck or clipped lacks a part of gravity
        stuck, clipped = faults["stuck"], faults["clipped_at"]
        cut = cut or any(stuck[n]["stretches"] or clipped[n]["rows"] for n in stuck)
        cut = cut or high >= 1.5 * low
    words = f"the {where} is {force:.4g} m/s^2, gravity {e.gravity:.4g}"
    return Ratio(force / e.gravity, NEAR, most, words, cut)


def turn_ratio(figures):
    """Return the Ratio of turns by the gyroscope to turns of gravity.

    `figures` are the quality figures. The result is None if the log shows no turns.
    """
    axes, rests, clipped = (figures["faults"][key] for key in ("axes", "rests", "clipped_at"))
    words = "the angular rate turns the device {:.3g} times as far as gravity turns in its axes"
    # a step of the force looks like a turn
    if not is_live(figures) or _jumps(rests):
        return None
    if turns := rests and rests["turn_ratio"]:
        value, words = turns["value"], f"{words}, over {turns['moves']} moves from rest to rest"
        # three standard errors, with a least error
        error = max(NEAR / 2, 3 * turns["std"] / value)
    elif axes and axes["ratio"] and axes["best"] > AGREEMENT:
        value, error = axes["ratio"], MOST_ERROR
    else:
        return None
    cut = any(clipped[n]["rows"] or figures["clipped"][n] for n in ANGULAR_RATE)
    return Ratio(value, error, 1 + max(NEAR, error), words.format(value), cut)


def is_live(figures):
    """Return whether the gyroscope shows turns: no axis is stuck, constant, zero or a copy."""
    faults, constant = figures["faults"], figures["constant"]
    dead = [n for n in ANGULAR_RATE if faults["stuck"][n]["stretches"] or n in constant]
    return not (faults["zero_rows"]["angular_rate"] or faults["copies"] or dead)


def _jumps(rests):
    """Return whether the specific force has a step between rests without a turn."""
    return rests and rests["jump_m_s2"] > MOST_JUMP * rests["force"][1]


def jump_of_force(e):
    """Return the figures of rests if the specific force has a step without a turn, else false."""
    return _jumps(e.faults["rests"]) and is_live(e.figures) and e.faults["rests"]


def increments(e):
    """Return values for a message if both sensors look like increments, taken as rates, else None.

    Wrong units may look the same, as mm/s and mrad over 1 ms do: then the units are the cause.
    """
    ratios = {quantity: ratio_of(e, quantity) for quantity in FACTORS}
    force, turns = ratios.values()
    if not (force.is_off and turns and turns.error <= MOST_ERROR):
        return None
    # the mean force of a log without rests is gravity only within a factor
    errors = {"acceleration": NEAR if e.faults["rests"] else 0.5, "angular_rate": turns.error}
    found, units = (
        [ratio.nearest(readings(e, q, kind), errors[q]) for q, ratio in ratios.items()]
        for kind in ("increments", "unit")
    )
    if not all(found) or all(units):
        return None
    words = f"{force.words}, and {turns.words}: both sensors are off by"
    return {"words": words, "step": 1 / e.figures["rate_hz"], "unit": " and ".join(found)}


def cause(e, quantity):
    """Return words on the unit, full scale or counts that explain a sensor that is off, or None."""
    ratio, unit = ratio_of(e, quantity), e.units[quantity]
    if not (ratio and ratio.is_off and ratio.error <= MOST_ERROR):
        return None
    known = [] if ratio.is_cut else readings(e, quantity, "full scale")
    found = ratio.nearest(readings(e, quantity, "unit") + known)
    steps = [(e.figures["quantisation_step"][name] or 0) / unit.scale for name in ACCELERATION]
    if not found and unit.name in ("m/s^2", "g") and np.allclose(steps, 1, 1e-6):
        scale = "" if (e.nominal or {}).get(quantity) else f", and nominal.{quantity}.scale"
        found = f"taken as {unit.name}, whole numbers that look like counts; declare units."
        found += f"{quantity}: count{scale}; see units.angular_rate too"
    return found and f"{ratio.words}: {found}"


def size_of_force(e):
    """Return words on a specific force that is off, to be followed by the remedy, or false."""
    ratio = force_ratio(e)
    # another full scale would leave a larger force
    why = ": has gravity been removed from the log, or does it hold increments per sample? If not, "
    return ratio.is_off and ratio.words + (why if ratio.value < 0.3 else "; ")


def scale_of_rate(e):
    """Return words on an angular rate that is off, or a false value."""
    ratio = turn_ratio(e.figures)
    off = ratio and ratio.is_off and not ratio.is_cut
    return off and f"{ratio.words}: its scale is off by as much"


def milliseconds(columns, figures, stamps, rate=None):
    """Return the reason why time stamps, taken as seconds, are milliseconds, None if they are not.

    Parameters
    ----------
    columns, figures : dict
        Columns of the samples by name, with times in seconds, and their quality figures.
    stamps : array_like, shape (n,)
        Time stamps, s.
    rate : float, optional
        Declared rate, Hz.
    """
    factor, in_seconds, why = 1 / TIME_UNITS["ms"], figures["rate_hz"], None
    if not figures["faults"] or in_seconds * factor > MOST_RATE:
        return None
    axes, rests = measure_turns(columns, in_seconds * factor, columns["t"])
    faults = figures["faults"] | {"axes": axes, "rests": rests}
    ratio = turn_ratio(figures | {"faults": faults})
    if rate:
        if rate > in_seconds * factor / 2:
            why = f"the declared rate is {rate / in_seconds:,.0f} times the rate in seconds"
    # in ms the ratio is 1 in a good log, and 57 if the rate is in deg/s, taken as rad/s
    elif ratio and 0.2 < ratio.value < 100:
        times = float(f"{ratio.value * factor:.2g}")
        why = f"turns measured by the gyroscope are {times:,.0f} times those of gravity"
    elif in_seconds < LEAST_RATE and np.allclose(stamps, np.rint(stamps), 0, 1e-6):
        why = f"they are whole, and {in_seconds:.3g} Hz is unusual for an IMU"
    remedy = "declare units.time: ms, or s if they are"
    return why and f"the stamps look like milliseconds: {why}; {remedy}"
