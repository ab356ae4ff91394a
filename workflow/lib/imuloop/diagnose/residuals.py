"""Residuals against their floor: what the noise alone would leave, in the fit and held out."""

import numpy as np
from scipy.linalg import cholesky, solve_triangular

# probability of an alternative of the noise that a range does not hold
NEGLIGIBLE = 0.025


def chi_square(values, covariance, jacobian, groups):
    """Return χ² and degrees of freedom of each group of residuals, all of them fitted together.

    The trace of ``H = J C Jᵀ Σ⁻¹`` is how many of the parameters a group's residuals carry.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Residuals.
    covariance : ndarray, shape (n, n)
        Their covariance Σ.
    jacobian : ndarray, shape (n, p)
        Derivative J with respect to the parameters, which are fitted anew.
    groups : sequence of ndarray of bool, shape (n,)
        Groups.

    Returns
    -------
    list of (float, float)
        Group by group.
    float
        Logarithm of the restricted likelihood of all.
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


def held_out_variance(covariance, jacobian, seen, held, weights=None):
    """Return the variance that the noise alone gives to the errors of held-out residuals.

    A fit to the residuals that are seen has the parameters' error ``A r``, with
    ``A = (Jᵀ W J)⁻¹ Jᵀ W`` and ``W = Σ⁻¹`` of the seen part; a held-out residual then has

        var(r_h - J_h A r) = Σ_hh - 2 J_h A Σ_sh + J_h A Σ_ss Aᵀ J_hᵀ

    so that slow noise which both parts share, and a fitted bias takes up, does not count.

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
        Predicted covariance Σ of all residuals.
    jacobian : ndarray, shape (n, p)
        Derivative J with respect to the parameters.
    seen, held : ndarray of bool, shape (n,)
        The residuals of the fit, and those to predict.
    weights : ndarray, shape (n,), optional
        Diagonal of W, where the fit takes other weights.

    Returns
    -------
    ndarray, shape (number held,)
        Variances.
    """
    among, design, ahead = covariance[np.ix_(seen, seen)], jacobian[seen], jacobian[held]
    if weights is None:
        root = cholesky(among, lower=True)
        white = solve_triangular(root, design, lower=True)
        weighted = solve_triangular(root, white, lower=True, trans=1)
    else:
        weighted = design * weights[seen, None]
    gain = ahead @ np.linalg.solve(design.T @ weighted, weighted.T)
    shared = np.einsum("hs,hs->h", gain, covariance[np.ix_(held, seen)])
    own = np.einsum("hs,st,ht->h", gain, among, gain)
    return np.diag(covariance)[held] - 2 * shared + own


def floor_variance(covariance, jacobian, folds, weights=None):
    """Return `held_out_variance` of all rows, each part predicted by the others, shape (n,).

    Parameters
    ----------
    covariance, jacobian, weights
        As of `held_out_variance`.
    folds : ndarray of int, shape (n, 2)
        The part that each row is held out with, and the other that it touches; -1 for none.
    """
    found = np.zeros(len(covariance))
    for part in set(folds[:, 0].tolist()) - {-1}:
        held, seen = folds[:, 0] == part, ~(folds == part).any(axis=1)
        found[held] = held_out_variance(covariance, jacobian, seen, held, weights)
    return found


def likely(log_priors, log_likelihoods):
    """Return the probability of alternatives after the data, summing to 1."""
    log = np.add(log_priors, log_likelihoods)
    found = np.exp(log - log.max())
    return found / found.sum()


def floor_range(weights, floors, floor):
    """Return the least and the largest floor of the alternatives that are likely enough.

    Parameters
    ----------
    weights, floors : sequence of float
        Of the alternatives.
    floor : float
        Their mean.
    """
    kept = [floor, *(f for w, f in zip(weights, floors, strict=True) if w >= NEGLIGIBLE)]
    return [min(kept), max(kept)]


def size(values):
    """Return the root mean square of the norms of residuals, shape (n, k)."""
    return float(np.sqrt((values**2).sum(axis=1).mean()))
