"""Non-negative least squares of few unknowns, from their normal equations."""

from contextlib import suppress

import numpy as np

# a gradient of such a share of the moments is rounding
ROUNDING = 1e-12


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
    if not len(moment):
        return np.zeros(0)
    # equal sizes, so that no unknown is lost to rounding
    size = np.sqrt(gram.diagonal())
    gram, moment = gram / size / size[:, None], moment / size
    least = ROUNDING * np.abs(moment).max()
    # of columns that are one and the same the method below takes the first
    with suppress(np.linalg.LinAlgError):
        if likely is None or likely.all():
            x = np.linalg.solve(gram, moment)
            if x.min() >= 0:
                return x / size
        elif likely.any():
            x = np.zeros(len(moment))
            x[likely] = np.linalg.solve(gram[likely][:, likely], moment[likely])
            if x.min() >= 0 and (moment - gram @ x)[~likely].max() <= least:
                return x / size
    x, used = np.zeros(len(moment)), []
    for _ in range(3 * len(moment)):
        gradient = moment - gram @ x
        gradient[used] = -np.inf
        best = int(gradient.argmax())
        if gradient[best] <= least:
            break
        used.append(best)
        while used:
            trial = np.linalg.solve(gram[np.ix_(used, used)], moment[used])
            # how far towards it each stays positive
            ways = [
                a / (a - b) if b <= 0 < a else float(b > 0) * 2
                for a, b in zip(x[used].tolist(), trial.tolist(), strict=True)
            ]
            way = min(ways)
            x[used] += min(way, 1.0) * (trial - x[used])
            if way > 1:
                break
            x[[i for i, w in zip(used, ways, strict=True) if w == way]] = 0.0
            used = [i for i, w in zip(used, ways, strict=True) if w > way]
    return x / size
