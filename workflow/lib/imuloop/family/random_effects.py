"""Random effects with known errors: ``y_i ~ N(μ, τ² + s_i²)``, several such models at once.

statsmodels has no such model: its MixedLM estimates the errors within a group and takes none that
are known, and its ``stats.meta_analysis`` has neither restricted likelihood nor an interval of τ.
Here both take a few lines of linear algebra.

References
----------
W. Viechtbauer, "Bias and efficiency of meta-analytic variance estimators in the random-effects
model", J. Educ. Behav. Stat. 30 (2005), 261: restricted likelihood errs less than the moments of
DerSimonian and Laird. The same author, "Confidence intervals for the amount of heterogeneity in
meta-analysis", Stat. Med. 26 (2007), 37: the Q-profile, which is exact if the s_i are known.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammaincinv, stdtr

# most steps of the search for τ², and the change of τ², share of the variance of y, that ends it
_STEPS, _CLOSE = 200, 1e-10
# levels of a two-sided interval of 95 %
_ENDS = (0.975, 0.025)


@dataclass(frozen=True)
class RandomEffects:
    """The fit of m models ``y_i ~ N(μ, τ² + s_i²)`` to values y_i of n devices.

    s_i is the standard error of a value, which is known. Each model is fitted to its own choice of
    the devices. All fields are arrays (m,).
    """

    mean: np.ndarray  # μ
    mean_variance: np.ndarray  # variance of μ if τ is the estimate
    variance: np.ndarray  # τ²
    dof: np.ndarray  # degrees of freedom
    information: np.ndarray  # twice the Fisher information of the restricted likelihood on τ²

    def deviation(self, y, squares):
        """Return the deviation of other values from the mean of each model, and its p-value, (m,).

        Takes a value `y` and its variance s², `squares`, for each model, (m,). The deviation is in
        standard deviations of a prediction of y, which include τ, the error of the mean and s. The
        p-value is by Student's t. Its degrees of freedom follow from the error of ``τ² + s²``
        (Satterthwaite), and are `dof` if all s_i are small.
        """
        variance = self.variance + squares
        deviation = (y - self.mean) / np.sqrt(variance + self.mean_variance)
        dof = np.minimum(self.information * variance**2, self.dof)
        return deviation, 2 * stdtr(dof, -np.abs(deviation))


def fit(y, squares, counted=None):
    """Return the RandomEffects of values y of n devices by restricted maximum likelihood.

    The model is ``y_i ~ N(μ, τ² + s_i²)``. The score of the likelihood with respect to τ² is
    ``½ (yᵀ P P y - tr P)`` with ``P = W - W 1 1ᵀ W / Σw``, where W is the diagonal matrix of the
    weights ``w = 1/(τ² + s²)``. Fisher scoring finds its zero; τ² is at least zero.

    Parameters
    ----------
    y, squares : array_like, shape (n,)
        Values and the squares of their known standard errors.
    counted : array_like of bool, shape (m, n), optional
        The devices that each model is fitted to, two or more; by default one model has all devices.
    """
    y, squares = np.asarray(y, dtype=float), np.asarray(squares, dtype=float)
    counted = np.ones((1, len(y)), bool) if counted is None else np.asarray(counted)
    # start of τ² in each model: the variance of the values
    size = np.maximum(np.array([y[devices].var() for devices in counted]), np.finfo(float).tiny)
    variance = size.copy()
    for step in range(_STEPS):
        w = counted / (variance[:, None] + squares)
        # Σw, Σw² and Σw³, from which tr P and tr P P follow
        total, second, third = ((w**k).sum(axis=1) for k in (1, 2, 3))
        mean = w @ y / total
        # P y is the weighted residual
        square = ((w * (y - mean[:, None])) ** 2).sum(axis=1)
        trace = total - second / total
        # tr P P is twice the Fisher information, and the score has the same factor ½
        information = second - 2 * third / total + (second / total) ** 2
        change = (square - trace) / information
        # smaller steps if the search oscillates
        new = np.maximum(variance + change * (1.0 if step < 50 else 0.5), 0.0)
        if (np.abs(new - variance) <= _CLOSE * size).all():
            break
        variance = new
    return RandomEffects(
        mean=mean,
        mean_variance=1 / total,
        variance=variance,
        dof=counted.sum(axis=1) - 1,
        information=information,
    )


def spread_interval(y, squares):
    """Return the 95 % interval of τ by the Q-profile, a pair; its lower end may be zero.

    τ is the standard deviation between devices, ``y_i ~ N(μ, τ² + s_i²)``. With the weighted mean
    μ, ``Q(τ²) = Σ (y_i - μ)²/(τ² + s_i²)`` is χ² with n - 1 degrees of freedom at the true τ, and
    falls with τ. An end of the interval is the τ at which Q is a quantile of χ². Takes the values y
    and their variances s², (n,) each.
    """
    y, squares = np.asarray(y, dtype=float), np.asarray(squares, dtype=float)
    # the sum of squares of y about the mean, and a variance that is zero but for rounding
    total = len(y) * y.var() + np.finfo(float).tiny
    least = np.finfo(float).eps * total

    def excess(variance, quantile):
        """Return Q at the variance τ², minus a quantile of χ²."""
        w = 1 / (variance + squares)
        return (w * (y - w @ y / w.sum()) ** 2).sum() - quantile

    def crossing(level):
        """Return the variance τ² at which Q is the quantile of χ² at a level; 0 if it is less."""
        quantile = 2 * gammaincinv((len(y) - 1) / 2, level)
        if excess(least, quantile) <= 0:
            return 0.0
        # Q(τ²) is at most total/τ², so it is below the quantile from total/quantile on
        return brentq(excess, least, total / quantile + 2 * least, args=(quantile,), xtol=least)

    return tuple(float(np.sqrt(crossing(level))) for level in _ENDS)
