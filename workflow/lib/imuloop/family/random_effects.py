"""Random effects with known errors, ``y_i ~ N(μ, τ² + s_i²)``: mean and spread of devices.

y_i is the value of device i, s_i its known standard error, μ the mean of the type, and τ the
standard deviation between devices.

statsmodels has no such model: its MixedLM cannot take known errors, and its
``stats.meta_analysis`` has neither restricted likelihood nor an interval of τ.

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
    """The fits of m models ``y_i ~ N(μ, τ² + s_i²)`` to the values y_i of devices.

    μ is the mean of the devices, τ the standard deviation between them, and s_i the known standard
    error of a value. Each model is fitted to its own choice of the devices. All fields have the
    shape (m,).
    """

    mean: np.ndarray  # μ
    mean_variance: np.ndarray  # variance of the estimate of μ, with τ as estimated
    variance: np.ndarray  # τ²
    dof: np.ndarray  # degrees of freedom
    information: np.ndarray  # twice the Fisher information of the restricted likelihood on τ²

    def deviation(self, y, squares):
        """Return the deviation of a further value from each of m models, and its p-value.

        Both have the shape (m,). `y` has a value for each model, (m,), and `squares` its variance
        s², (m,). The deviation is ``(y - μ)/√(τ² + s² + var(μ))``, with the mean μ and the spread τ
        of the model. The p-value is by Student's t, whose degrees of freedom follow from the error
        of ``τ² + s²`` (Satterthwaite) and are `dof` at most.
        """
        variance = self.variance + squares
        deviation = (y - self.mean) / np.sqrt(variance + self.mean_variance)
        dof = np.minimum(self.information * variance**2, self.dof)
        return deviation, 2 * stdtr(dof, -np.abs(deviation))


def fit(y, squares, counted=None):
    """Return the RandomEffects of the values of n devices by restricted maximum likelihood.

    The model is ``y_i ~ N(μ, τ² + s_i²)``, with the mean μ, the spread τ between devices, and the
    known error s_i of each device. The derivative of the log-likelihood by τ² (score) is ``½ (yᵀ P
    P y - tr P)`` with ``P = W - W 1 1ᵀ W / Σw``, where W is the diagonal matrix of the weights ``w
    = 1/(τ² + s²)``. Fisher scoring finds its zero; τ² is at least zero.

    Parameters
    ----------
    y, squares : array_like, shape (n,)
        Values, and the squares s² of their known standard errors.
    counted : array_like of bool, shape (m, n), optional
        For each of m models the devices that it is fitted to, two or more. By default one model is
        fitted to all devices.
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
    """Return the 95 % interval of τ, the standard deviation between devices, a pair of float.

    The model is ``y_i ~ N(μ, τ² + s_i²)``, with the values `y` of n devices, (n,), and their known
    variances s², `squares`, (n,). With the weighted mean μ, ``Q(τ²) = Σ (y_i - μ)²/(τ² + s_i²)`` is
    χ² with n - 1 degrees of freedom at the true τ, and falls with τ (Q-profile). So each end of the
    interval is the τ at which Q equals a quantile of χ². The lower end may be zero.
    """
    y, squares = np.asarray(y, dtype=float), np.asarray(squares, dtype=float)
    # the sum of squares of y about the mean, and a variance that is zero but for rounding
    total = len(y) * y.var() + np.finfo(float).tiny
    least = np.finfo(float).eps * total

    def excess(variance, quantile):
        """Return Q at τ² = `variance`, minus a `quantile` of χ².

        The variance at which the result is zero is the square of an end of the interval.
        """
        w = 1 / (variance + squares)
        return (w * (y - w @ y / w.sum()) ** 2).sum() - quantile

    def crossing(level):
        """Return the τ² at which Q is the quantile of χ² with the probability `level`.

        The result is 0 if Q is below this quantile even at τ² = 0.
        """
        quantile = 2 * gammaincinv((len(y) - 1) / 2, level)
        if excess(least, quantile) <= 0:
            return 0.0
        # Q(τ²) is at most total/τ², so it is below the quantile from total/quantile on
        return brentq(excess, least, total / quantile + 2 * least, args=(quantile,), xtol=least)

    return tuple(float(np.sqrt(crossing(level))) for level in _ENDS)
