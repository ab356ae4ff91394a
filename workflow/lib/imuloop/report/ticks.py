"""Where the marks of an axis stand, and what they say."""

import math

from matplotlib.ticker import LogLocator, MaxNLocator

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
    locator = MaxNLocator(max(int(count), 1), steps=(1, 2, 5, 10), min_n_ticks=2)
    found = locator.tick_values(low, high)
    slack = 1e-9 * (high - low)
    places = [p for p in found.tolist() if low - slack <= p <= high + slack]
    step = found[1] - found[0]
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
    digits = (1, 2, 5) if high < 100 * low else (1,)
    found = LogLocator(subs=digits, numticks=max(int(count), 2)).tick_values(low, high)
    places = [p for p in found.tolist() if low * (1 - 1e-9) <= p <= high * (1 + 1e-9)]
    exponents = [math.floor(math.log10(p) + 1e-9) for p in places]
    marks = [(round(p / 10.0**e), e) for p, e in zip(places, exponents, strict=True)]
    plain = all(exponent in PLAIN for _, exponent in marks)
    labels = [
        f"{digit * 10.0**exponent:.{max(-exponent, 0)}f}"
        if plain
        else f"{digit}·" * (digit > 1) + f"10{superscript(exponent)}"
        for digit, exponent in marks
    ]
    return [digit * 10.0**exponent for digit, exponent in marks], labels
