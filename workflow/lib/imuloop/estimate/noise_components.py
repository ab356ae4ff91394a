"""Variance components of the noise: their sizes from the residuals and from prior knowledge."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from imuloop.core.precision import precision
from imuloop.estimate.least_squares import NotConverged

# least size of a component; a size at this bound is returned as zero
TINY = 1e-6
# largest distance of a size from its prior value, in prior standard deviations: the end of the
# prior's 95 % interval
FARTHEST = 1.96
# most steps of the search, and the rise of the log likelihood in a step at which the search ends
STEPS, RISE = 100, 1e-9
# largest rise of the log likelihood in the last step that does not change the weights noticeably
UNSETTLED = 1e-3


@dataclass(frozen=True)
class Component:
    """A variance component: noise with a covariance of known shape whose size has to be estimated.

    Attributes
    ----------
    covariance : ndarray, shape (n, n)
        Covariance of the n residuals by a component of size one. The size is a factor on the
        standard deviation, so the covariance grows with its square.
    size, deviation : float
        Prior value of the size, and its standard deviation: infinite without a prior.
    kind : str
        Kind of residual that the component contributes to most.
    """

    covariance: np.ndarray
    size: float = 0.0
    deviation: float = np.inf
    kind: str = ""


def total_covariance(fixed, components, sizes):
    """Return the covariance of n residuals by all noise, (n, n): ``Σ = Σ₀ + Σ_k s_k² V_k``.

    `fixed` is Σ₀, (n, n), the covariance by noise of known size. `components` are the Components:
    component k has the covariance V_k, (n, n), at size one. `sizes` are the sizes s_k.
    """
    parts = (size**2 * c.covariance for size, c in zip(sizes, components, strict=True))
    return sum(parts, start=fixed)


def likely_sizes(values, jacobian, fixed, components, start=None):
    """Return the most likely sizes of k variance components of the noise, (k,).

    A size is a factor on the standard deviation of the component. The likeliest size is sought from
    zero to `FARTHEST` (1.96) prior standard deviations above its prior value. Without a prior there
    is no upper bound. The most likely size may be zero.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Residuals r.
    jacobian : ndarray, shape (n, p)
        Derivative J of the residuals with respect to the p parameters that the same data determine.
    fixed : ndarray, shape (n, n)
        Covariance Σ₀ of the noise whose size is known.
    components : sequence of Component
        The k components, each with its covariance at size one and the prior of its size.
    start : ndarray, shape (k,), optional
        Sizes to start from; by default the prior values, or small sizes where these are zero.

    Raises
    ------
    NotConverged
        If the log likelihood still rises by more than `UNSETTLED` in the last step.
    """
    if not components:
        return np.zeros(0)
    return SizeLikelihood(jacobian, fixed, components).maximise(values, start)


class SizeLikelihood:
    """The restricted likelihood of the sizes of k variance components.

    The logarithm of likelihood times prior is

        -(log |Σ| + log |Jᵀ Σ⁻¹ J| + rᵀ P r)/2 - Σ_k (s_k - s_k0)²/2σ_k²

    with ``P = Σ⁻¹ - Σ⁻¹ J (Jᵀ Σ⁻¹ J)⁻¹ Jᵀ Σ⁻¹``. r are the residuals and J their derivative with
    respect to the parameters. The covariance of r is ``Σ = Σ₀ + Σ_k s_k² V_k``: component k has the
    covariance V_k, the size s_k, and the prior value s_k0 with the standard deviation σ_k.

    Parameters
    ----------
    jacobian : ndarray, shape (n, p)
        The Jacobian J of the residuals.
    fixed : ndarray, shape (n, n)
        The covariance Σ₀ by the noise of known size.
    components : sequence of Component
        The k components, at least one.

    References
    ----------
    Patterson & Thompson, Biometrika 58 (1971) 545; Gilmour, Thompson & Cullis, Biometrics 51 (1995)
    1440.
    """

    def __init__(self, jacobian, fixed, components):
        """Store the parts of the covariance of the n residuals, and the prior of the k sizes.

        `fixed`, (n, n), is the covariance by noise of known size, `components` are the k
        Components. The columns of `jacobian`, (n, p), are scaled to length one, which limits
        rounding errors. A size may be up to `FARTHEST` standard deviations above its prior value.
        """
        self.components = components
        self.prior_sizes = np.array([c.size for c in components])
        self.deviations = np.array([c.deviation for c in components])
        self.weight = self.deviations**-2.0
        self.largest_squares = (self.prior_sizes + FARTHEST * self.deviations) ** 2
        length = np.linalg.norm(jacobian, axis=0)
        self.jacobian, self.fixed = jacobian / np.where(length > 0, length, 1.0), fixed
        # (k, n²): in this shape a sum over all components is one matrix product
        self.covariances = np.reshape([c.covariance for c in components], (len(components), -1))

    def covariance(self, squares):
        """Return the covariance Σ of the n residuals, (n, n), for given sizes of the components.

        `squares`, (k,), are the squares of the sizes.
        """
        return self.fixed + (squares @ self.covariances).reshape(self.fixed.shape)

    def terms(self, values, squares):
        """Return minus the log of likelihood times prior, its gradient and its information.

        The first is a float, which the search for the sizes minimises. The gradient, (k,), has its
        derivatives with respect to the squares of the sizes of the k components. The average
        information, (k, k), stands for the second derivatives; `maximise` says how it is computed.

        Parameters
        ----------
        values : ndarray, shape (n,)
            Residuals r.
        squares : ndarray, shape (k,)
            Squares of the sizes, within their bounds.
        """
        inverse, root = precision(self.covariance(squares))
        q, r = np.linalg.qr(solve_triangular(root, self.jacobian, lower=True))
        back = solve_triangular(root, q, lower=True, trans=1)
        # P = Σ⁻¹ - Σ⁻¹ J (Jᵀ Σ⁻¹ J)⁻¹ Jᵀ Σ⁻¹, and the trace of P V_k for each component
        P = inverse - back @ back.T
        trace = self.covariances @ P.ravel()
        log_det = np.log(np.diag(root)).sum() + np.log(np.abs(np.diag(r))).sum()
        n, sizes = len(values), np.sqrt(squares)
        weighted, change = P @ values, sizes - self.prior_sizes
        chi2 = values @ weighted
        loss = log_det + (chi2 + self.weight @ change**2) / 2
        products = (self.covariances.reshape(-1, n) @ weighted).reshape(-1, n)
        gradient = (trace - products @ weighted + self.weight * change / sizes) / 2
        # at an upper bound the residuals may stay too large: the information is not scaled then
        within = np.all(squares < self.largest_squares)
        excess = max(1.0, chi2 / (n - self.jacobian.shape[1])) if within else 1.0
        information = products @ P @ products.T / (2 * excess)
        # second derivative of the prior's term with respect to s²
        of_prior = self.weight * self.prior_sizes / (4 * sizes**3)
        # the small term keeps the matrix positive definite
        return loss, gradient, information + np.diag(of_prior + 1e-12 * trace**2)

    def maximise(self, values, start=None, rise=RISE):
        """Return the most likely sizes, (k,), of the k components for n residuals.

        The search takes Newton steps in the squares of the sizes, within the bounds. The second
        derivative in a step is the average information ``rᵀ P V_k P V_l P r/2`` of components k and
        l, with ``P = Σ⁻¹ - Σ⁻¹ J (Jᵀ Σ⁻¹ J)⁻¹ Jᵀ Σ⁻¹``. V_k is the covariance by component k at
        size one. The information is divided by the reduced χ² if that is above one, because the
        information falls by this factor once the sizes have grown. Exception: while a size is at
        its upper bound, the residuals may stay larger than the noise, and the information is not
        divided. Each step is damped until the likelihood rises.

        Parameters
        ----------
        values : ndarray, shape (n,)
            Residuals r.
        start : ndarray, shape (k,), optional
            Sizes to start from. By default these are the prior values, and a small size if the
            prior value is zero.
        rise : float
            The search ends when the log likelihood rises by less than this.

        Raises
        ------
        NotConverged
            If the likelihood still rises by more than `UNSETTLED` after the last step.
        """
        if start is None:
            # a component with the prior value zero starts from a small size, off its bound
            small = 0.3 * np.minimum(self.deviations, 1.0)
            start = np.where(self.prior_sizes > 0, self.prior_sizes, small)
        least, damping = TINY**2, 1e-3
        squares = np.clip(start**2, least, self.largest_squares)
        loss, gradient, information = self.terms(values, squares)
        for _ in range(STEPS):
            damped = information + damping * np.diag(np.diag(information))
            step = bounded_step(damped, gradient, least - squares, self.largest_squares - squares)
            if -gradient @ step < rise:
                break
            trial = np.clip(squares + step, least, self.largest_squares)
            terms = self.terms(values, trial)
            if terms[0] <= loss + 1e-12 * abs(loss):
                squares, (loss, gradient, information), damping = trial, terms, damping / 10
            else:
                damping *= 10
        else:
            if -gradient @ step > UNSETTLED:
                raise NotConverged(f"the size of the noise is not found in {STEPS} steps")
        # a size at the least bound is zero
        return np.where(squares > 1.01 * least, np.sqrt(squares), 0.0)


def bounded_step(hessian, gradient, low, high):
    """Return the step s, (k,), between `low` and `high`, with the smallest ``gᵀ s + sᵀ H s/2``.

    It is a Newton step with bounds: g is the `gradient`, (k,), and H the `hessian`, (k, k),
    positive definite. `low` and `high`, (k,), may be infinite. The method fixes some components of
    s at a bound and solves for the others. Then it fixes all components that are beyond a bound,
    and frees those that the gradient pushes off their bound. This is repeated until the fixed
    components no longer change, or `STEPS` times. In the latter case the last s is clipped to its
    bounds.

    References
    ----------
    Hintermüller, Ito, Kunisch, SIAM J. Optim. 13 (2002) 865.
    """
    # -1 at the lower bound, 1 at the upper one, 0 between
    side = np.zeros(len(gradient), dtype=int)
    for _ in range(STEPS):
        step = np.choose(side + 1, [low, np.zeros_like(low), high])
        free, slope = side == 0, gradient + hessian @ step
        step[free] -= np.linalg.solve(hessian[np.ix_(free, free)], slope[free])
        slope, last = gradient + hessian @ step, side
        at_low = (step < low) | ((last < 0) & (slope > 0))
        side = ((step > high) | ((last > 0) & (slope < 0))).astype(int) - at_low
        if np.array_equal(side, last):
            break
    return np.clip(step, low, high)
