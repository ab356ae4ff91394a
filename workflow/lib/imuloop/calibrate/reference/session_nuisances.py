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
    def _both(self):
        """Residuals and derivative, (m, 3, 1 + p)."""
        return np.concatenate([self.values[..., None], self.derivative], axis=2)

    @cached_property
    def _solved(self):
        """Covariance of each session's nuisances, (s, q, q), and they by `_both`, (s, q, 1 + p)."""
        found, root = [], np.sqrt(self.weight)[:, None, None]
        for s in range(self.session.max() + 1):
            own = self.session == s
            B, both = (np.concatenate((root * a)[own]) for a in (self.nuisance, self._both))
            found.append((np.linalg.pinv(B.T @ B), -np.linalg.lstsq(B, both, rcond=1e-12)[0]))
        return tuple(map(np.array, zip(*found, strict=True)))

    @property
    def nuisances(self):
        """What each session's nuisances are, (s, q)."""
        return self._solved[1][:, :, 0]

    def covariance_of_mean(self, covariance):
        """Return the covariance of the sessions' mean nuisances, (q, q), by that of x, (p, p)."""
        own, solved = self._solved
        slope = solved[:, :, 1:].mean(axis=0)
        return own.mean(axis=0) / len(own) + slope @ covariance @ slope.T

    def residuals(self, x=None):
        """Return the residuals, (3 m,), and their derivative, (3 m, p), at the model's own x."""
        left = np.concatenate(self._both + self.nuisance @ self._solved[1][self.session])
        return left[:, 0], left[:, 1:]
