"""Fisher's method: one p-value from the p-values of several independent tests."""

import numpy as np


def fisher(log_p):
    """Return the logarithm of the combined p-value of k independent tests, by Fisher's method.

    `log_p` is a sequence of the natural logarithms of the k p-values, numbers or arrays of one
    shape. The result has this shape, with one combination for each element. If all null hypotheses
    are true, ``-2 Σ log p`` is χ² with 2k degrees of freedom. The combined p-value is the upper
    tail of this distribution, ``exp(-L) Σ_{i<k} Lⁱ/i!`` with ``L = -Σ log p``.
    """
    total = -sum(log_p)
    # each term of the sum follows from the one before
    term = series = np.ones_like(total)
    for i in range(1, len(log_p)):
        term = term * total / i
        series = series + term
    return np.log(series) - total
