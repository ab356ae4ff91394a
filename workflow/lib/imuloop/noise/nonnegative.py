"""Non-negative least squares of few unknowns, from their normal equations."""

from math import inf
from operator import itemgetter, mul

import numpy as np

# a gradient of such a share of the moments is rounding
ROUNDING = 1e-12
# what is left of a column of size 1, below which it is rounding
SINGULAR = 1e-14


def nonnegative(gram, moment, likely=None):
    """Return the vector without a negative element that minimises x^T G x / 2 - m^T x.

    The active-set method of Lawson and Hanson, but that a likely set is tried at first.

    Parameters
    ----------
    gram : ndarray, shape (p, p)
        A^T A for least squares of A x to b.
    moment : ndarray, shape (p,)
        A^T b.
    likely : ndarray of bool, shape (p,), optional
        Where x is expected to be positive; everywhere by default.

    Returns
    -------
    ndarray, shape (p,)

    References
    ----------
    C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, Prentice-Hall 1974, chapter 23.
    """
    n, size = len(moment), np.sqrt(gram.diagonal())
    # equal sizes, so that no unknown is lost to rounding; of so few, Python's own numbers are
    # several times faster than arrays
    gram, moment = (gram / size / size[:, None]).tolist(), (moment / size).tolist()
    least = ROUNDING * max(map(abs, moment), default=0.0)
    used = list(range(n)) if likely is None else [i for i in range(n) if likely[i]]
    if used:
        x = _solved(gram, moment, used)
        if min(x) >= 0 and all(g <= least for _, g in _gradient(gram, moment, x, used)):
            return np.array(x) / size
    x, used = [0.0] * n, []
    for _ in range(3 * n):
        best, steepest = max(_gradient(gram, moment, x, used), key=itemgetter(1), default=(0, 0.0))
        if steepest <= least:
            break
        used.append(best)
        while used:
            trial = _solved(gram, moment, used)
            # how far towards it each stays positive
            ways = [
                x[i] / (x[i] - trial[i]) if trial[i] <= 0 < x[i] else float(trial[i] > 0) * 2
                for i in used
            ]
            way = min(ways)
            for i, each in zip(used, ways, strict=True):
                x[i] = 0.0 if each == way < 1 else x[i] + min(way, 1.0) * (trial[i] - x[i])
            if way > 1:
                break
            used = [i for i, each in zip(used, ways, strict=True) if each > way]
    return np.array(x) / size


def _gradient(gram, moment, x, used):
    """Return the unknowns that are not used, each with the gradient there."""
    free = (i for i in range(len(x)) if i not in used)
    return [(i, moment[i] - sum(map(mul, gram[i], x))) for i in free]


def _solved(gram, moment, used):
    """Return x that solves the equations of `used` by elimination, 0 elsewhere."""
    rows = [[*(gram[i][j] for j in used), moment[i]] for i in used]
    for k, row in enumerate(rows):
        # a column that those before it hold whole counts for nothing
        if row[k] < SINGULAR:
            row[k] = inf
        for other in rows[k + 1 :]:
            share = other[k] / row[k]
            for j in range(k + 1, len(row)):
                other[j] -= share * row[j]
    x = [0.0] * len(moment)
    for k in range(len(rows) - 1, -1, -1):
        row = rows[k]
        x[used[k]] = (row[-1] - sum(row[j] * x[used[j]] for j in range(k + 1, len(rows)))) / row[k]
    return x
