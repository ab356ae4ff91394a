"""The inverse of a covariance."""

import numpy as np
from scipy.linalg import cholesky
from scipy.linalg.lapack import dpotri


def precision(covariance):
    """Return the inverse of a covariance, and its lower root.

    Σ⁻¹, exactly symmetric, and L with ``L Lᵀ = Σ``: a third of the work of an inverse that knows
    nothing of symmetry. Raises a LinAlgError if Σ is not positive definite.
    """
    root = cholesky(covariance)
    # of the upper half, which is faster, below which there are zeros
    inverse, _ = dpotri(root)
    inverse = inverse + inverse.T
    np.einsum("ii->i", inverse)[:] /= 2
    return inverse, root.T
