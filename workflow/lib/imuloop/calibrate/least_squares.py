"""Generalised least squares with a full covariance of the residuals."""

from dataclasses import dataclass, field

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares

# evaluations after which a fit is given up, and the relative tolerance of its end
_STEPS, _TOLERANCE = 200, 1e-10
# degrees of freedom from which on the reduced chi square tells something
LEAST_DOF = 10
# singular value over the largest, columns of length one, that rounding alone may leave
_SMALLEST = 1e-10
# why there is no fit where numpy.linalg.LinAlgError says so
SINGULAR = (
    "rounding leaves a covariance or the derivative of the residuals singular: is the noise or the "
    "range of a channel far from that of the others?"
)


class NotConverged(LinAlgError):
    """A search for the best fit that did not converge."""


def why_no_fit(error):
    """Return what to say of a LinAlgError that a fit raised, one line of text."""
    return str(error) if isinstance(error, NotConverged) else SINGULAR


@dataclass(frozen=True)
class FitResult:
    """Result of a generalised least-squares fit of p parameters to n residuals.

    The covariance is ``C = (Jᵀ Σ⁻¹ J + Rᵀ R)⁻¹``, from the predicted covariance Σ of the residuals
    and the rows R of the prior; χ² is ``rᵀ Σ⁻¹ r``, its degrees of freedom ``n - p + tr(R C Rᵀ)``.
    The derivative J, (n, p), is not whitened, the residuals are, (n,), each given those before it.
    """

    x: np.ndarray
    covariance: np.ndarray
    chi2: float
    dof: float
    jacobian: np.ndarray
    white: np.ndarray

    @property
    def reduced_chi2(self):
        """Chi square per degree of freedom; not a number below `LEAST_DOF`, where it is chance."""
        return self.chi2 / self.dof if self.dof >= LEAST_DOF else np.nan

    @property
    def scaled_covariance(self):
        """Covariance inflated by the reduced chi square where the residual exceeds its floor."""
        return self.covariance * np.fmax(1.0, self.reduced_chi2)


@dataclass(frozen=True)
class Solution:
    """A fit to data, and the effects in it.

    The fit has the base parameters that are estimated, then the effects', SI as logged. Reduced χ²
    is by what the noise alone predicts, of each sensor's residuals and of those of ``motion``.
    """

    effects: tuple
    fit: FitResult
    reduced_chi2: dict = field(default_factory=dict)


def fit(residuals, x0, covariance, prior=None):
    """Minimise ``r(x)ᵀ Σ⁻¹ r(x)``, or ``r(x)ᵀ Σ⁻¹ r(x) + |R x - z|²`` with what is known of x.

    MINPACK's Levenberg-Marquardt on the analytic derivative. Parameters are measured by the length
    of their columns in the derivative.

    Parameters
    ----------
    residuals : callable
        Gives the residuals, shape (n,), and their derivative, shape (n, p), at x.
    x0 : array_like, shape (p,)
        Start.
    covariance : array_like, shape (n, n) or (n,)
        Covariance Σ of the residuals, positive definite, or the variances of independent ones.
    prior : (ndarray, ndarray), optional
        R, shape (k, p), and z, shape (k,), from other data.

    Returns
    -------
    FitResult

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance is not positive definite or the design is of deficient rank; NotConverged
        where chi square still falls after the last step.
    """
    one_each = np.ndim(covariance) == 1
    root = np.sqrt(covariance) if one_each else np.linalg.cholesky(covariance)
    whiten = np.diag(1 / root) if one_each else np.linalg.inv(root)
    last = {}

    def evaluate(x):
        key = x.tobytes()
        if key not in last:
            r, jacobian = residuals(x)
            r, white = whiten @ r, whiten @ jacobian
            if prior is not None:
                known, z = prior
                r, white = np.append(r, known @ x - z), np.concatenate([white, known])
            last.clear()
            last[key] = r, white, jacobian
        return last[key]

    x = np.array(x0, dtype=float)
    if not np.isfinite(evaluate(x)[0]).all():
        raise LinAlgError("residuals that are not finite")
    found = least_squares(
        lambda x: evaluate(x)[0],
        x,
        lambda x: evaluate(x)[1],
        method="lm",
        x_scale="jac",
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        max_nfev=_STEPS,
    )
    if not found.status:
        raise NotConverged(f"the fit does not converge in {_STEPS} steps")
    x = found.x
    r, white, jacobian = evaluate(x)
    left, covariance = r[: len(jacobian)], covariance_of(white)
    # the prior determines parts of the parameters: of so many the data determine none
    held = 0.0 if prior is None else np.sum(prior[0] @ covariance * prior[0])
    dof = float(len(left) - len(x) + held)
    return FitResult(x, covariance, float(left @ left), dof, jacobian, left)


def chi_square(values, covariance, jacobian, groups):
    """Return χ² and degrees of freedom of each group of residuals, and the log likelihood of all.

    The trace of ``H = J C Jᵀ Σ⁻¹`` is how many of the parameters a group's residuals carry. Takes
    residuals, (n,), their covariance Σ, (n, n), and derivative J with respect to the parameters,
    (n, p), which are fitted again to all together, and masks of the groups; the likelihood is
    restricted.
    """
    root = cholesky(covariance, lower=True)
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(size > 0, size, 1.0)
    white = solve_triangular(root, np.column_stack([values, scaled]), lower=True)
    q, r = np.linalg.qr(white[:, 1:])
    left = values - scaled @ solve_triangular(r, q.T @ white[:, 0])
    leverage = solve_triangular(r, scaled.T, trans=1)
    found = []
    for at in groups:
        own = covariance[np.ix_(at, at)]
        taken = np.trace(np.linalg.solve(own, leverage[:, at].T @ leverage[:, at]))
        # rounding leaves less than nothing of what never leaves its level
        square = max(float(left[at] @ np.linalg.solve(own, left[at])), 0.0)
        found.append((square, float(at.sum() - taken)))
    rest = white[:, 0] - q @ (q.T @ white[:, 0])
    likelihood = -np.log(np.diag(root)).sum() - np.log(np.abs(np.diag(r))).sum() - rest @ rest / 2
    return found, float(likelihood)


def covariance_of(white):
    """Return ``(Wᵀ W)⁻¹``, (p, p), from the singular values of W, (n, p), its columns normalised.

    A LinAlgError if W has no full rank, or is not finite.
    """
    length = np.linalg.norm(white, axis=0)
    if not (np.isfinite(length).all() and length.all()):
        raise LinAlgError("a parameter that no residual depends on")
    _, values, axes = np.linalg.svd(white / length, full_matrices=False)
    if values[-1] < _SMALLEST * values[0] or len(white) < len(length):
        raise LinAlgError("singular derivative of the residuals")
    root = axes / values[:, None] / length
    return root.T @ root
