"""Random effects with known errors: ``y_i ~ N(μ, τ² + s_i²)``, several of them at once.

statsmodels has no such model: its MixedLM estimates the errors within a group and takes none that
are known, its ``stats.meta_analysis`` has neither restricted likelihood nor an interval of τ. Both
are a few lines of linear algebra here, for which it would be a heavy dependency.

References
----------
W. Viechtbauer, "Bias and efficiency of meta-analytic variance estimators in the random-effects
model", J. Educ. Behav. Stat. 30 (2005), 261: restricted likelihood errs less than the moments of
DerSimonian and Laird. Its "Confidence intervals for the amount of heterogeneity in meta-analysis",
Stat. Med. 26 (2007), 37: the Q-profile, exact where the s_i are known.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammaincinv, stdtr

# steps of the search for τ², and the share of the spread of y² that ends it
_STEPS, _CLOSE = 200, 1e-10
# levels of a two-sided interval of 95 %
_ENDS = (0.975, 0.025)


@dataclass(frozen=True)
class RandomEffects:
    """The fit of m models to values of the same n devices; each array has the shape (m,)."""

    mean: np.ndarray  # μ
    mean_variance: np.ndarray  # variance of μ if τ is the estimate
    variance: np.ndarray  # τ²
    dof: np.ndarray  # degrees of freedom
    information: np.ndarray  # twice the Fisher information of the restricted likelihood on τ²

    def deviation(self, y, squares):
        """Return the deviation of other values from the mean of each model, and its p-value, (m,).

        Takes a value and its variance s² for each model, (m,). The deviation is in standard
        deviations of a prediction, which include τ, the error of the mean and s. The p-value is by
        Student's t, whose degrees of freedom follow from the error of ``τ² + s²`` (Satterthwaite);
        they are n - 1 if all s_i are small.
        """
        foreseen = self.variance + squares
        found = (y - self.mean) / np.sqrt(foreseen + self.mean_variance)
        dof = np.minimum(self.information * foreseen**2, self.dof)
        return found, 2 * stdtr(dof, -np.abs(found))


def fit(y, squares, counted=None):
    """Return the RandomEffects of values y by restricted maximum likelihood.

    Fisher scoring on ``½ (yᵀ P P y - tr P)`` with ``P = W - W 1 1ᵀ W / Σw`` and weights
    ``1/(τ² + s²)``; τ² is no less than zero.

    Parameters
    ----------
    y, squares : array_like, shape (n,)
        Values and the squares of their known standard errors.
    counted : array_like of bool, shape (m, n), optional
        The devices that each model is fitted to, two or more; all for one model if not given.
    """
    y, squares = np.asarray(y, dtype=float), np.asarray(squares, dtype=float)
    counted = np.ones((1, len(y)), bool) if counted is None else np.asarray(counted)
    # start of τ²: the variance of the values
    size = np.maximum(np.array([y[own].var() for own in counted]), np.finfo(float).tiny)
    variance = size.copy()
    for step in range(_STEPS):
        w = counted / (variance[:, None] + squares)
        total, second, third = ((w**k).sum(axis=1) for k in (1, 2, 3))
        mean = w @ y / total
        left = y - mean[:, None]
        trace = total - second / total
        information = second - 2 * third / total + (second / total) ** 2
        change = (((w * left) ** 2).sum(axis=1) - trace) / information
        # smaller steps if the search oscillates
        moved = np.maximum(variance + change * (1.0 if step < 50 else 0.5), 0.0)
        if (np.abs(moved - variance) <= _CLOSE * size).all():
            break
        variance = moved
    return RandomEffects(mean, 1 / total, variance, counted.sum(axis=1) - 1, information)


def spread_interval(y, squares):
    """Return the 95 % interval of τ by the Q-profile; its lower end may be zero.

    ``Q(τ²) = Σ (y_i - μ)²/(τ² + s_i²)``, with the weighted mean μ, is χ² with n - 1 degrees of
    freedom at the true τ, and falls with τ.
    """
    y, squares = np.asarray(y, dtype=float), np.asarray(squares, dtype=float)

    reach = len(y) * y.var() + np.finfo(float).tiny
    least = np.finfo(float).eps * reach

    def excess(variance, wanted):
        w = 1 / (variance + squares)
        return (w * (y - w @ y / w.sum()) ** 2).sum() - wanted

    def crossing(level):
        wanted = 2 * gammaincinv((len(y) - 1) / 2, level)
        if excess(least, wanted) <= 0:
            return 0.0
        # Q is at most reach/τ²
        return brentq(excess, least, reach / wanted + 2 * least, args=(wanted,), xtol=least)

    return tuple(float(np.sqrt(crossing(level))) for level in _ENDS)
