"""P-values of several tests together."""

import numpy as np


def holm(p_values):
    """Return p-values, (m,), that are adjusted for a family of m tests by Holm's method.

    The k-th smallest p-value is multiplied by m + 1 - k; none is less than a smaller one, or more
    than 1.

    References
    ----------
    S. Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Stat. 6 (1979).
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    return np.minimum(adjusted, 1.0)
