"""Held-out errors of linear fits, their floor, and the ratio of errors with and without an effect.

A held-out error is the error of the prediction of a residual by a fit to the residuals outside its
fold; a fold has the residuals that are held out together. The floor is the error that the noise
alone gives.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, stdtrit

from imuloop.core.precision import precision

# eigenvalues below this share of the largest one count as zero
SINGULAR = 1e-12


def fold_fits(values, weights, jacobian, row_folds, counts=None):
    """Return held-out errors: each fold is predicted by a linear fit to the rows outside it.

    A fold has the rows (scalar residuals) that are held out together. The fit to the training
    residuals r_s, those outside the fold, has the parameters ``A r_s``, with
    ``A = (Jᵀ W J)⁻¹ Jᵀ W``. W is the inverse of the covariance of the training residuals and J is
    their Jacobian. The held-out residuals r_h, with the Jacobian J_h, have the error
    ``E r = r_h - J_h A r_s``, with all residuals r. E is linear, so the covariance of the errors is
    ``E Σ Eᵀ`` with the covariance Σ of r. In this covariance, slow noise that training and held-out
    rows share cancels as far as a fitted bias follows it. Parameters that the training rows do not
    determine, because only held-out rows depend on them, are zero.

    Parameters
    ----------
    values : ndarray, shape (n, m)
        Residuals r of n rows. Each of the m columns is a data set that is predicted alone.
    weights : ndarray, shape (n, n)
        Inverse of the covariance Σ of all residuals.
    jacobian : ndarray, shape (n, p)
        Jacobian of all residuals, their derivative with respect to p parameters.
    row_folds : ndarray, shape (n, 2)
        The fold that a row is held out with, and a second fold that it depends on; -1 is no fold.
        The row is left out of the training data of both folds.
    counts : sequence of int, optional
        Numbers of parameters. Each number k gives one fit, which has the first k parameters. By
        default there is one fit with all p parameters.

    Returns
    -------
    list of (ndarray, dict)
        One pair for each fit. The array has the errors E r, (n, m); they are zero in rows that
        belong to no fold. The keys of the dict are the numbers of the folds. The value of a fold is
        ``(Jᵀ W J)⁻¹``, the covariance of the k parameters of the fit to the rows outside the fold,
        (k, k).
    """
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0, size, 1.0)
    jacobian = jacobian / size
    product, information, moments = weights @ jacobian, [], []
    folds = sorted(set(row_folds[:, 0].tolist()) - {-1})
    for fold in folds:
        held_rows = np.flatnonzero((row_folds == fold).any(axis=1))
        # W J of the training rows, from the weights of all rows: their covariance is a block of Σ,
        # whose inverse is a Schur complement
        block = weights[:, held_rows]
        weighted = product - block @ np.linalg.solve(block[held_rows], product[held_rows])
        weighted[held_rows] = 0.0
        information.append(jacobian.T @ weighted)
        moments.append(weighted.T @ values)
    information, fits = np.reshape(information, (-1, *2 * jacobian.shape[1:])), []
    for p in counts or jacobian.shape[1:]:
        # a parameter that only the held-out rows show has no information: it is not fitted
        inverses = np.linalg.pinv(information[:, :p, :p], SINGULAR, hermitian=True)
        errors = np.zeros_like(values)
        for fold, inverse, moment in zip(folds, inverses, moments, strict=True):
            rows = row_folds[:, 0] == fold
            errors[rows] = values[rows] - jacobian[rows, :p] @ (inverse @ moment[:p])
        inverses = inverses / np.outer(size[:p], size[:p])
        fits.append((errors, dict(zip(folds, inverses, strict=True))))
    return fits


def held_out_covariance(covariance, jacobian, row_folds, weights=None):
    """Return the covariance, (n, n), that noise gives the held-out errors of n residuals.

    Each fold is predicted by a linear fit of p parameters to the residuals outside it.

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
        Covariance of the noise of the residuals.
    jacobian : ndarray, shape (n, p)
        Jacobian of the residuals.
    row_folds : ndarray, shape (n, 2)
        The fold that a residual is held out with, and a second fold that it depends on; -1 is no
        fold. The residual is left out of the training data of both folds.
    weights : ndarray, shape (n, n), optional
        Inverse of the covariance that the fits assume; by default the inverse of `covariance`.
    """
    weights = precision(covariance)[0] if weights is None else weights
    ((operator, _),) = fold_fits(np.eye(len(row_folds)), weights, jacobian, row_folds)
    return operator @ covariance @ operator.T


def exceedance_probability(square, covariances):
    """Return the p-value of a sum of squares: the probability that noise gives a larger one.

    `square` is the sum of squares of all errors. The errors come in independent groups.
    `covariances` is a list that has for each group the covariance of its n errors by the noise, (n,
    n). The distribution of the sum is approximated by a scaled and shifted χ² with the right mean,
    variance and skewness.

    References
    ----------
    Hall, Ann. Statist. 11 (1983) 1028; Buckley & Eagleson, Austral. J. Statist. 30A (1988) 150.
    """
    moments = np.zeros(3)
    for covariance in covariances:
        square_matrix = covariance @ covariance
        traces = np.trace(covariance), np.trace(square_matrix), np.sum(square_matrix * covariance)
        moments += traces
    # the k-th cumulant of the sum of squares is proportional to the trace of the k-th power
    dof = moments[1] ** 3 / moments[2] ** 2
    return float(chdtrc(dof, max(dof + (square - moments[0]) * np.sqrt(dof / moments[1]), 0.0)))


def rms_norm(values):
    """Return the root mean square norm of n residuals, a float.

    `values`, (n, k), has the k components of each residual. Residuals with a component that is nan
    are left out.
    """
    return float(np.sqrt(np.nanmean((values**2).sum(axis=1))))


class ErrorChange(NamedTuple):
    """The held-out errors of n residuals on k axes, without and with an effect in the model."""

    residual_kind: str  # kind of residual that the effect changes most
    before: np.ndarray  # (n, k): held-out errors of that kind without the effect, SI
    after: np.ndarray  # (n, k): held-out errors of that kind with the effect, SI
    # [low, high]: 95 % interval of the ratio of the root mean square errors, after over before
    ratio: list

    @property
    def certain(self):
        """Whether the errors fall with confidence: the whole interval of the ratio is below one."""
        return self.ratio[1] < 1


def ratio_interval(fold_of_row, before, after):
    """Return the 95 % interval, [low, high], of the ratio of two root mean square errors.

    The ratio says whether an effect lowers the held-out errors: it is the error with the effect
    over the error without it. The interval comes from a jackknife, which leaves out one fold at a
    time. A jackknife needs several folds in which the errors change, so `cut_folds` first cuts the
    folds with the largest change. The standard error belongs to the mean of the jackknife's
    pseudo-values. The interval uses Student's t, with one degree of freedom less than there are
    folds. If fewer than two folds have errors, the interval is zero to infinity. (An interval of
    the logarithm of the ratio has the same coverage, but is far wider if one fold has most of the
    error, as with a step.)

    Parameters
    ----------
    fold_of_row : ndarray, shape (n,)
        Fold of each of n residuals.
    before, after : ndarray, shape (n, k)
        Held-out errors of the n residuals on k axes, without and with the effect.

    References
    ----------
    J. W. Tukey, Ann. Math. Statist. 29 (1958) 614; B. Efron, R. J. Tibshirani, An Introduction to
    the Bootstrap (1993), chapter 11.
    """
    folds = cut_folds(fold_of_row, ((before - after) ** 2).sum(axis=1))
    before, after = ((folds @ errors**2).sum(axis=1) for errors in (before, after))
    # row i of `others` chooses all folds but fold i
    n, others = len(folds), 1.0 - np.eye(len(folds))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.sqrt(after.sum() / before.sum())
        without_one = np.sqrt((others @ after) / (others @ before))
        values = n * ratio - (n - 1) * without_one
        variance = ((values - values.mean()) ** 2).sum() / np.float64(n * (n - 1))
        half_width = stdtrit(n - 1, 0.975) * np.sqrt(variance)
    # not finite with fewer than two folds, or without any error
    if not np.isfinite(half_width):
        return [0.0, np.inf]
    return [float(max(ratio - half_width, 0.0)), float(ratio + half_width)]


def cut_folds(fold_of_row, change):
    """Return masks of the folds, after folds with much change are cut into several.

    A fold with m times the mean change of all folds is cut into m consecutive folds of equal
    change. In a warm-up, for example, the first fold has nearly all of the change, but a jackknife
    needs several folds in which the errors change.

    Parameters
    ----------
    fold_of_row : ndarray, shape (n,)
        Fold of each of n residuals, in order of time.
    change : ndarray, shape (n,)
        Squared change of the held-out error of each residual by an effect.

    Returns
    -------
    ndarray, shape (folds, n) of bool
        For each fold after the cuts, a mask of its residuals.
    """
    new_fold, first, folds = np.empty(len(fold_of_row), dtype=int), 0, np.unique(fold_of_row)
    for fold in folds:
        rows = fold_of_row == fold
        in_fold = change[rows]
        # the small terms keep rounding errors from changing the count and the place of a cut
        count = max(1, int(len(folds) * in_fold.sum() / max(change.sum(), 1e-300) + 1e-6))
        share = (np.cumsum(in_fold) - in_fold / 2) / max(in_fold.sum(), 1e-300)
        new_fold[rows] = first + np.minimum((count * share + 1e-6).astype(int), count - 1)
        first += count
    return new_fold == np.unique(new_fold)[:, None]
