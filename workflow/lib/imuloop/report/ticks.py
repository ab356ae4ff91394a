"""Where the marks of an axis stand, and what they say."""

import math

from imuloop.report.numbers import superscript

# powers of ten that are written out
PLAIN = range(-2, 4)


def linear_ticks(low, high, count):
    """Return places and labels of round numbers between two limits, and their common factor.

    Parameters
    ----------
    low, high : float
        Limits of the axis.
    count : float
        About how many marks there is room for.

    Returns
    -------
    places : list of float
        Multiples of 1, 2 or 5 times a power of ten.
    labels : list of str
        What stands at them.
    factor : str
        What the labels have to be multiplied with, as text; empty for 1.
    """
    least = (high - low) / count
    power = 10.0 ** math.floor(math.log10(least))
    steps = [m * power for m in (1, 2, 5, 10)]
    step = next(s for s in steps if s >= least * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    if last <= first:
        # one mark tells no scale
        return linear_ticks(low, high, 2 * count)
    places = [k * step for k in range(first, last + 1)]
    largest = max(map(abs, places), default=0.0)
    exponent = math.floor(math.log10(largest) + 1e-9) if largest else 0
    exponent = 0 if -4 < exponent < 5 else exponent
    digits = max(0, exponent - math.floor(math.log10(step) + 1e-9))
    labels = [f"{p / 10.0**exponent + 0.0:.{digits}f}".replace("-", "−") for p in places]
    return places, labels, f"×10{superscript(exponent)}" if exponent else ""


def decade_ticks(low, high, count):
    """Return places and labels of powers of ten, and of 2 and 5 times them where they are few.

    Parameters
    ----------
    low, high : float
        Limits of the axis, above 0.
    count : float
        About how many marks there is room for.

    Returns
    -------
    places : list of float
    labels : list of str
    """
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    stride = max(1, math.ceil((last - first) / count))
    digits = (1, 2, 5) if high < 100 * low else (1,)
    marks = [
        (digit, exponent)
        for exponent in range(first, last + 1)
        for digit in digits
        if exponent % stride == 0 and low <= digit * 10.0**exponent * (1 + 1e-9)
        if digit * 10.0**exponent <= high * (1 + 1e-9)
    ]
    plain = all(exponent in PLAIN for _, exponent in marks)
    labels = [
        f"{digit * 10.0**exponent:.{max(-exponent, 0)}f}"
        if plain
        else f"{digit}·" * (digit > 1) + f"10{superscript(exponent)}"
        for digit, exponent in marks
    ]
    return [digit * 10.0**exponent for digit, exponent in marks], labels
