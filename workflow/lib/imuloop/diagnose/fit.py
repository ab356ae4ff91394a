"""Least squares of one axis under every hypothesis about the noise."""

from dataclasses import dataclass

import numpy as np
from scipy.special import softmax


@dataclass(frozen=True)
class Fit:
    """Least squares of one axis under every hypothesis.

    Attributes
    ----------
    theta : ndarray, shape (h, k)
        Parameters.
    inverse : ndarray, shape (h, k, k)
        Their covariance where the noise has the size of the hypothesis.
    square : ndarray, shape (h,)
        χ² of the residual; (h, m) of m records at once.
    log_weight : ndarray, shape (h,) or (h, m)
        Logarithm of restricted likelihood times prior.
    dof : int
        Degrees of freedom.
    least : ndarray, shape (h,)
        Least size of the noise's variance.
    """

    theta: np.ndarray
    inverse: np.ndarray
    square: np.ndarray
    log_weight: np.ndarray
    dof: int
    least: np.ndarray

    @property
    def scale(self):
        """Variance of the noise, relative to that of each hypothesis, shape (h,) or (h, m)."""
        # a hypothesis after the other, whatever the number of records
        return np.maximum(self.least, self.square.T / self.dof).T

    @property
    def spent(self):
        """What the residuals take from the logarithm of the weight, shape (h,) or (h, m)."""
        return (self.dof * np.log(self.scale) + self.square / self.scale) / 2

    @property
    def covariance(self):
        """Covariance of the parameters, shape (h, k, k)."""
        return self.inverse * self.scale[:, None, None]

    @property
    def weight(self):
        """Share of each hypothesis, summing to 1."""
        return softmax(self.log_weight, axis=-1)

    def averaged(self, weight):
        """Return the parameters, and their covariance, averaged over the noise by weights, (h,)."""
        values = weight @ self.theta
        off = self.theta - values
        spread = self.covariance + off[:, :, None] * off[:, None]
        return values, np.einsum("h,hpq->pq", weight, spread)
