"""Numbers as a person reads them: sensible digits, value ± σ, units of data sheets."""

import math
from dataclasses import dataclass

from imuloop.core.units import DEGREE, HOUR, STANDARD_GRAVITY

# what stands where there is no number
NO_NUMBER = "—"


@dataclass(frozen=True)
class Display:
    """A unit as printed, and how many of it an SI unit is: ``shown = SI * factor``."""

    unit: str
    factor: float


MILLI_G = Display("mg", 1e3 / STANDARD_GRAVITY)
DEGREE_PER_SECOND = Display("°/s", 1 / DEGREE)
DEGREES = Display("°", 1 / DEGREE)
PERCENT = Display("%", 1e2)
MILLIRADIAN = Display("mrad", 1e3)

# the unit that people think in, for each SI unit of a residual
RESIDUAL = {"m/s^2": MILLI_G, "rad/s": DEGREE_PER_SECOND, "rad": DEGREES}

# units of the noise coefficients: SI, then those of data sheets, the usual one first
_MICRO_G = 1e6 / STANDARD_GRAVITY
_DEGREE_PER_HOUR = HOUR / DEGREE
NOISE_UNITS = {
    "accelerometer": {
        "Q": (Display("m/s", 1.0), Display("mm/s", 1e3)),
        "N": (
            Display("m/s²/√Hz", 1.0),
            Display("µg/√Hz", _MICRO_G),
            Display("m/s/√h", HOUR**0.5),
        ),
        "B": (Display("m/s²", 1.0), Display("µg", _MICRO_G)),
        "K": (Display("m/s³/√Hz", 1.0), Display("µg/√s", _MICRO_G)),
        "R": (Display("m/s³", 1.0), Display("µg/h", _MICRO_G * HOUR)),
    },
    "gyroscope": {
        "Q": (Display("rad", 1.0), Display("arcsec", HOUR / DEGREE)),
        "N": (
            Display("rad/s/√Hz", 1.0),
            Display("°/√h", HOUR**0.5 / DEGREE),
            Display("°/s/√Hz", 1 / DEGREE),
        ),
        "B": (Display("rad/s", 1.0), Display("°/h", _DEGREE_PER_HOUR)),
        "K": (Display("rad/s²/√Hz", 1.0), Display("°/h/√h", _DEGREE_PER_HOUR * HOUR**0.5)),
        "R": (Display("rad/s²", 1.0), Display("°/h/h", _DEGREE_PER_HOUR * HOUR)),
    },
}


def missing(value):
    """Return whether there is no finite number."""
    return value is None or not math.isfinite(value)


def _exponent(value):
    """Return the decimal exponent of a number, 0 for zero."""
    return math.floor(math.log10(abs(value))) if value else 0


def _fixed(value, decimals):
    """Return a number with that many decimals (fewer than 0: rounded to tens, …)."""
    text = f"{round(value, decimals):,.{max(decimals, 0)}f}".replace(",", "\u202f")
    if not text.strip("-0.\u202f"):
        text = text.lstrip("-")
    return text.replace("-", "−")


def typeset(unit):
    """Return a unit of the files as it is printed: m/s^2 as m/s²."""
    return unit.replace("^2", "²").replace("^3", "³").replace("sqrt(s)", "√s")


def superscript(exponent):
    """Return an integer in raised digits."""
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _tens(exponent):
    return f"\u202f×\u202f10{superscript(exponent)}"


def number(value, digits=3):
    """Return a number with that many significant digits."""
    if missing(value):
        return NO_NUMBER
    if value == 0:
        return "0"
    rounded = float(f"{value:.{digits - 1}e}")
    exponent = _exponent(rounded)
    if not -3 <= exponent < 7:
        return _fixed(rounded / 10.0**exponent, digits - 1) + _tens(exponent)
    return _fixed(rounded, digits - 1 - exponent)


def with_sigma(value, sigma):
    """Return ``value ± σ``: σ to two digits, the value to the same place; the value without a σ."""
    if missing(value):
        return NO_NUMBER
    if missing(sigma) or sigma <= 0:
        return number(value)
    sigma = float(f"{sigma:.1e}")
    exponent = _exponent(max(abs(value), sigma))
    place = 1 - _exponent(sigma)
    if -3 <= exponent < 7 and place <= 7:
        return f"{_fixed(value, place)}\u202f±\u202f{_fixed(sigma, place)}"
    scale = 10.0**exponent
    value, sigma = _fixed(value / scale, place + exponent), _fixed(sigma / scale, place + exponent)
    return f"({value}\u202f±\u202f{sigma}){_tens(exponent)}"


def with_unit(text, unit):
    """Return a number with its unit; a degree sign stands close to it."""
    return f"{text}{'' if unit == '°' else chr(0x202F)}{unit}"


def probability(p):
    """Return a p-value; below 1e-10 its size means nothing."""
    return f"<\u202f10{superscript(-10)}" if not missing(p) and p < 1e-10 else number(p, 2)


def p_text(p):
    """Return a p-value with its letter: p = 0.03, p < 10⁻¹⁰."""
    text = probability(p)
    return f"p {text}" if text.startswith("<") else f"p\u202f=\u202f{text}"


def percent(share):
    """Return a share as per cent; one that is almost whole is not rounded to 100."""
    if missing(share):
        return NO_NUMBER
    text = number(share * 1e2, 2)
    return with_unit("> 99" if share < 1 and float(f"{share:.2g}") >= 1 else text, "%")


def duration(seconds, digits=3):
    """Return a duration in s, min or h."""
    if missing(seconds):
        return NO_NUMBER
    for unit, size in (("h", HOUR), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{number(seconds / size, digits)}\u202f{unit}"
    return f"{number(seconds, digits)}\u202fs"


def sigma_of(coefficient):
    """Return 1 σ of a noise coefficient from its 95 % interval."""
    low, high = coefficient.get("ci95") or (None, None)
    return None if missing(low) or missing(high) else (high - low) / (2 * 1.959964)


def coefficient_text(coefficient, factor=1.0):
    """Return a noise coefficient as ``value ± σ``, or its 95 % upper limit without one."""
    if not coefficient:
        return NO_NUMBER
    value, upper = coefficient.get("value"), coefficient.get("upper95")
    if coefficient.get("identifiable") and not missing(value):
        sigma = sigma_of(coefficient)
        return with_sigma(value * factor, None if sigma is None else sigma * factor)
    return NO_NUMBER if missing(upper) else f"<\u202f{number(upper * factor, 2)}"


def interval_text(interval, factor=1.0):
    """Return an interval as ``low to high``, its width to two digits."""
    if not interval or any(missing(end) for end in interval):
        return NO_NUMBER
    low, high = (end * factor for end in interval)
    digits = max(2, _exponent(high) - _exponent(high - low) + 2)
    return f"{number(low, digits)} to {number(high, digits)}"


def joined(words):
    """Return words as a list in a sentence: a, b and c."""
    *first, last = words or [""]
    return f"{', '.join(first)} and {last}" if first else last


def plural(count, noun, ending="s"):
    """Return a count with its noun."""
    return f"{count} {noun}{'' if count == 1 else ending}"


def text_of(value):
    """Return a figure of a result file in a few words, whatever its form."""
    if value is None:
        return NO_NUMBER
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return number(value) if isinstance(value, float) else f"{value:,}".replace(",", "\u202f")
    if isinstance(value, dict):
        kept = {k: v for k, v in value.items() if v not in (0, None, [], {})}
        return ", ".join(f"{k} {text_of(v)}" for k, v in kept.items()) or "0"
    if isinstance(value, (list, tuple)):
        return ", ".join(text_of(v) for v in value) or "none"
    return str(value)
