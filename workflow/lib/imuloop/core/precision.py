"""The inverse of a covariance."""

import numpy as np
from scipy.linalg import cholesky
from scipy.linalg.lapack import dpotri


def precision(covariance):
    """Return the inverse Σ⁻¹ of a covariance Σ, (n, n), and its lower root L, ``L Lᵀ = Σ``.

    The inverse is exactly symmetric and takes a third of the time of a general inverse. Raises a
    LinAlgError if Σ is not positive definite.
    """
    root = cholesky(covariance)
    # the upper triangle, which is faster to compute; the lower triangle is zero
    inverse, _ = dpotri(root)
    inverse = inverse + inverse.T
    np.einsum("ii->i", inverse)[:] /= 2
    return inverse, root.T
