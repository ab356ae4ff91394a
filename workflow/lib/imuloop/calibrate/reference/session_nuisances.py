"""Residuals beside a reference, less what each session's own bias and axes take up."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class ReferenceModel:
    """Residuals of m windows, three components each, less what each session's nuisances take up.

    Those are its bias, what is left of the rotation between both bodies, which are put together
    anew, and the tilt of the world's vertical. By weights W,

        r → r - B (Bᵀ W B)⁻¹ Bᵀ W r,     B = ∂r/∂(nuisances),

    and the derivative alike: what is left says nothing of them.
    """

    values: np.ndarray  # (m, 3)
    derivative: np.ndarray  # (m, 3, p)
    nuisance: np.ndarray  # (m, 3, q)
    session: np.ndarray  # (m,)
    weight: np.ndarray  # (m,): inverse variance
    x: np.ndarray

    @cached_property
    def nuisances(self):
        """What each session's nuisances are, (s, q)."""
        return np.array([self._solved(s)[:, 0] for s in range(self.session.max() + 1)])

    def mean_covariance(self, covariance):
        """Return the covariance of the sessions' mean nuisances, (q, q), by that of x, (p, p)."""
        count = self.session.max() + 1
        slope = sum(self._solved(s)[:, 1:] for s in range(count)) / count
        own = sum(np.linalg.pinv(b.T @ b) for b in map(self._white, range(count)))
        return own / count**2 + slope @ covariance @ slope.T

    def _white(self, s):
        own = self.session == s
        root = np.sqrt(self.weight[own])[:, None, None]
        return (root * self.nuisance[own]).reshape(-1, self.nuisance.shape[2])

    def _solved(self, s):
        own, b = self.session == s, self._white(s)
        root = np.sqrt(self.weight[own])[:, None, None]
        both = np.concatenate([self.values[own, :, None], self.derivative[own]], axis=2)
        return np.linalg.lstsq(b, -(root * both).reshape(len(b), -1), rcond=1e-12)[0]

    def residuals(self, x=None):
        """Return the residuals, (3 m,), and their derivative, (3 m, p), at the model's own x."""
        both = np.concatenate([self.values[..., None], self.derivative], axis=2)
        for s in range(self.session.max(initial=-1) + 1):
            own = self.session == s
            both[own] += self.nuisance[own] @ self._solved(s)
        both = both.reshape(-1, both.shape[2])
        return both[:, 0], both[:, 1:]
