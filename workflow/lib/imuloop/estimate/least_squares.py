"""Generalised least squares with a full covariance of the residuals."""

from dataclasses import dataclass, field

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares

# evaluations after which a fit is given up, and the relative tolerance of its end
_STEPS, _TOLERANCE = 200, 1e-8
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
class Fit:
    """A generalised least-squares fit of p parameters to n residuals.

    The covariance is ``C = (Jᵀ Σ⁻¹ J + Rᵀ R)⁻¹``, from the predicted covariance Σ of the residuals
    and the rows R of the prior; χ² is ``rᵀ Σ⁻¹ r``, its degrees of freedom ``n - p + tr(R C Rᵀ)``.
    The residuals, (n,), are whitened, each given those before it. `effects` are those among the
    parameters; reduced χ² is by what the noise alone predicts, of each sensor's residuals and of
    those of ``motion``.
    """

    x: np.ndarray
    covariance: np.ndarray
    chi2: float
    dof: float
    white: np.ndarray
    effects: tuple = ()
    reduced_chi2: dict = field(default_factory=dict)

    @property
    def scaled_covariance(self):
        """Covariance inflated by the reduced χ² above one; below `LEAST_DOF` that is chance."""
        enough = self.dof >= LEAST_DOF
        return self.covariance * max(1.0, self.chi2 / self.dof if enough else 1.0)


def fit(linearise, x0, covariance, prior=None, first=None):
    """Minimise ``r(x)ᵀ Σ⁻¹ r(x)``, or ``r(x)ᵀ Σ⁻¹ r(x) + |R x - z|²`` with what is known of x.

    MINPACK's Levenberg-Marquardt on the analytic derivative. Parameters are measured by the length
    of their columns in the derivative.

    Parameters
    ----------
    linearise : callable
        Gives at x an object with the residuals, shape (n,), as `residual`, and their derivative,
        shape (n, p), as `jacobian`.
    x0 : array_like, shape (p,)
        Start.
    covariance : array_like, shape (n, n) or (n,)
        Covariance Σ of the residuals, positive definite, or the variances of independent ones.
    prior : (ndarray, ndarray), optional
        R, shape (k, p), and z, shape (k,), from other data.
    first : optional
        What `linearise` gives at the start, where that is known.

    Returns
    -------
    Fit

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance is not positive definite or the design is of deficient rank; NotConverged
        where chi square still falls after the last step.
    """
    independent = np.ndim(covariance) == 1
    root = np.sqrt(covariance) if independent else np.linalg.cholesky(covariance)
    whiten = np.diag(1 / root) if independent else np.linalg.inv(root)
    rows, z = (np.zeros((0, len(x0))), np.zeros(0)) if prior is None else prior
    x = np.array(x0, dtype=float)
    at = remembered(linearise, x, first)

    def residual(x):
        return np.append(whiten @ at(x).residual, rows @ x - z)

    def jacobian(x):
        return np.concatenate([whiten @ at(x).jacobian, rows])

    if not np.isfinite(residual(x)).all():
        raise LinAlgError("residuals that are not finite")
    how = dict.fromkeys(("ftol", "xtol", "gtol"), _TOLERANCE) | {"max_nfev": _STEPS}
    found = least_squares(residual, x, jacobian, method="lm", x_scale="jac", **how)
    if not found.status:
        raise NotConverged(f"the fit does not converge in {_STEPS} steps")
    x, covariance = found.x, covariance_of(jacobian(found.x))
    white = residual(x)[: len(whiten)]
    # the prior determines parts of the parameters: of so many the data determine none
    dof = float(len(white) - len(x) + np.sum(rows @ covariance * rows))
    return Fit(x, covariance, float(white @ white), dof, white)


def remembered(function, x=None, result=None):
    """Return a function of arrays that keeps its last result, at first one that is known.

    A solver asks for the residuals, then perhaps for their derivative at the same place.
    """
    last = None if result is None else (x.copy(), result)

    def at(x):
        nonlocal last
        if last is None or np.any(last[0] != x):
            last = x.copy(), function(x)
        return last[1]

    return at


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
