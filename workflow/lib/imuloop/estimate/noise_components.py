"""Sizes of the components of the noise, from the residuals and from prior knowledge."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from imuloop.core.precision import precision
from imuloop.estimate.least_squares import NotConverged

# size of a component, of which a deviation of what was known, or white noise, is one, that is none
TINY = 1e-6
# in standard deviations, how far a size is from what is known of it: to the end of its interval
FARTHEST = 1.96
# steps of the search, and its end: by so much the logarithm of the likelihood may still rise
STEPS, RISE = 100, 1e-9
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
    kind : str
        Kind of residual that it makes larger most.
    """

    covariance: np.ndarray
    size: float = 0.0
    deviation: float = np.inf
    kind: str = ""


def total(fixed, components, sizes):
    """Return the covariance ``Σ = Σ₀ + Σ_k s_k² V_k``, (n, n)."""
    found = np.array(fixed)
    for size, component in zip(sizes, components, strict=True):
        found += size**2 * component.covariance
    return found


def likely_sizes(values, jacobian, fixed, components, start=None):
    """Return the most likely sizes of components, shape (k,), within their prior bounds.

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
    start : ndarray, shape (k,), optional
        Sizes to start from; what is known of them without.

    Raises
    ------
    NotConverged
        If the likelihood still rises by more than `UNSETTLED` after the last step.
    """
    if not components:
        return np.zeros(0)
    likelihood = SizeLikelihood(jacobian, fixed, components)
    return likelihood.maximised(values, likelihood.projection(start))


@dataclass(frozen=True)
class Projection:
    """What the likelihood of some sizes has that depends on no residual."""

    squares: np.ndarray  # (k,): of the sizes
    matrix: np.ndarray  # (n, n): P
    log_det: float  # (log |Σ| + log |Jᵀ Σ⁻¹ J|)/2
    trace: np.ndarray  # (k,): of P V_k


class SizeLikelihood:
    """The restricted likelihood of the sizes of components, whatever the residuals r are.

    With ``P = Σ⁻¹ - Σ⁻¹ J (Jᵀ Σ⁻¹ J)⁻¹ Jᵀ Σ⁻¹`` and the normal probability of what was known:

        -(log |Σ| + log |Jᵀ Σ⁻¹ J| + rᵀ P r)/2 - Σ_k (s_k - s_k0)²/2σ_k²

    Takes J, (n, p), Σ₀, (n, n), and at least one Component.

    References
    ----------
    Patterson & Thompson, Biometrika 58 (1971) 545; Gilmour, Thompson & Cullis, Biometrics 51 (1995)
    1440.
    """

    def __init__(self, jacobian, fixed, components):
        self.sizes = np.array([c.size for c in components])
        self.deviations = np.array([c.deviation for c in components])
        self.weight = self.deviations**-2.0
        self.most = (self.sizes + FARTHEST * self.deviations) ** 2
        length = np.linalg.norm(jacobian, axis=0)
        self.jacobian, self.fixed = jacobian / np.where(length > 0, length, 1.0), fixed
        # (k, n²): sums over all components are one product
        self.covariances = np.reshape([c.covariance for c in components], (len(components), -1))

    def projection(self, sizes=None):
        """Return the Projection at sizes within the bounds, by default at what is known of them."""
        if sizes is None:
            some = 0.3 * np.minimum(self.deviations, 1.0)
            sizes = np.where(self.sizes > 0, self.sizes, some)
        return self._projection(sizes**2)

    def _projection(self, squares):
        n, squares = len(self.fixed), np.clip(squares, TINY**2, self.most)
        inverse, root = precision(self.fixed + (squares @ self.covariances).reshape(n, n))
        q, r = np.linalg.qr(solve_triangular(root, self.jacobian, lower=True))
        back = solve_triangular(root, q, lower=True, trans=1)
        matrix = inverse - back @ back.T
        log_det = np.log(np.diag(root)).sum() + np.log(np.abs(np.diag(r))).sum()
        return Projection(squares, matrix, log_det, self.covariances @ matrix.ravel())

    def _state(self, values, at):
        """Return the loss, its slope and the average information in the squares."""
        n, sizes = len(values), np.sqrt(at.squares)
        left, off = at.matrix @ values, sizes - self.sizes
        square = values @ left
        loss = at.log_det + (square + self.weight @ off**2) / 2
        moved = (self.covariances.reshape(-1, n) @ left).reshape(-1, n)
        slope = (at.trace - moved @ left + self.weight * off / sizes) / 2
        # but where a bound leaves them larger
        free = np.all(at.squares < self.most)
        excess = max(1.0, square / (n - self.jacobian.shape[1])) if free else 1.0
        information = moved @ at.matrix @ moved.T / (2 * excess)
        known = self.weight * self.sizes / (4 * sizes**3)
        return loss, slope, information + np.diag(known + 1e-12 * at.trace**2)

    def maximised(self, values, start, rise=RISE):
        """Return the most likely sizes, shape (k,), for residuals, (n,).

        By Newton's steps from a Projection in the squares of the sizes, within the bounds, with the
        average information ``rᵀ P V_k P V_l P r/2``, damped until it rises. Residuals that are
        larger than the noise by a factor have as many times the information that they will have,
        and are divided by it. Raises NotConverged as `likely_sizes`.
        """
        at, damping = start, 1e-3
        loss, slope, information = self._state(values, at)
        for _ in range(STEPS):
            # the lowest point of the parabola within the bounds
            root = np.linalg.cholesky(information + damping * np.diag(np.diag(information))).T
            target = solve_triangular(root, -slope, trans=1)
            bounds = TINY**2 - at.squares, self.most - at.squares
            step = lsq_linear(root, target, bounds, method="bvls").x
            if -slope @ step < rise:
                break
            tried = self._projection(at.squares + step)
            found = self._state(values, tried)
            if found[0] <= loss + 1e-12 * abs(loss):
                at, (loss, slope, information), damping = tried, found, damping / 10
            else:
                damping *= 10
        else:
            if -slope @ step > UNSETTLED:
                raise NotConverged(f"the size of the noise is not found in {STEPS} steps")
        return np.where(at.squares > 1.01 * TINY**2, np.sqrt(at.squares), 0.0)
