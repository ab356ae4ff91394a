"""Numbers and words as text of an exported file: the filters of its templates."""

import re

import numpy as np

from imuloop.core.errors import one_line

FILTERS = ("braces", "float32", "identifier", "in_c", "rows")


def number(value):
    """Return the shortest text of a number that reads back as the same float64.

    `value` is the number. Its mantissa has a point, because YAML 1.1 takes ``1e-05`` for a word.
    """
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}.0{e}{exponent}" if e and "." not in mantissa else text


def numbers(values, separator=", "):
    """Return the numbers of the array `values`, row by row, as one line of text.

    There is a `separator` between the numbers.
    """
    return separator.join(map(number, np.ravel(values)))


def written(value):
    """Return the text of any `value` in a template: one line, and floats without rounding."""
    if isinstance(value, str):
        return one_line(value)
    return str(value) if isinstance(value, int) else numbers(value)


def float32(value):
    """Return a text of the number `value` that reads back as the same float32."""
    return f"{np.float32(value):.9g}"


def rows(matrix):
    """Return the inside of a MATLAB literal of the array `matrix`: rows with semicolons between.

    The brackets around the literal are left out.
    """
    return "; ".join(numbers(row, " ") for row in np.atleast_2d(matrix))


def braces(values):
    """Return the array `values`, (n,) or (n, m), as a C initialiser in braces, nested for rows."""
    inside = map(braces, values) if np.ndim(values) > 1 else map(number, values)
    return f"{{{', '.join(inside)}}}"


def in_c(text):
    """Return `text` for the inside of a C comment, without marks that end or open a comment."""
    return re.sub(r"\*(?=/)|/(?=\*)", r"\g<0> ", one_line(text))


def identifier(text):
    """Return `text` changed to a name that C and MATLAB accept as an identifier."""
    return re.sub(r"\W", "_", text, flags=re.ASCII)
