"""A fit made again near one that is known: to a part of the data, or with one more effect."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from imuloop.calibrate.least_squares import Fit

# a step of less than this share of every standard error leaves the residual straight, to its
# square; a start that is not there by so many steps is none
CLOSE, STEPS = 1e-3, 12


@dataclass(frozen=True)
class Refit:
    """The fit, and the residuals of all data about it.

    Attributes
    ----------
    fit : Fit
        Of the rows that were fitted.
    values, jacobian : ndarray, shape (N,) and (N, p)
        All residuals, and their derivative.
    seen : ndarray of bool, shape (N,)
        The rows that were fitted.
    covariance : ndarray, shape (n, n)
        Predicted covariance of these.
    """

    fit: Fit
    values: np.ndarray
    jacobian: np.ndarray
    seen: np.ndarray
    covariance: np.ndarray


def refit(evaluate: Callable, seen, x):
    """Return the Refit from a start nearby, None if that leads nowhere.

    Steps of generalised least squares, weights and effects taken at each new point. The last step
    is so small that residuals follow it along their derivative. Near the solution each step is
    shorter than the one before; where one is not, the start was not near.

    Parameters
    ----------
    evaluate : callable
        Gives all residuals (N,), their derivative (N, p) and the covariance (n, n) of those that
        are seen, at x.
    seen : ndarray of bool, shape (N,)
        The rows to fit.
    x : ndarray, shape (p,)
        Start.
    """
    before = np.inf
    for _ in range(STEPS):
        values, jacobian, covariance = evaluate(x)
        stack = np.column_stack([jacobian, values])[seen]
        if not (np.isfinite(stack).all() and np.isfinite(covariance).all()):
            return None
        try:
            white = solve_triangular(cholesky(covariance, lower=True), stack, lower=True)
            size = np.linalg.norm(white[:, :-1], axis=0)
            if not size.all():
                return None
            design = white[:, :-1] / size
            parameters = np.linalg.inv(design.T @ design)
        except LinAlgError:
            return None
        # in units of one over the column's length
        step = -parameters @ (design.T @ white[:, -1])
        variance = np.diag(parameters)
        # rounding leaves a matrix that is nearly singular indefinite
        reach = np.max(np.abs(step) / np.sqrt(variance)) if np.all(variance > 0) else np.inf
        if reach >= before:
            return None
        before = reach
        left = white[:, -1] + design @ step
        x = x + step / size
        if reach < CLOSE:
            parameters = parameters / np.outer(size, size)
            dof = len(left) - len(x)
            fit = Fit(x, parameters, float(left @ left), dof, jacobian[seen])
            return Refit(fit, values + jacobian @ (step / size), jacobian, seen, covariance)
    return None
