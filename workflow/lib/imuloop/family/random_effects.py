"""Random effects with known errors: ``y_i ~ N(x_i β, τ² + s_i²)``, several of them at once.

statsmodels has no such model: its MixedLM estimates the errors within a group and takes none that
are known, its ``stats.meta_analysis`` has neither restricted likelihood nor an interval of τ. Both
are a few lines of linear algebra here, for which it would be a heavy dependency.

References
----------
W. Viechtbauer, "Bias and efficiency of meta-analytic variance estimators in the random-effects
model", J. Educ. Behav. Stat. 30 (2005), 261: restricted likelihood errs less than the moments of
DerSimonian and Laird. Its "Confidence intervals for the amount of heterogeneity in meta-analysis",
Stat. Med. 26 (2007), 37: the Q-profile, exact where the s_i are known.
G. Knapp, J. Hartung, Stat. Med. 22 (2003), 2693: standard errors of β, for Student's t.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, t

# steps of the search for τ², and the share of the spread of y² that ends it
_STEPS, _CLOSE = 200, 1e-10
# levels of a two-sided interval of 95 %
_ENDS = (0.975, 0.025)


@dataclass(frozen=True)
class RandomEffects:
    """The fit of m models to values of the same n devices; the first axis is that of the models."""

    beta: np.ndarray  # (m, p)
    covariance: np.ndarray  # of beta with τ as estimated, (m, p, p)
    variance: np.ndarray  # τ², (m,)
    scale: np.ndarray  # weighted residual square per degree of freedom, (m,)
    dof: np.ndarray  # degrees of freedom, (m,)
    information: np.ndarray  # of the restricted likelihood on τ², half of it left out, (m,)

    def p_value(self, k):
        """Return the two-sided p-value of ``beta[:, k] = 0``, after Knapp and Hartung, (m,)."""
        std = np.sqrt(self.covariance[:, k, k] * self.scale)
        return 2 * t.sf(np.abs(self.beta[:, k]) / std, self.dof)

    def deviation(self, y, squares):
        """Return how far other values lie from the mean of each model, (m,), and the p-value.

        In standard deviations of a prediction: τ, the error of the mean, the value's own error.
        Student's t has the degrees of freedom of ``τ² + s²`` after Satterthwaite, by the error of
        τ²: as many as the devices have where the s_i are small. Takes one value and its variance
        per model, whose only column is that of ones.
        """
        foreseen = self.variance + squares
        found = (y - self.beta[:, 0]) / np.sqrt(foreseen + self.covariance[:, 0, 0])
        dof = np.minimum(self.information * foreseen**2, self.dof)
        return found, 2 * t.sf(np.abs(found), dof)


def fit(y, squares, design=None, counted=None):
    """Return the RandomEffects of values y by restricted maximum likelihood.

    Fisher scoring on ``½ (yᵀ P P y - tr P)`` with ``P = W - W X (Xᵀ W X)⁻¹ Xᵀ W`` and weights
    ``1/(τ² + s²)``; τ² is no less than zero.

    Parameters
    ----------
    y, squares : array_like, shape (n,)
        Values and the squares of their known standard errors.
    design : array_like, shape (n, p), optional
        Columns of X; one of ones, for the mean, if not given.
    counted : array_like of bool, shape (m, n), optional
        The devices that each model is fitted to, more than p of them; all for one model if not
        given.
    """
    y, squares = np.asarray(y, dtype=float), np.asarray(squares, dtype=float)
    X = np.ones((len(y), 1)) if design is None else np.asarray(design, dtype=float)
    counted = np.ones((1, len(y)), bool) if counted is None else np.asarray(counted)
    dof = counted.sum(axis=1) - X.shape[1]
    products = X[:, :, None] * X[:, None, :]

    def solved(variance):
        w = counted / (variance[:, None] + squares)
        inverse = np.linalg.inv(np.tensordot(w, products, 1))
        beta = np.einsum("mpq,mq->mp", inverse, (w * y) @ X)
        return w, inverse, beta, y - beta @ X.T

    # τ² as if all errors were equal, in the middle of what is possible
    size = np.maximum(np.array([y[own].var() for own in counted]), np.finfo(float).tiny)
    variance = size.copy()
    for step in range(_STEPS):
        w, inverse, beta, left = solved(variance)
        second, third = (inverse @ np.tensordot(w**k, products, 1) for k in (2, 3))
        trace = w.sum(axis=1) - np.trace(second, axis1=1, axis2=2)
        information = (w**2).sum(axis=1) - 2 * np.trace(third, axis1=1, axis2=2)
        information += np.trace(second @ second, axis1=1, axis2=2)
        change = (((w * left) ** 2).sum(axis=1) - trace) / information
        # one that goes to and fro is halved
        moved = np.maximum(variance + change * (1.0 if step < 50 else 0.5), 0.0)
        still = np.abs(moved - variance) <= _CLOSE * size
        if still.all():
            break
        variance = moved
    scale = (w * left**2).sum(axis=1) / dof
    return RandomEffects(beta, inverse, variance, scale, dof, information)


def spread_interval(y, squares):
    """Return the 95 % interval of τ by the Q-profile; of values without a spread it begins at zero.

    ``Q(τ²) = Σ (y_i - μ)²/(τ² + s_i²)``, with the weighted mean μ, is χ² with n - 1 degrees of
    freedom at the true τ, and falls with τ.
    """
    y, squares = np.asarray(y, dtype=float), np.asarray(squares, dtype=float)

    def q(variance):
        w = 1 / (variance + squares)
        return (w * (y - w @ y / w.sum()) ** 2).sum()

    ends, reach = [], len(y) * y.var() + np.finfo(float).tiny
    least = np.finfo(float).eps * reach
    for level in _ENDS:
        wanted = chi2.ppf(level, len(y) - 1)
        if q(least) <= wanted:
            ends.append(0.0)
            continue
        high = reach
        while q(high) > wanted:
            high *= 10
        ends.append(float(np.sqrt(brentq(lambda v, c=wanted: q(v) - c, least, high, xtol=least))))
    return tuple(ends)
