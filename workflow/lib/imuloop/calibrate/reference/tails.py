"""The heavy tails of a reference: variances of windows by Student's distribution."""

import numpy as np
from scipy.special import gammaln

# degrees of freedom of Student's distribution that are tried
TAILS = (3.0, 4.0, 6.0, 10.0, 30.0, 1e3)


def spread(values, floor):
    """Return the variance of each of m windows by residuals, (m, 3), not below the noise, (m,).

    Student's distribution of scale² ``floor + e²``: both e and its degrees of freedom ν are those
    of the largest likelihood, and a window's variance is that over its weight ``(ν + 3) / (ν +
    |r|² / scale²)``.

    References
    ----------
    Lange, Little, Taylor, J. Am. Stat. Assoc. 84 (1989) 881.
    """
    square, dof = (values**2).sum(axis=1), np.array(TAILS)[:, None]
    excess = np.full_like(dof, np.median(square) / 3)
    for _ in range(100):
        scale = floor + excess
        weight = (dof + 3) / (dof + square / scale)
        # EM where the excess rules, and its fixed point where it is next to nothing
        excess *= (weight * square / scale**2).sum(axis=1, keepdims=True)
        excess /= (3 / scale).sum(axis=1, keepdims=True)
    scale = floor + excess
    terms = 1.5 * np.log(dof * np.pi * scale) + (dof + 3) / 2 * np.log1p(square / dof / scale)
    terms += gammaln(dof / 2) - gammaln((dof + 3) / 2)
    variance = scale * (dof + square / scale) / (dof + 3)
    return variance[np.argmin(terms.sum(axis=1))]
