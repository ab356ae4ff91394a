"""Sizes of the components of the noise, from the residuals and from prior knowledge."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, solve_triangular
from scipy.optimize import lsq_linear

from imuloop.calibrate.least_squares import NotConverged
from imuloop.core.precision import precision

# size of a component, of which a deviation of what was known, or white noise, is one, that is none
TINY = 1e-6
# in standard deviations, how far a size is from what is known of it: to the end of its interval
FARTHEST = 1.96
# steps of the search, and its end: by so much the logarithm of the likelihood may still rise; and
# where the noise of drawn data is wanted
STEPS, RISE, ROUGH = 100, 1e-9, 1e-3
# rise after the last step that makes no other weights; beyond it nothing was found
UNSETTLED = 1e-3


@dataclass(frozen=True)
class Component:
    """A component of the noise whose size is not known well.

    Attributes
    ----------
    covariance : ndarray, shape (n, n)
        Of the residuals where the component's standard deviation has size one.
    size, deviation : float
        What is known of the size beforehand, and the standard deviation of that; infinite where
        nothing is known.
    """

    covariance: np.ndarray
    size: float = 0.0
    deviation: float = np.inf

    def padded(self, count):
        """Return the component with more rows, on which it is zero."""
        return Component(np.pad(self.covariance, (0, count)), self.size, self.deviation)


def total(fixed, components, sizes):
    """Return the covariance ``Σ = Σ₀ + Σ_k s_k² V_k``, (n, n)."""
    found = np.array(fixed)
    for size, component in zip(sizes, components, strict=True):
        found += size**2 * component.covariance
    return found


def likely_sizes(values, jacobian, fixed, components, known=None, start=None, rise=RISE):
    """Return the most likely sizes of components, shape (k,), within their prior bounds.

    Maximises, with ``P = Σ⁻¹ - Σ⁻¹ J (Jᵀ Σ⁻¹ J)⁻¹ Jᵀ Σ⁻¹``, the restricted likelihood and the
    normal probability of what was known:

        -(log |Σ| + log |Jᵀ Σ⁻¹ J| + rᵀ P r)/2 - Σ_k (s_k - s_k0)²/2σ_k²

    by Newton's steps in the squares of the sizes, within the bounds, with the average information
    ``rᵀ P V_k P V_l P r/2``, damped until it rises. Residuals that are larger than the noise by a
    factor have as many times the information that they will have, and are divided by it.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Residuals r.
    jacobian : ndarray, shape (n, p)
        J, the derivative with respect to parameters that are fitted too.
    fixed : ndarray, shape (n, n)
        Σ₀, the covariance of what is known.
    components : sequence of Component
        V_k, s_k0 and σ_k.
    known : (ndarray, ndarray), optional
        Rows R, (m, p), of what is known of the parameters, and their residuals of variance one.
    start : ndarray, shape (k,), optional
        Sizes to start from; what is known of them without.
    rise : float, optional
        By how much the logarithm may still rise where the search ends.

    Raises
    ------
    NotConverged
        If the likelihood still rises by more than `UNSETTLED` after the last step.

    References
    ----------
    Patterson & Thompson, Biometrika 58 (1971) 545; Gilmour, Thompson & Cullis, Biometrics 51 (1995)
    1440.
    """
    if not components:
        return np.zeros(0)
    if known is not None and len(known[1]):
        more = len(known[1])
        values, jacobian = np.append(values, known[1]), np.concatenate([jacobian, known[0]])
        fixed = block_diag(fixed, np.eye(more))
        components = [each.padded(more) for each in components]
    sizes = np.array([c.size for c in components])
    deviations = np.array([c.deviation for c in components])
    weight, most = deviations**-2.0, (sizes + FARTHEST * deviations) ** 2
    length = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(length > 0, length, 1.0)
    # (k, n²): sums over all components are one product
    count, n = len(components), len(values)
    every = np.reshape([c.covariance for c in components], (count, n * n))

    def state(squares):
        """Return the loss, its slope and the average information in the squares."""
        inverse, root = precision(fixed + (squares @ every).reshape(n, n))
        white = solve_triangular(root, np.column_stack([values, scaled]), lower=True)
        q, r = np.linalg.qr(white[:, 1:])
        rest = white[:, 0] - q @ (q.T @ white[:, 0])
        back = solve_triangular(root, np.column_stack([rest, q]), lower=True, trans=1)
        left, projected = back[:, 0], inverse - back[:, 1:] @ back[:, 1:].T
        loss = np.log(np.diag(root)).sum() + np.log(np.abs(np.diag(r))).sum() + rest @ rest / 2
        own = np.sqrt(squares)
        loss += (own - sizes) @ (weight * (own - sizes)) / 2
        moved = (every.reshape(count * n, n) @ left).reshape(count, n)
        trace = every @ projected.ravel()
        slope = (trace - moved @ left + weight * (1 - sizes / own)) / 2
        # but where a bound leaves them larger
        free = np.all(squares < most)
        excess = max(1.0, rest @ rest / (n - jacobian.shape[1])) if free else 1.0
        information = moved @ projected @ moved.T / (2 * excess)
        information += np.diag(weight * sizes / (4 * own**3) + 1e-12 * trace**2)
        return loss, slope, information

    first = np.where(sizes > 0, sizes, 0.3 * np.minimum(deviations, 1.0))
    squares = (first if start is None else start) ** 2
    squares = np.clip(squares, TINY**2, most)
    (loss, slope, information), damping = state(squares), 1e-3
    for _ in range(STEPS):
        # the lowest point of the parabola within the bounds
        root = np.linalg.cholesky(information + damping * np.diag(np.diag(information))).T
        target = solve_triangular(root, -slope, trans=1)
        step = lsq_linear(root, target, (TINY**2 - squares, most - squares), method="bvls").x
        if -slope @ step < rise:
            break
        tried = np.clip(squares + step, TINY**2, most)
        found = state(tried)
        if found[0] <= loss + 1e-12 * abs(loss):
            squares, (loss, slope, information), damping = tried, found, damping / 10
        else:
            damping *= 10
    else:
        if -slope @ step > UNSETTLED:
            raise NotConverged(f"the size of the noise is not found in {STEPS} steps")
    return np.where(squares > 1.01 * TINY**2, np.sqrt(squares), 0.0)
