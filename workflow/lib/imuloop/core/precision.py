"""The inverse of a covariance matrix."""

import numpy as np
from scipy.linalg import cholesky
from scipy.linalg.lapack import dpotri


def precision(covariance):
    """Return the inverse of a covariance Σ, (n, n), and the lower root L of Σ, (n, n).

    `covariance` is Σ, (n, n). L is its Cholesky factor, ``L Lᵀ = Σ``. The inverse is exactly
    symmetric, and takes a third of the time of a general inverse. Raises a LinAlgError if Σ is not
    positive definite.
    """
    # scipy computes the upper root faster; `dpotri` returns the upper triangle of the inverse, and
    # zeros below
    upper_root = cholesky(covariance)
    upper, _ = dpotri(upper_root)
    return upper + np.triu(upper, 1).T, upper_root.T
