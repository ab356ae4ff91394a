"""The ratio of held-out errors, with an effect to without, and its interval."""

import numpy as np
from scipy.special import stdtrit


def ratio_interval(part_of_row, before, after):
    """Return the 95 % interval of the held-out error after over before, root mean squares.

    `part_of_row`, (n,), is the part that each of the errors, (n, k), was held out with. A part in
    which the prediction changes most is cut into several, see `cut_parts`.
    """
    parts = cut_parts(part_of_row, ((before - after) ** 2).sum(axis=1))
    return jackknife(*((parts @ e**2).sum(axis=1) for e in (before, after))).tolist()


def cut_parts(part_of_row, change):
    """Return the rows of each part, (parts, n), bool, where parts with most of a change are cut.

    A part with several times the mean of the change, (n,), as the first one has with a warm-up, is
    cut into as many: without it the others would show nothing.
    """
    number, last, parts = np.empty(len(part_of_row), dtype=int), 0, np.unique(part_of_row)
    for k in parts:
        rows = part_of_row == k
        own = change[rows]
        # rounding shall not decide
        count = max(1, int(len(parts) * own.sum() / max(change.sum(), 1e-300) + 1e-6))
        share = (np.cumsum(own) - own / 2) / max(own.sum(), 1e-300)
        number[rows] = last + np.minimum((count * share + 1e-6).astype(int), count - 1)
        last += count
    return number == np.unique(number)[:, None]


def jackknife(before, after):
    """Return the lower and upper end of the 95 % interval of a ratio of root mean squares, (2, …).

    The standard error is that of the mean of the ratio's pseudo-values, each from all parts but
    one; Student's t has as many degrees of freedom as there are parts, less one. (The interval of
    the logarithm covers as often, but is far wider where one part has most of what is left, as that
    in which a step happens.) Where no two parts have errors the ratio is between zero and infinity.
    `before` and `after`, (parts, …), are the sums of squares of each part.

    References
    ----------
    J. W. Tukey, Ann. Math. Statist. 29 (1958) 614; B. Efron, R. J. Tibshirani, An Introduction to
    the Bootstrap (1993), chapter 11.
    """
    n = len(before)
    without_one = 1.0 - np.eye(n)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.sqrt(after.sum(axis=0) / before.sum(axis=0))
        others = np.tensordot(without_one, after, 1) / np.tensordot(without_one, before, 1)
        values = n * ratio - (n - 1) * np.sqrt(others)
        square = ((values - values.mean(axis=0)) ** 2).sum(axis=0) / np.float64(n * (n - 1))
        half = stdtrit(n - 1, 0.975) * np.sqrt(square)
    known = np.isfinite(half)
    low = np.where(known, np.maximum(ratio - half, 0.0), 0.0)
    return np.array([low, np.where(known, ratio + half, np.inf)])
