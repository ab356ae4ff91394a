"""Where the marks of an axis stand, as matplotlib places them, and what they say."""

import math

from matplotlib.ticker import LogLocator, MaxNLocator, ScalarFormatter

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
    locator = MaxNLocator(max(int(count), 1), steps=(1, 2, 5, 10), min_n_ticks=2)
    slack = SLACK * (high - low)
    found = locator.tick_values(low, high).tolist()
    places = [p for p in found if low - slack <= p <= high + slack]
    formatter = ScalarFormatter(useOffset=False, useMathText=False, useLocale=False)
    formatter.set_powerlimits((-4, 5))
    formatter.create_dummy_axis()
    formatter.axis.set_view_interval(low, high)
    labels = [label.replace("-", "−") for label in formatter.format_ticks(places)]
    # 1e−6, or nothing
    exponent = formatter.get_offset().replace("−", "-").partition("e")[2]
    return places, labels, exponent and f"×10{superscript(int(exponent))}"


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
    digits = (1, 2, 5) if high < 100 * low else (1,)
    found = LogLocator(subs=digits, numticks=max(int(count), 2)).tick_values(low, high).tolist()
    places = [p for p in found if low * (1 - SLACK) <= p <= high * (1 + SLACK)]
    marks = [tuple(map(int, f"{p:.0e}".split("e"))) for p in places]
    # of a short axis the locator gives numbers in between, more than there is room for
    between = any(
        digit not in digits or not math.isclose(p, digit * 10.0**exponent)
        for p, (digit, exponent) in zip(places, marks, strict=True)
    )
    if len(marks) < 2 or between:
        return linear_ticks(low, high, count)
    plain = all(exponent in PLAIN for _, exponent in marks)
    labels = [
        f"{digit * 10.0**exponent:.{max(-exponent, 0)}f}"
        if plain
        else f"{digit}·" * (digit > 1) + f"10{superscript(exponent)}"
        for digit, exponent in marks
    ]
    return places, labels, ""
