"""Generalised least squares with a full covariance of the residuals."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares


@dataclass(frozen=True)
class Fit:
    """Result of a generalised least-squares fit.

    Attributes
    ----------
    x : ndarray, shape (p,)
        Parameters.
    covariance : ndarray, shape (p, p)
        ``(Jᵀ Σ⁻¹ J)⁻¹``, from the predicted covariance Σ of the residuals alone.
    chi2 : float
        ``rᵀ Σ⁻¹ r`` at the solution.
    dof : int
        Residuals less parameters.
    jacobian : ndarray, shape (n, p)
        Derivative of the residuals, not whitened.
    """

    x: np.ndarray
    covariance: np.ndarray
    chi2: float
    dof: int
    jacobian: np.ndarray

    @property
    def reduced_chi2(self):
        """Chi square per degree of freedom; not a number without any."""
        return self.chi2 / self.dof if self.dof > 0 else np.nan

    @property
    def scaled_covariance(self):
        """Covariance inflated by the reduced chi square where the residual exceeds its floor."""
        excess = self.reduced_chi2
        return self.covariance * (max(1.0, excess) if np.isfinite(excess) else 1.0)


def fit(residuals, x0, covariance):
    """Minimise ``r(x)ᵀ Σ⁻¹ r(x)``.

    Parameters
    ----------
    residuals : callable
        Gives the residuals, shape (n,), and their derivative, shape (n, p), at x.
    x0 : array_like, shape (p,)
        Start.
    covariance : array_like, shape (n, n)
        Covariance Σ of the residuals, positive definite.

    Returns
    -------
    Fit
        The solution.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance is not positive definite or the design is of deficient rank.
    """
    root = cholesky(covariance, lower=True)

    def whiten(values):
        return solve_triangular(root, values, lower=True)

    # both are wanted at the same point one after the other: computed once
    last = {}

    def evaluate(x):
        if "x" not in last or not np.array_equal(last["x"], x):
            r, jacobian = residuals(x)
            last.update(x=x.copy(), r=whiten(r), raw=jacobian, jacobian=whiten(jacobian))
        return last

    solution = least_squares(
        lambda x: evaluate(x)["r"],
        np.asarray(x0, dtype=float),
        jac=lambda x: evaluate(x)["jacobian"],
        x_scale="jac",
        # a step that would move chi square by less than 1e-9 of itself moves no parameter visibly
        xtol=1e-10,
        ftol=1e-10,
        gtol=None,
    )
    at = evaluate(solution.x)
    normal = at["jacobian"].T @ at["jacobian"]
    return Fit(
        solution.x,
        np.linalg.inv(normal),
        float(at["r"] @ at["r"]),
        len(at["r"]) - len(solution.x),
        at["raw"],
    )


def condition_number(jacobian, scales):
    """Return the condition number of a design whose parameters are measured in `scales`.

    Parameters
    ----------
    jacobian : array_like, shape (n, p)
        Derivative of the residuals.
    scales : array_like, shape (p,)
        Natural size of one unit of each parameter, so that columns compare.

    Returns
    -------
    float
        Largest over smallest singular value; infinite where the rank is deficient.
    """
    if jacobian.shape[0] < jacobian.shape[1]:
        return np.inf
    values = np.linalg.svd(np.asarray(jacobian) * scales, compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0 else np.inf
