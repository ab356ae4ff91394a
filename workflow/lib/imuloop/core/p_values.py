"""P-values of several tests, adjusted for their number."""

import numpy as np


def holm(p_values):
    """Return m p-values, (m,), adjusted for the number of tests by Holm's method.

    `p_values`, (m,), are the p-values of m tests, and the result has their order. If the tests
    whose adjusted p-value is below α are called significant, the probability that any of them is so
    by chance is at most α. The k-th smallest p-value is multiplied by m + 1 - k. Then it is raised
    to the adjusted value of the next smaller one, if that is larger, and lowered to 1 if it is
    larger than 1.

    References
    ----------
    S. Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Stat. 6 (1979).
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    return np.minimum(adjusted, 1.0)
