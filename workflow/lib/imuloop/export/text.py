"""Numbers and words as text of a file."""

import re

import numpy as np

from imuloop.core.errors import one_line

FILTERS = ("braces", "float32", "identifier", "in_c", "rows")


def number(value):
    """Return the shortest text that reads back as the same float64.

    With a point in the mantissa: YAML 1.1 takes ``1e-05`` for a word.
    """
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}.0{e}{exponent}" if e and "." not in mantissa else text


def numbers(values, separator=", "):
    """Return an array's numbers row by row in one line."""
    return separator.join(map(number, np.ravel(values)))


def written(value):
    """Return a value as a template writes it: any text stays on its line, a float is exact."""
    if isinstance(value, str):
        return one_line(value)
    return str(value) if isinstance(value, int) else numbers(value)


def float32(value):
    """Return text that reads back as the same float32."""
    return f"{np.float32(value):.9g}"


def rows(matrix):
    """Return a matrix as MATLAB takes it."""
    return "; ".join(numbers(row, " ") for row in np.atleast_2d(matrix))


def braces(values):
    """Return an array of three numbers or of three rows as C takes it."""
    inside = map(braces, values) if np.ndim(values) > 1 else map(number, values)
    return f"{{{', '.join(inside)}}}"


def in_c(text):
    """Return text for a C comment, which it neither ends nor opens."""
    return re.sub(r"\*(?=/)|/(?=\*)", r"\g<0> ", one_line(text))


def identifier(text):
    """Return a name of C and MATLAB."""
    return re.sub(r"\W", "_", text, flags=re.ASCII)
