"""Roots of many functions of one variable at once."""

import numpy as np


def root(function, low, high, tolerance=1e-12):
    """Return where functions are zero, each between two points at which its signs differ.

    Inverse quadratic interpolation where it is safe, else halves of the bracket.

    Parameters
    ----------
    function : callable
        Takes points, shape (n,), of the n functions to their values, shape (n,).
    low, high : array_like, shape (n,)
        Ends of the brackets; a scalar serves all functions.
    tolerance : float
        The root is known to this and to rounding.

    Returns
    -------
    ndarray, shape (n,)
        The roots.

    Raises
    ------
    ValueError
        If a function has the same sign at both ends.

    References
    ----------
    Chandrupatla, "A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear
    function without using derivatives", Advances in Engineering Software 28 (1997) 145.
    """
    b, a = (v.astype(float) for v in np.broadcast_arrays(np.atleast_1d(low), np.atleast_1d(high)))
    fa, fb = function(a), function(b)
    if not np.all(np.sign(fa) * np.sign(fb) <= 0):
        raise ValueError("a function has the same sign at both ends of its bracket")
    share = np.full(a.shape, 0.5)
    # where a bracket is closed, what is divided there does not matter
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        while True:
            x = a + share * (b - a)
            fx = function(x)
            same = np.sign(fx) == np.sign(fa)
            c, fc = np.where(same, a, b), np.where(same, fa, fb)
            b, fb = np.where(same, b, a), np.where(same, fb, fa)
            a, fa = x, fx
            best = np.where(np.abs(fa) < np.abs(fb), a, b)
            least = (2 * np.finfo(float).eps * np.abs(best) + tolerance) / np.abs(b - c)
            if np.all((least > 0.5) | (fa == 0) | (fb == 0)):
                return best
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            quadratic = fa / (fb - fa) * fc / (fb - fc)
            quadratic += (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
            safe = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi) & np.isfinite(quadratic)
            least = np.minimum(np.nan_to_num(least, nan=0.5), 0.5)
            share = np.clip(np.where(safe, quadratic, 0.5), least, 1 - least)
