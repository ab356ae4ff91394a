"""Residuals and their floor, which the noise alone would leave, in the fit and held out."""

import numpy as np
from scipy.special import chdtrc

from imuloop.core.precision import precision

# of its largest, below which a direction is no parameter's own
SINGULAR = 1e-12


def fold_fits(values, weights, jacobian, row_parts):
    """Return the errors of residuals of which each part is predicted by a fit to the others.

    A fit to the residuals that are seen has the parameters' error ``A r``, with
    ``A = (Jᵀ W J)⁻¹ Jᵀ W``, W the inverse of the covariance of what is seen; the error of what is
    held out is ``E r = r_h - J_h A r_s``. Slow noise which both share, and a fitted bias takes up,
    does not count in its covariance ``E Σ Eᵀ``. E is zero in the rows of no part.

    Parameters
    ----------
    values : ndarray, shape (n, m)
        m records of residuals.
    weights : ndarray, shape (n, n)
        Inverse of the covariance of all residuals.
    jacobian : ndarray, shape (n, p)
        J.
    row_parts : ndarray, shape (n, 2)
        The part that a row is held out with, and the other that it touches, or -1.

    Returns
    -------
    ndarray, shape (n, m)
        E r. It is linear in the residuals, at weights that are fixed; the errors that the verdict
        is by, of a choice of effects that is made again without each part, are those of
        `imuloop.estimate.choice.Choices.errors`.
    dict of int to ndarray, shape (p, p)
        ``(Jᵀ W J)⁻¹`` without each part.
    """
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0, size, 1.0)
    jacobian = jacobian / size
    product, information, moments = weights @ jacobian, [], []
    parts = sorted(set(row_parts[:, 0].tolist()) - {-1})
    for part in parts:
        touching = np.flatnonzero((row_parts == part).any(axis=1))
        # W J is what the weights of all rows leave without those that touch the part
        own = weights[:, touching]
        weighted = product - own @ np.linalg.solve(own[touching], product[touching])
        weighted[touching] = 0.0
        information.append(jacobian.T @ weighted)
        moments.append(weighted.T @ values)
    information = np.reshape(information, (-1, *2 * jacobian.shape[1:]))
    inverses = np.linalg.pinv(information, SINGULAR, hermitian=True)
    errors = np.zeros_like(values)
    for part, inverse, moment in zip(parts, inverses, moments, strict=True):
        rows = row_parts[:, 0] == part
        errors[rows] = values[rows] - jacobian[rows] @ (inverse @ moment)
    return errors, dict(zip(parts, inverses / np.outer(size, size), strict=True))


def held_out_covariance(covariance, jacobian, row_parts, weights=None):
    """Return the covariance that the noise, (n, n), alone gives to held-out errors, (n, n).

    Other arguments as in `fold_fits`; the inverse of the covariance without weights.
    """
    weights = precision(covariance)[0] if weights is None else weights
    operator, _ = fold_fits(np.eye(len(row_parts)), weights, jacobian, row_parts)
    return operator @ covariance @ operator.T


def chance(square, covariances):
    """Return the probability that independent groups of normal errors have a larger square.

    By the mean, variance and skewness of ``Σ eᵀe``, which a scaled and shifted χ² shares with it;
    takes the square and the covariance of each group.

    References
    ----------
    Hall, Ann. Statist. 11 (1983) 1028; Buckley & Eagleson, Austral. J. Statist. 30A (1988) 150.
    """
    moments = np.zeros(3)
    for own in covariances:
        twice = own @ own
        moments += np.trace(own), np.trace(twice), np.sum(twice * own)
    dof = moments[1] ** 3 / moments[2] ** 2
    return float(chdtrc(dof, max(dof + (square - moments[0]) * np.sqrt(dof / moments[1]), 0.0)))


def size(values):
    """Return the root mean square of the norms of residuals, shape (n, k), that are known."""
    return float(np.sqrt(np.nanmean((values**2).sum(axis=1))))
