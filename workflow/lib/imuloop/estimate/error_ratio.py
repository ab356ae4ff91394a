"""The ratio of held-out errors, with an effect over without it, and its confidence interval.

A held-out error is the error of the prediction of a residual by a fit to the residuals outside its
fold; a fold has the residuals that are held out together.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit


class ErrorChange(NamedTuple):
    """The held-out errors of n residuals on k axes, without and with an effect in the model."""

    residual_kind: str  # kind of residual that the effect changes most
    before: np.ndarray  # (n, k): held-out errors of that kind without the effect, SI
    after: np.ndarray  # (n, k): held-out errors of that kind with the effect, SI
    ratio: list  # 95 % interval of the root mean square after over before

    @property
    def certain(self):
        """Whether the whole interval of the ratio is below one."""
        return self.ratio[1] < 1


def ratio_interval(fold_of_row, before, after):
    """Return the 95 % interval of the ratio of two root mean square errors, [low, high].

    The standard error is that of the mean of the jackknife's pseudo-values. Each pseudo-value comes
    from the ratio of all folds but one. A fold with m times the mean change of the squared errors
    is cut into m folds before, as a jackknife needs several folds that change. The interval uses
    Student's t, with one degree of freedom less than there are folds. It is zero to infinity if
    fewer than two folds have errors. (An interval of the logarithm has the same coverage, but is
    far wider if one fold has most of the error, as with a step.)

    Parameters
    ----------
    fold_of_row : ndarray, shape (n,)
        Fold of each of n residuals.
    before, after : ndarray, shape (n, k)
        Held-out errors on k axes, without and with an effect. The ratio is after over before.

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
    """Cut the folds in which the error changes most into several folds.

    A fold with m times the mean change of all folds is cut into m consecutive ones of equal change.
    In a warm-up, for example, the first fold has nearly all of the change, and a jackknife needs
    several that have some.

    Parameters
    ----------
    fold_of_row : ndarray, shape (n,)
        Fold of each of n residuals, in order of time.
    change : ndarray, shape (n,)
        Squared change of the held-out error of each residual by an effect.

    Returns
    -------
    ndarray, shape (folds, n) of bool
        The residuals of each fold after the cuts.
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
