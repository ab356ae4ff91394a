"""Residuals at the poses: what the calibrated output still lacks, against its floor."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import chdtrc


@dataclass(frozen=True)
class Residual:
    """One kind of residual of a sensor with what the noise model predicts for it.

    Attributes
    ----------
    unit : str
        SI unit.
    values : ndarray, shape (n, k)
        Residual of each pose or rotation; its size is the norm over the k components.
    reduced_chi2 : float
        Against the full covariance.
    dof : float
        Degrees of freedom: residuals less the share of the parameters that they carry.
    """

    unit: str
    values: np.ndarray
    reduced_chi2: float
    dof: float

    def above_floor(self, significance):
        """Return whether the residual is larger than the noise explains."""
        return bool(chdtrc(self.dof, self.reduced_chi2 * self.dof) < significance)


def judge(unit, values, covariance, jacobian, parameters):
    """Compare residuals of a fit with their predicted covariance.

    The parameters are estimated from these residuals, and maybe from others too. The trace of
    ``H = J C Jᵀ Σ⁻¹`` is how many of them these residuals carry.

    Parameters
    ----------
    unit : str
        SI unit.
    values : ndarray, shape (n, k)
        Residuals.
    covariance : ndarray, shape (n k, n k)
        Predicted covariance Σ.
    jacobian : ndarray, shape (n k, p)
        Derivative J with respect to the fitted parameters.
    parameters : ndarray, shape (p, p)
        Covariance C of the parameters, from the noise alone.
    """
    flat = values.ravel()
    leverage = jacobian @ parameters @ jacobian.T
    dof = len(flat) - np.trace(np.linalg.solve(covariance, leverage))
    square = flat @ np.linalg.solve(covariance, flat)
    return Residual(unit, values, float(square / dof), float(dof))


def held_out_variance(covariance, jacobian, seen, held):
    """Return the variance that the noise alone gives to the errors of held-out residuals.

    A fit to the residuals that are seen has the parameters' error ``A r``, with
    ``A = C Jᵀ Σ⁻¹`` and ``C = (Jᵀ Σ⁻¹ J)⁻¹`` of the seen part; a held-out residual then has

        var(r_h - J_h A r) = Σ_hh - 2 J_h A Σ_sh + J_h C J_hᵀ

    so that slow noise which both parts share, and a fitted bias takes up, does not count.

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
        Predicted covariance Σ of all residuals.
    jacobian : ndarray, shape (n, p)
        Derivative J with respect to the parameters.
    seen, held : ndarray of bool, shape (n,)
        The residuals of the fit, and those to predict.

    Returns
    -------
    ndarray, shape (number held,)
        Variances.
    """
    root = cholesky(covariance[np.ix_(seen, seen)], lower=True)
    white = solve_triangular(root, jacobian[seen], lower=True)
    parameters = np.linalg.inv(white.T @ white)
    gain = parameters @ solve_triangular(root, white, lower=True, trans=1).T
    ahead = jacobian[held]
    shared = np.einsum("hs,hs->h", ahead @ gain, covariance[np.ix_(held, seen)])
    own = np.einsum("hp,pq,hq->h", ahead, parameters, ahead)
    return np.diag(covariance)[held] - 2 * shared + own


def size(values):
    """Return the root mean square of the norms of residuals, shape (n, k)."""
    return float(np.sqrt((values**2).sum(axis=1).mean()))
