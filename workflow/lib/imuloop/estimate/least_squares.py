"""Generalised least squares with a full covariance of the residuals."""

from dataclasses import dataclass, field

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares

# largest number of evaluations in a fit, and the relative tolerance at which the fit ends
_STEPS, _TOLERANCE = 200, 1e-8
# least degrees of freedom with which the reduced χ² says how large the noise is
LEAST_DOF = 10
# a matrix is singular if its smallest singular value over its largest is below this
_SMALLEST = 1e-10
# the message for a numpy.linalg.LinAlgError
SINGULAR = (
    "rounding leaves a covariance or the derivative of the residuals singular: is the noise or the "
    "range of a channel far from that of the others?"
)


class NotConverged(LinAlgError):
    """The error that is raised if an iterative fit does not converge."""


def why_no_fit(error):
    """Return the message, one line of text, for an `error` that a fit raised, a LinAlgError.

    It says that the fit did not converge, or that a matrix is singular.
    """
    return str(error) if isinstance(error, NotConverged) else SINGULAR


@dataclass(frozen=True)
class Fit:
    """A generalised least-squares fit of p parameters to n residuals.

    r are the residuals and Σ their covariance, J is their Jacobian, (n, p). R, (k, p), and z are a
    prior: ``R x - z`` has mean zero and independent components of variance one.
    """

    x: np.ndarray  # (p,): estimates of the parameters
    covariance: np.ndarray  # (p, p): of the estimates, C = (Jᵀ Σ⁻¹ J + Rᵀ R)⁻¹
    chi2: float  # rᵀ Σ⁻¹ r
    dof: float  # degrees of freedom of χ², n - p + tr(R C Rᵀ)
    white: np.ndarray  # (n,): residuals after whitening, L⁻¹ r with L Lᵀ = Σ
    effects: tuple = ()  # effects that the model has
    # reduced χ² with the covariance of the noise alone: by name of the sensor whose residuals it
    # has, or 'motion' for residuals of both sensors
    reduced_chi2: dict = field(default_factory=dict)

    @property
    def scaled_covariance(self):
        """Covariance of the estimates, (p, p), times the reduced χ² if that is above one.

        The factor is one if there are fewer than `LEAST_DOF` degrees of freedom, as the reduced χ²
        says little then.
        """
        enough = self.dof >= LEAST_DOF
        return self.covariance * max(1.0, self.chi2 / self.dof if enough else 1.0)


def fit(linearise, x0, covariance, prior=None, first=None):
    """Return the Fit that minimises ``r(x)ᵀ Σ⁻¹ r(x) + |R x - z|²`` over p parameters x.

    r are n residuals with the covariance Σ; R and z are a prior of x. The method is MINPACK's
    Levenberg-Marquardt with the analytic Jacobian. The solver scales each parameter by the norm of
    its column of the Jacobian.

    Parameters
    ----------
    linearise : callable
        Takes x; returns an object that has the residuals, shape (n,), as `residual`, and their
        Jacobian, shape (n, p), as `jacobian`.
    x0 : array_like, shape (p,)
        Parameters to start from.
    covariance : array_like, shape (n, n) or (n,)
        Covariance Σ of the residuals, positive definite. A vector has the variances of independent
        residuals.
    prior : (ndarray, ndarray), optional
        R, shape (k, p), and z, shape (k,), from other data, such that ``R x - z`` has mean zero and
        independent components of variance one. Without it the second term is zero.
    first : optional
        Result of `linearise` at `x0`, if it was computed before.

    Returns
    -------
    Fit
        The estimates, their covariance, and χ².

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance is not positive definite, or the Jacobian has no full rank. NotConverged
        if χ² still falls after the last step.
    """
    independent = np.ndim(covariance) == 1
    root = np.sqrt(covariance) if independent else np.linalg.cholesky(covariance)
    whiten = np.diag(1 / root) if independent else np.linalg.inv(root)
    R, z = (np.zeros((0, len(x0))), np.zeros(0)) if prior is None else prior
    x = np.array(x0, dtype=float)
    # the solver asks for the residuals at x and then for their Jacobian at the same x
    last = [(None, None) if first is None else (x.copy(), first)]

    def linearised(x):
        """Return the result of `linearise` at `x`: the stored one if `x` has not changed."""
        if not np.array_equal(last[0][0], x):
            last[0] = x.copy(), linearise(x)
        return last[0][1]

    def residual(x):
        """Return n whitened residuals, then k of the prior, (n + k,), at the parameters `x`."""
        return np.append(whiten @ linearised(x).residual, R @ x - z)

    def jacobian(x):
        """Return the derivative of `residual` with respect to the p parameters `x`, (n + k, p)."""
        return np.concatenate([whiten @ linearised(x).jacobian, R])

    if not np.isfinite(residual(x)).all():
        raise LinAlgError("residuals that are not finite")
    options = dict.fromkeys(("ftol", "xtol", "gtol"), _TOLERANCE) | {"max_nfev": _STEPS}
    result = least_squares(residual, x, jacobian, method="lm", x_scale="jac", **options)
    if not result.status:
        raise NotConverged(f"the fit does not converge in {_STEPS} steps")
    x, covariance = result.x, covariance_of(jacobian(result.x))
    white = residual(x)[: len(whiten)]
    # tr(R C Rᵀ) counts the parameters that the prior determines instead of the data
    dof = float(len(white) - len(x) + np.sum(R @ covariance * R))
    return Fit(x, covariance=covariance, chi2=float(white @ white), dof=dof, white=white)


def chi_square(values, covariance, jacobian, groups):
    """Return χ² and degrees of freedom of each group of residuals, and the log likelihood of all.

    The residuals come from an earlier fit, which may have used other weights than Σ⁻¹. So the p
    parameters are first fitted again to all residuals, by one linear step. By χ² and its degrees of
    freedom each group is compared with the noise that Σ assumes.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Residuals.
    covariance : ndarray, shape (n, n)
        Covariance Σ of the residuals.
    jacobian : ndarray, shape (n, p)
        Jacobian J of the residuals.
    groups : sequence of ndarray, shape (n,) of bool
        For each group, a mask of its residuals.

    Returns
    -------
    list of (float, float)
        χ² and degrees of freedom of each group. The degrees of freedom are the number of residuals
        of the group minus the number of parameters that this group determines. This number is the
        trace of ``J C Jᵀ Σ⁻¹``. J and Σ have here the rows of the group alone; C is the covariance
        of the parameters in the fit to all residuals.
    float
        Logarithm of the restricted likelihood of all residuals.
    """
    root = cholesky(covariance, lower=True)
    # columns of length one keep parameters of different units from losing digits
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(size > 0, size, 1.0)
    white = solve_triangular(root, np.column_stack([values, scaled]), lower=True)
    # residuals after the linear step; the leverage L has ``LᵀL = J C Jᵀ``
    q, r = np.linalg.qr(white[:, 1:])
    residuals = values - scaled @ solve_triangular(r, q.T @ white[:, 0])
    leverage = solve_triangular(r, scaled.T, trans=1)
    squares = []
    for rows in groups:
        block = covariance[np.ix_(rows, rows)]
        share = np.trace(np.linalg.solve(block, leverage[:, rows].T @ leverage[:, rows]))
        # rounding can make the square of constant residuals negative
        square = max(float(residuals[rows] @ np.linalg.solve(block, residuals[rows])), 0.0)
        squares.append((square, float(rows.sum() - share)))
    # whitened residuals without the part that the parameters explain
    white_residuals = white[:, 0] - q @ (q.T @ white[:, 0])
    log_det = np.log(np.diag(root)).sum() + np.log(np.abs(np.diag(r))).sum()
    return squares, float(-log_det - white_residuals @ white_residuals / 2)


def covariance_of(white):
    """Return ``(Wᵀ W)⁻¹``, (p, p), for a matrix W, (n, p), the argument `white`.

    If W is the Jacobian of n residuals after whitening, the result is the covariance of the p
    parameters. It is computed from the singular value decomposition of W with columns of length
    one. Raises LinAlgError if W has no full rank or is not finite.
    """
    length = np.linalg.norm(white, axis=0)
    if not (np.isfinite(length).all() and length.all()):
        raise LinAlgError("a parameter that no residual depends on")
    _, values, axes = np.linalg.svd(white / length, full_matrices=False)
    if values[-1] < _SMALLEST * values[0] or len(white) < len(length):
        raise LinAlgError("singular derivative of the residuals")
    # C = V S⁻² Vᵀ of the decomposition U S Vᵀ, with the scale of each parameter put back
    root = axes / values[:, None] / length
    return root.T @ root
