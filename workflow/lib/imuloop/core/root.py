"""Roots of many functions of one variable at once."""

import numpy as np
from scipy.optimize import elementwise


def root(function, low, high, tolerance=1e-12):
    """Return where functions are zero, each between two points at which its signs differ.

    Parameters
    ----------
    function : callable
        Takes points, shape (n,), of the n functions to their values, shape (n,).
    low, high : array_like, shape (n,)
        Ends of the brackets; a scalar serves all functions.
    tolerance : float
        The root is known to this and to rounding.

    Raises
    ------
    ValueError
        If a function has the same sign at both ends.
    """
    low, high = np.broadcast_arrays(np.atleast_1d(low).astype(float), high)
    points = low.copy()

    def of_some(x, which):
        # functions whose root is found are not asked for any more
        points[which] = x
        return function(points)[which]

    found = elementwise.find_root(
        of_some,
        (low, high),
        args=(np.arange(len(low)),),
        tolerances={"xatol": 2 * tolerance, "xrtol": 4 * np.finfo(float).eps},
    )
    if np.any(found.status == -1):
        raise ValueError("a function has the same sign at both ends of its bracket")
    return found.x
