"""Where the marks of an axis stand, and what they say."""

import math

from imuloop.report.numbers import superscript

# powers of ten that are written out
PLAIN = range(-2, 4)
# what rounding may take from a place, a share of the axis
SLACK = 1e-9


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
    rough = (high - low) / max(int(count), 1)
    decade = math.floor(math.log10(rough))
    steps = [d * 10.0**e for e in (decade - 1, decade) for d in (1, 2, 5)] + [10.0 ** (decade + 1)]
    # the smallest that is wide enough, or the next below that has two marks
    wide = [s for s in steps if s >= rough]
    narrow = [s for s in steps if s < rough]
    for step in [wide[0], *narrow[::-1]]:
        places = [k * step for k in _between(low / step, high / step)]
        if len(places) > 1:
            break
    largest = max(map(abs, places), default=0.0)
    exponent = math.floor(math.log10(largest) + SLACK) if largest else 0
    exponent = 0 if -4 < exponent < 5 else exponent
    digits = max(0, exponent - math.floor(math.log10(step) + SLACK))
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
    factor : str
        As for `linear_ticks`, whose round numbers are taken where those above are fewer than two.
    """
    ends = math.log10(low), math.log10(high)
    if high < 100 * low:
        marks = [
            (digit, exponent)
            for exponent in range(math.floor(ends[0]), math.floor(ends[1] + SLACK) + 1)
            for digit in (1, 2, 5)
            if low * (1 - SLACK) <= digit * 10.0**exponent <= high * (1 + SLACK)
        ]
    else:
        decades = _between(*ends)
        stride = -(-len(decades) // max(int(count), 2))
        marks = [(1, exponent) for exponent in decades[::stride]]
    if len(marks) < 2:
        return linear_ticks(low, high, count)
    plain = all(exponent in PLAIN for _, exponent in marks)
    labels = [
        f"{digit * 10.0**exponent:.{max(-exponent, 0)}f}"
        if plain
        else f"{digit}·" * (digit > 1) + f"10{superscript(exponent)}"
        for digit, exponent in marks
    ]
    return [digit * 10.0**exponent for digit, exponent in marks], labels, ""


def _between(low, high):
    """Return the whole numbers between two limits, both included."""
    slack = SLACK * (high - low)
    return range(math.ceil(low - slack), math.floor(high + slack) + 1)
