"""How large the parts of the noise are, by the residuals and by what was known of them before."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

# size of a part, of which a deviation of what was known, or white noise, is one, that is none
TINY = 1e-6


@dataclass(frozen=True)
class Part:
    """A part of the noise whose size is not known well.

    Attributes
    ----------
    covariance : ndarray, shape (n, n)
        Of the residuals where its standard deviation has size one.
    size, deviation : float
        What is known of the size beforehand, and the standard deviation of that; infinite where
        nothing is known.
    """

    covariance: np.ndarray
    size: float = 0.0
    deviation: float = np.inf


def total(fixed, parts, sizes):
    """Return the covariance ``Σ = Σ₀ + Σ_k s_k² V_k``, (n, n)."""
    return fixed + sum((s * s * p.covariance for s, p in zip(sizes, parts, strict=True)), 0.0)


def likely_sizes(values, jacobian, fixed, parts, start=None):
    """Return the sizes of the parts that are likeliest, shape (k,), none negative.

    Maximises, with ``P = Σ⁻¹ - Σ⁻¹ J (Jᵀ Σ⁻¹ J)⁻¹ Jᵀ Σ⁻¹``, the restricted likelihood and the
    normal probability of what was known:

        -(log |Σ| + log |Jᵀ Σ⁻¹ J| + rᵀ P r)/2 - Σ_k (s_k - s_k0)²/2σ_k²

    Parameters
    ----------
    values : ndarray, shape (n,)
        Residuals r.
    jacobian : ndarray, shape (n, p)
        Derivative J with respect to the parameters, which are fitted too.
    fixed : ndarray, shape (n, n)
        Covariance Σ₀ of what is known.
    parts : sequence of Part
        V_k, s_k0 and σ_k.
    start : ndarray, shape (k,), optional
        Sizes that are likely.

    References
    ----------
    Patterson & Thompson, Biometrika 58 (1971) 545.
    """
    # loads for a quarter of a second
    from scipy.optimize import minimize

    if not parts:
        return np.zeros(0)
    known = np.array([p.size for p in parts])
    weight = np.array([p.deviation for p in parts]) ** -2.0
    scaled, every = (
        jacobian / np.linalg.norm(jacobian, axis=0),
        np.array([p.covariance for p in parts]),
    )

    def loss(squares):
        sizes = np.sqrt(squares)
        root = cholesky(fixed + np.tensordot(squares, every, 1), lower=True)
        white = solve_triangular(root, np.column_stack([values, scaled]), lower=True)
        q, r = np.linalg.qr(white[:, 1:])
        rest = white[:, 0] - q @ (q.T @ white[:, 0])
        inverse = solve_triangular(root, np.eye(len(values)), lower=True)
        without = inverse - q @ (q.T @ inverse)
        projected, left = inverse.T @ without, inverse.T @ rest
        slope = np.tensordot(every, projected, 2) - every @ left @ left
        value = np.log(np.diag(root)).sum() + np.log(np.abs(np.diag(r))).sum() + rest @ rest / 2
        off = sizes - known
        return value + off @ (weight * off) / 2, (slope + weight * off / sizes) / 2

    least = 0.3 * np.minimum([p.deviation for p in parts], 1.0)
    start = np.where(known > 0, known, least) if start is None else np.maximum(start, least)
    # in squares, for the slope of a size is none at zero, and a search would stay there
    bounds = [(TINY**2, None)] * len(parts)
    # to the last digits that processors have in common
    close = {"ftol": 1e-15, "gtol": 1e-9}
    found = minimize(loss, start**2, jac=True, method="L-BFGS-B", bounds=bounds, options=close).x
    return np.where(found > TINY**2, np.sqrt(found), 0.0)
