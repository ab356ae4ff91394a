"""A fit made again near one that is known: to a part of the data, or with one more effect."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

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
    is so small that residuals follow it along their derivative.

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
    for _ in range(STEPS):
        values, jacobian, covariance = evaluate(x)
        root = cholesky(covariance, lower=True)
        stack = np.column_stack([jacobian, values])[seen]
        white = solve_triangular(root, stack, lower=True)
        size = np.linalg.norm(white[:, :-1], axis=0)
        if not size.all():
            return None
        design = white[:, :-1] / size
        parameters = np.linalg.inv(design.T @ design)
        # in units of one over the column's length
        step = -parameters @ (design.T @ white[:, -1])
        left = white[:, -1] + design @ step
        x = x + step / size
        if np.all(np.abs(step) < CLOSE * np.sqrt(np.diag(parameters))):
            parameters = parameters / np.outer(size, size)
            dof = len(left) - len(x)
            fit = Fit(x, parameters, float(left @ left), dof, jacobian[seen])
            return Refit(fit, values + jacobian @ (step / size), jacobian, seen, covariance)
    return None
