"""How large the parts of the noise are, by the residuals and by what was known of them before."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from imuloop.core.precision import precision

# size of a part, of which a deviation of what was known, or white noise, is one, that is none
TINY = 1e-6
# and one from which a search still gets away
SMALL = 1e-2
# in standard deviations, how far a size is from what is known of it: to the end of its interval
FARTHEST = 1.96


@dataclass(frozen=True)
class Part:
    """A part of the noise whose size is not known well."""

    covariance: np.ndarray  # (n, n): of the residuals where its standard deviation has size one
    size: float = 0.0  # what is known of it beforehand
    deviation: float = np.inf  # of that, standard; infinite where nothing is known


def total(fixed, parts, sizes):
    """Return the covariance ``Σ = Σ₀ + Σ_k s_k² V_k``, (n, n)."""
    return fixed + sum((s * s * p.covariance for s, p in zip(sizes, parts, strict=True)), 0.0)


def likely_sizes(values, jacobian, fixed, parts):
    """Return the sizes of the parts that are likeliest, shape (k,), none beyond what is known.

    Maximises, with ``P = Σ⁻¹ - Σ⁻¹ J (Jᵀ Σ⁻¹ J)⁻¹ Jᵀ Σ⁻¹``, the restricted likelihood and the
    normal probability of what was known:

        -(log |Σ| + log |Jᵀ Σ⁻¹ J| + rᵀ P r)/2 - Σ_k (s_k - s_k0)²/2σ_k²

    The residuals r are `values`, (n,); J, (n, p), is the derivative with respect to parameters that
    are fitted too; Σ₀, (n, n), the covariance of what is known; V_k, s_k0, σ_k those of the parts.

    References
    ----------
    Patterson & Thompson, Biometrika 58 (1971) 545.
    """
    if not parts:
        return np.zeros(0)
    known = np.array([p.size for p in parts])
    weight = np.array([p.deviation for p in parts]) ** -2.0
    most = np.array([p.size + FARTHEST * p.deviation for p in parts]) ** 2
    scaled = jacobian / np.linalg.norm(jacobian, axis=0)
    every = np.array([p.covariance for p in parts])

    def projected(squares):
        """Return ``P r``, P and what the residuals alone lose by it."""
        inverse, root = precision(fixed + np.tensordot(squares, every, 1))
        white = solve_triangular(root, np.column_stack([values, scaled]), lower=True)
        q, r = np.linalg.qr(white[:, 1:])
        rest = white[:, 0] - q @ (q.T @ white[:, 0])
        size = np.log(np.diag(root)).sum() + np.log(np.abs(np.diag(r))).sum()
        back = solve_triangular(root, np.column_stack([rest, q]), lower=True, trans=1)
        return back[:, 0], inverse - back[:, 1:] @ back[:, 1:].T, size + rest @ rest / 2

    def loss(scaled_squares, unit):
        squares = scaled_squares * unit
        sizes = np.sqrt(squares)
        left, p, value = projected(squares)
        slope = np.tensordot(every, p, 2) - every @ left @ left
        off = sizes - known
        return value + off @ (weight * off) / 2, (slope + weight * off / sizes) / 2 * unit

    def search(squares, unit, **close):
        bounds = list(zip(TINY**2 / unit, most / unit, strict=True))
        what = {"jac": True, "method": "L-BFGS-B", "bounds": bounds, "options": close}
        return minimize(loss, squares / unit, unit, **what).x * unit

    least = 0.3 * np.minimum([p.deviation for p in parts], 1.0)
    # in squares, for the slope of a size is none at zero, and a search would stay there; in wide
    # steps to the right one of several hills
    squares = search(np.where(known > 0, known, least) ** 2, np.ones(len(parts)), ftol=1e-4)
    # then, each square in its standard error, to the last digits that processors have in common
    squares = np.clip(squares, SMALL**2, most)
    _, p, _ = projected(squares)
    information = [np.sum((v @ p) * (v @ p).T) / 2 for v in every]
    unit = 1 / np.sqrt(information + weight / (4 * squares))
    squares = search(squares, unit, ftol=1e-15, gtol=1e-7)
    return np.where(squares > 1.01 * TINY**2, np.sqrt(squares), 0.0)
