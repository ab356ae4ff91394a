"""Combination of independent p-values."""

import numpy as np


def fisher(log_p):
    """Return the logarithm of Fisher's combined p-value.

    Takes a sequence of the logarithms of k p-values, numbers or arrays; the result is like one of
    them. ``-2 Σ log p`` is χ² with 2k degrees of freedom, whose tail is ``exp(-L) Σ_{i<k} Lⁱ/i!``
    at ``L = -Σ log p``.
    """
    total = -sum(log_p)
    # the sum over i, term by term; ones in the shape of the total
    term = series = total * 0 + 1.0
    for i in range(1, len(log_p)):
        term = term * total / i
        series = series + term
    return np.log(series) - total
