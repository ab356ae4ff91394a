"""The least-squares fit of one axis, and the estimates of several axes combined."""

from dataclasses import dataclass

import numpy as np
from scipy.special import softmax


@dataclass(frozen=True)
class ChiSquare:
    """χ² of a least-squares fit under each of h noise hypotheses, and what follows from it.

    A noise hypothesis is one covariance that the noise of the rows may have. An instance may also
    stand for m fits with the same degrees of freedom: then all arrays (h,) are (h, m).
    """

    chi2: np.ndarray  # (h,): χ² of the residuals
    # (h,): log prior of each hypothesis, minus (log |Σ| + log |Jᵀ Σ⁻¹ J|)/2 with the covariance Σ
    # of the rows and the Jacobian J
    log_prior: np.ndarray
    dof: int  # degrees of freedom
    least_scale: float  # lower limit of `scale`

    @property
    def scale(self):
        """Factor s, (h,), by which the fit multiplies the covariance of each noise hypothesis.

        It is the reduced χ², or the lower limit `least_scale` if that is larger.
        """
        return np.maximum(self.least_scale, self.chi2 / self.dof)

    @property
    def loss(self):
        """Term ``(dof log s + χ²/s)/2`` of minus the log likelihood, (h,), with s from `scale`."""
        return (self.dof * np.log(self.scale) + self.chi2 / self.scale) / 2

    @property
    def log_probability(self):
        """Logarithm of restricted likelihood times prior of each noise hypothesis, (h,)."""
        return self.log_prior - self.loss


@dataclass(frozen=True)
class Fit(ChiSquare):
    """Least squares of one axis, under each of h noise hypotheses.

    The fit estimates the coefficients of k columns, the derivatives of the residuals by the
    parameters of effects, each scaled to length one.
    """

    # (h, k, k): normal matrix of the columns, each divided by its norm
    normal: np.ndarray
    norms: np.ndarray  # (h, k): norms of the columns in the metric of the precision
    coefficients: np.ndarray  # (h, k): coefficients of the columns

    @property
    def probability(self):
        """Posterior probability of each noise hypothesis, (h,); the sum is one."""
        return softmax(self.log_probability)

    def average(self):
        """Return the coefficients of the columns, (k,), and their covariance, (k, k).

        Both are averaged over the noise hypotheses, each weighted with its posterior probability.
        The covariance includes the scatter of the coefficients between hypotheses.
        """
        mean = self.probability @ self.coefficients
        change = self.coefficients - mean
        # `normal` has columns of length one, so its inverse is scaled back
        inverse = np.linalg.inv(self.normal) / self.norms[:, :, None] / self.norms[:, None]
        squares = inverse * self.scale[:, None, None] + change[:, :, None] * change[:, None]
        return mean, np.einsum("h,hpq->pq", self.probability, squares)


def scaled_inverse(matrix):
    """Return the inverse, (p, p), of a positive definite matrix, (p, p).

    It is computed from the matrix scaled to ones on the diagonal, as parameters of different units
    would make it ill-conditioned.
    """
    size = np.sqrt(np.diag(matrix))
    return np.linalg.inv(matrix / np.outer(size, size)) / np.outer(size, size)


def combined_axes(count, estimates):
    """Combine the estimates of p parameters from several axes.

    Each axis a has estimates θ_a of some of the parameters, with the covariance C_a. Parameters
    that several axes estimate are averaged with the weights C_a⁻¹: ``C = (Σ C_a⁻¹)⁻¹`` and
    ``θ = C Σ C_a⁻¹ θ_a``. Parameters that no axis estimates are zero.

    Parameters
    ----------
    count : int
        The number p of parameters.
    estimates : list of (index, ndarray, ndarray)
        For each axis the indices of its parameters, their values θ_a and their covariance C_a.

    Returns
    -------
    ndarray, shape (p,), and ndarray, shape (p, p)
        The values θ and their covariance C.
    """
    values, covariance = np.zeros(count), np.zeros((count, count))
    for index, axis_values, axis_covariance in estimates:
        values[index], covariance[np.ix_(index, index)] = axis_values, axis_covariance
    # if no parameter is estimated twice, nothing has to be averaged
    indices = np.concatenate([np.zeros(0, int), *(index for index, _, _ in estimates)])
    # an axis that never changes has estimates of variance zero, which cannot be averaged
    estimates = [e for e in estimates if np.all(np.diag(e[2]) > 0)]
    if len(np.unique(indices)) == len(indices) or not estimates:
        return values, covariance
    precision, moment = np.zeros((count, count)), np.zeros(count)
    for index, axis_values, axis_covariance in estimates:
        inverse = scaled_inverse(axis_covariance)
        precision[np.ix_(index, index)] += inverse
        moment[index] += inverse @ axis_values
    index = np.flatnonzero(np.diag(precision))
    block = np.ix_(index, index)
    covariance[block] = scaled_inverse(precision[block])
    values[index] = covariance[block] @ moment[index]
    return values, covariance
