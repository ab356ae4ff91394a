"""Non-negative fit of the five coefficients to an Allan curve, each term tested."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, nnls
from scipy.stats import chi2

from imuloop.core.noise_model import AxisNoise, Coefficient

# columns of the design: Q, N, B, K, R
RAMP = 4
# fewer points cannot carry five terms and a test of the misfit
MIN_POINTS = 8
# decades of tau over which a misfit of the five terms keeps its sign
MISFIT_DECADES = 0.5
# level at which residuals count as misfit
MISFIT_LEVEL = 0.01
# relative rounding of the curve, so that a ramp without noise keeps finite weights
ROUNDING = 1e-9


@dataclass(frozen=True)
class CurveFit:
    """Result of `fit_curve`.

    Attributes
    ----------
    noise : AxisNoise
        The coefficients, tested, with their intervals.
    theta : ndarray, shape (5,)
        Q^2, N^2, B^2, K^2, R^2; 0 where not supported.
    misfit : float
        Relative standard deviation by which the variance leaves the five terms beyond chance;
        0 where chance is enough. It is part of the weights and of all intervals.
    """

    noise: AxisNoise
    theta: np.ndarray
    misfit: float


def design(tau):
    """Return the Allan variance of each term for a unit coefficient, shape (k, 5)."""
    tau = np.asarray(tau, dtype=float)
    flicker = np.full_like(tau, 2 * np.log(2) / np.pi)
    return np.column_stack([3 / tau**2, 1 / tau, flicker, tau / 3, tau**2 / 2])


def fit_curve(tau, variance, covariance, settings):
    r"""Fit Q, N, B, K, R to an Allan curve.

    The variance (not the deviation) is linear in theta = (Q^2, N^2, B^2, K^2, R^2),

    .. math:: \hat\sigma^2 = A \theta + e,\quad \mathrm{cov}(e) = C(\theta) + \epsilon^2 D

    Weights are the inverse of the diagonal, from the model and not from the data, iterated.
    C holds the correlation between the points; D, the correlated misfit of a curve that is no sum
    of five terms, has epsilon = 0 unless the residuals exceed what C allows at 1 %.

    Every estimate is a linear form of the curve, hence a quadratic form of Gaussian data. Its
    distribution is taken as chi-square with the mean and variance of that form (Satterthwaite).
    Inverted, it gives the test against 0, the two-sided 95 % interval and the one-sided limit.
    Terms that fail their test are removed, the ramp first, then the worst; any that then passes
    comes back. Intervals hold for the terms so chosen.

    Parameters
    ----------
    tau : array_like, shape (k,)
        Averaging times, s.
    variance : array_like, shape (k,)
        Overlapping Allan variance, unit of the axis squared.
    covariance : CurveCovariance
        Of the same points.
    settings : NoiseSettings
        Level of the tests.

    Returns
    -------
    CurveFit
        Without any term where the curve has under eight points or is zero.
    """
    variance = np.asarray(variance, dtype=float)
    if len(variance) < MIN_POINTS or not np.all(variance > 0):
        return CurveFit(AxisNoise(), np.zeros(5), 0.0)
    # orders of magnitude apart otherwise: fit the curve relative to itself
    a = design(tau)
    scale = np.array([np.min(variance / column) for column in a.T])
    fit = _Fit(a * scale, variance, covariance, scale, tau)
    support = fit.select(settings.significance)
    theta = fit.estimate(support)[0]
    coefficients = [fit.coefficient(j, support) for j in range(5)]
    return CurveFit(AxisNoise(*coefficients), theta * scale, fit.misfit)


class _Fit:
    """Weights, misfit and tests of one curve; theta in units of `scale`."""

    def __init__(self, a, variance, covariance, scale, tau):
        self.a, self.variance, self.covariance, self.scale = a, variance, covariance, scale
        decades = np.abs(np.subtract.outer(np.log10(tau), np.log10(tau)))
        self.shape = np.exp(-decades / MISFIT_DECADES)
        self.misfit = 0.0
        excess, edf = self._excess(0.0)
        if chi2.sf(excess * edf, edf) < MISFIT_LEVEL:
            self.misfit = brentq(lambda e: self._excess(e)[0] - 1, 1e-6, 1e3, xtol=1e-6)
        theta = self._non_negative(self.misfit)
        self.weight = 1 / np.diag(self._covariance(theta, self.misfit))

    def _covariance(self, theta, misfit):
        model = self.a @ theta
        return (
            self.covariance.matrix(theta * self.scale)
            + misfit**2 * self.shape * model[:, None] * model
            + np.diag((ROUNDING * model) ** 2)
        )

    def _non_negative(self, misfit):
        # start: white noise, whose relative variance grows with tau
        weight = self.a[:, 1] / self.a[0, 1] / self.variance**2
        for _ in range(6):
            root = np.sqrt(weight)
            theta = nnls(self.a * root[:, None], self.variance * root)[0]
            model = self.a @ theta
            diagonal = self.covariance.variance(theta * self.scale)
            diagonal += (misfit**2 + ROUNDING**2) * model**2
            weight = 1 / diagonal
        return theta

    def _excess(self, misfit):
        """Return the weighted sum of squared residuals over its expectation, and its edf."""
        theta = self._non_negative(misfit)
        c = self._covariance(theta, misfit)
        weight = 1 / np.diag(c)
        a = self.a[:, theta > 0]
        residual = np.eye(len(a)) - a @ _solution(a, weight)
        form = weight[:, None] * residual @ c @ residual.T
        expected = np.trace(form)
        found = weight @ (residual @ self.variance) ** 2
        return found / expected, expected**2 / np.trace(form @ form)

    def estimate(self, support):
        """Return theta, its lower part set to 0, and the linear map from the curve to it."""
        linear = np.zeros((5, len(self.variance)))
        linear[support] = _solution(self.a[:, support], self.weight)
        return np.maximum(linear @ self.variance, 0), linear

    def select(self, level):
        """Return the supported terms."""
        support = [int(j) for j in np.flatnonzero(self._non_negative(self.misfit))]
        while len(support) > 1:
            p = [1 - self.probability(j, support, 0.0) for j in support]
            if max(p) <= level:
                break
            # a weak walk and a weak ramp look alike; only the walk enters the covariance
            ramp = support[-1] == RAMP and p[-1] > level
            support.pop(-1 if ramp else int(np.argmax(p)))
        while True:
            others = [j for j in range(5) if j not in support]
            p = [1 - self.probability(j, sorted([*support, j]), 0.0) for j in others]
            if not others or min(p) > level:
                return support
            grown = sorted([*support, others[int(np.argmin(p))]])
            if np.any(self.estimate(grown)[0][grown] <= 0):
                return support
            support = grown

    def probability(self, j, support, value, at_least_zero=False):
        """Return P(estimate <= found) where theta_j = value and the rest is fitted to that."""
        _, linear = self.estimate(support)
        form = linear[j]
        found = form @ self.variance
        if at_least_zero:
            found = max(found, 0.0)
        rest = [i for i in support if i != j]
        truth = np.zeros(5)
        truth[j] = value
        if rest:
            solution = _solution(self.a[:, rest], self.weight)
            truth[rest] = np.maximum(solution @ (self.variance - self.a[:, j] * value), 0)
        # nothing random would be left: what is found beyond that is certain
        if not truth[:RAMP].any():
            return float(found >= value)
        c = self._covariance(truth, self.misfit)
        mean = np.maximum(form, 0) @ (self.a @ truth)
        edf = 2 * mean**2 / (form @ c @ form)
        return chi2.cdf(edf * max(0.0, 1 + (found - value) / mean), edf)

    def coefficient(self, j, support):
        """Return the coefficient of term j, or its upper limit where it is not supported."""
        if j not in support:
            upper = self.limit(j, sorted([*support, j]), 0.05, at_least_zero=True)
            return Coefficient(None, None, upper, False)
        value = np.sqrt(self.estimate(support)[0][j] * self.scale[j])
        low, high, upper = (self.limit(j, support, p) for p in (0.975, 0.025, 0.05))
        return Coefficient(float(value), (low, high), upper, True)

    def limit(self, j, support, probability, at_least_zero=False):
        """Return the coefficient at which an estimate below the one found has `probability`."""

        def excess(value):
            return self.probability(j, support, value, at_least_zero) - probability

        # no term exceeds the curve itself: the bound where the other terms are left too free
        ceiling = self.ceiling(j, probability)
        high = ceiling if at_least_zero else 1e3 * ceiling
        if excess(0.0) <= 0:
            limit = 0.0
        elif excess(high) >= 0:
            limit = ceiling
        else:
            limit = brentq(excess, 0.0, high)
        return float(np.sqrt(limit * self.scale[j]))

    def ceiling(self, j, probability):
        """Return the theta_j that alone leaves the lowest point of the curve `probability`."""
        alone = self.covariance.variance(np.eye(5)[j] * self.scale)
        edf = 2 * self.a[:, j] ** 2 / np.maximum(alone, 1e-9 * self.a[:, j] ** 2)
        return np.min(self.variance / self.a[:, j] * edf / chi2.ppf(probability, edf))


def _solution(a, weight):
    """Return the linear map of weighted least squares, shape (terms, points)."""
    root = np.sqrt(weight)
    return np.linalg.pinv(a * root[:, None]) * root
