"""Numbers as text for people: significant digits, value ± σ, a size with its unit."""

import math

from imuloop.core.units import HOUR

# text in place of a missing number
NO_NUMBER = "—"


def missing(value):
    """Return whether a value, a number or None, is None or not finite."""
    return value is None or not math.isfinite(value)


def _exponent(value):
    """Return the decimal exponent of a number, `value`: 3 for 2500; 0 for zero."""
    return math.floor(math.log10(abs(value))) if value else 0


def _fixed(value, decimals):
    """Return `value` as text with `decimals` decimals; −1 rounds to tens, −2 to hundreds."""
    text = f"{round(value, decimals):,.{max(decimals, 0)}f}".replace(",", "\u202f")
    if not text.strip("-0.\u202f"):
        text = text.lstrip("-")
    return text.replace("-", "−")


def typeset(unit):
    """Return the unit `unit` of the result files as it is printed: m/s^2 becomes m/s²."""
    return unit.replace("^2", "²").replace("^3", "³").replace("sqrt(s)", "√s")


def superscript(exponent):
    """Return an integer, `exponent`, as text in raised digits: ⁻³ for −3."""
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _tens(exponent):
    """Return the text of a power of ten that follows a number: " × 10³" for the `exponent` 3."""
    return f"\u202f×\u202f10{superscript(exponent)}"


def number(value, digits=3):
    """Return a number as text with `digits` significant digits.

    `value` is the number; None or a number that is not finite gives a dash.
    """
    if missing(value):
        return NO_NUMBER
    if value == 0:
        return "0"
    rounded = float(f"{value:.{digits - 1}e}")
    exponent = _exponent(rounded)
    if not -3 <= exponent < 7:
        return _fixed(rounded / 10.0**exponent, digits - 1) + _tens(exponent)
    return _fixed(rounded, digits - 1 - exponent)


def with_sigma(value, sigma, factor=1.0):
    """Return ``value ± σ`` as text: σ to two digits, the value to the same decimal place.

    `value` and its standard error `sigma`, σ, are both multiplied by `factor`, from SI to the unit
    that is shown. Without a σ the text has only the value; without a value it is a dash.
    """
    if missing(value):
        return NO_NUMBER
    value *= factor
    if missing(sigma) or sigma <= 0:
        return number(value)
    sigma = float(f"{sigma * factor:.1e}")
    exponent = _exponent(max(abs(value), sigma))
    place = 1 - _exponent(sigma)
    if -3 <= exponent < 7 and place <= 7:
        return f"{_fixed(value, place)}\u202f±\u202f{_fixed(sigma, place)}"
    scale = 10.0**exponent
    value, sigma = _fixed(value / scale, place + exponent), _fixed(sigma / scale, place + exponent)
    return f"({value}\u202f±\u202f{sigma}){_tens(exponent)}"


def with_unit(text, unit):
    """Return `text`, a number, followed by its `unit`; a thin space is between unless it is °."""
    return f"{text}{'' if unit == '°' else chr(0x202F)}{unit}"


def probability(p):
    """Return a p-value, `p`, as text to two digits, or as "< 10⁻¹⁰" if it is below 1e-10."""
    return f"<\u202f10{superscript(-10)}" if not missing(p) and p < 1e-10 else number(p, 2)


def p_text(p):
    """Return a p-value, `p`, as text with its letter: p = 0.03, p < 10⁻¹⁰."""
    text = probability(p)
    return f"p {text}" if text.startswith("<") else f"p\u202f=\u202f{text}"


def percent(share):
    """Return a share, a number from 0 to 1, in per cent as text to two digits.

    A share below 1 that rounds to 100 % gives "> 99 %". None or a number that is not finite gives a
    dash.
    """
    if missing(share):
        return NO_NUMBER
    text = number(share * 1e2, 2)
    return with_unit("> 99" if share < 1 and float(f"{share:.2g}") >= 1 else text, "%")


def duration(seconds, digits=3):
    """Return a duration, `seconds`, as text in s, min or h, with `digits` significant digits.

    The text is a dash if the duration is None or not finite.
    """
    if missing(seconds):
        return NO_NUMBER
    for unit, size in (("h", HOUR), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{number(seconds / size, digits)}\u202f{unit}"
    return f"{number(seconds, digits)}\u202fs"


def sigma_of(coefficient):
    """Return 1 σ of a noise coefficient from its 95 % interval, None if it has no interval.

    `coefficient` is a `Coefficient`; its interval is taken as ± 1.96 σ.
    """
    low, high = coefficient.ci95 or (None, None)
    return None if low is None else (high - low) / (2 * 1.959964)


def value_text(value, std, upper95=None, factor=1.0):
    """Return the text ``value ± σ``, or "< limit" if there is no value but its 95 % upper limit.

    `std` is σ and `upper95` the limit; without both value and limit the text is a dash. All numbers
    are multiplied by `factor`, from SI to the unit that is shown.
    """
    if not missing(value):
        return with_sigma(value, std, factor)
    return NO_NUMBER if missing(upper95) else f"<\u202f{number(upper95 * factor, 2)}"


def coefficient_text(coefficient, factor=1.0):
    """Return a noise coefficient as text: ``value ± σ``, or "< limit" if it has no value.

    `coefficient` is a `Coefficient`, and the limit is its 95 % upper limit. `factor` converts its
    numbers from SI to the unit that is shown.
    """
    return value_text(coefficient.value, sigma_of(coefficient), coefficient.upper95, factor)


def interval_text(interval, factor=1.0):
    """Return an interval as text, ``low to high``, with enough digits to show its width to two.

    `interval` is a pair of numbers, which are multiplied by `factor`, from SI to the unit that is
    shown. If it is None, or an end is missing, the text is a dash.
    """
    if not interval or any(map(missing, interval)):
        return NO_NUMBER
    low, high = (end * factor for end in interval)
    digits = max(2, _exponent(high) - _exponent(high - low) + 2)
    return f"{number(low, digits)} to {number(high, digits)}"


def text_of(value):
    """Return a value of a result file as a short text; `value` may be of any type of JSON."""
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
