"""The equation of a sensor as it is fitted, and its one derivative; applied: `core.model`."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np


@dataclass(frozen=True)
class SensorModel:
    """``x = T (K (y - b) - e)`` of samples y, T with a diagonal of ones.

    Its parameters are the entries of T that are estimated, K, b, and those of the effects in e.
    """

    entries: ClassVar[tuple]  # rows and columns of T that are estimated
    y: np.ndarray  # SI as logged, (..., 3)
    design: np.ndarray  # derivative of e with respect to the parameters of the effects, (..., 3, p)

    @classmethod
    def unpack(cls, x):
        """Return T (3, 3), K (3,) and b (3,) of parameters."""
        T, count = np.eye(3), len(cls.entries[0])
        T[cls.entries] = x[:count]
        return T, x[count : count + 3], x[count + 3 : count + 6]

    @classmethod
    def functions(cls, x):
        """Return what takes values as logged, (..., 3), to ``K (y - b)`` and to ``T K (y - b)``."""
        T, K, b = cls.unpack(x)
        return lambda y: K * (y - b), lambda y: (K * (y - b)) @ T.T

    def output(self, x):
        """Return ``K (y - b) - e``, shape (..., 3)."""
        _, K, b = self.unpack(x)
        found, of_effects = K * (self.y - b), x[len(self.entries[0]) + 6 :]
        # effects of a search are hundreds, and zero about the fit without them
        return found - self.design @ of_effects if of_effects.any() else found

    def values(self, x):
        """Return calibrated values, shape (..., 3)."""
        return self.output(x) @ self.unpack(x)[0].T

    def summed(self, weights, x):
        """Return the derivative of the sum of ``A x`` over the k samples of each of m groups.

        Takes the matrices A, (m, k, a, 3); the derivative has (m, a, number of parameters).
        """
        T, K, b = self.unpack(x)
        m, k, a, _ = weights.shape
        entries = weights.reshape(m, k, 3 * a).swapaxes(1, 2)
        # moments: row and column of A, axis of y
        of_output, of_raw = (
            (entries @ seen.reshape(m, k, 3)).reshape(m, a, 3, 3)
            for seen in (self.output(x), self.y - b)
        )
        # one product of matrices instead of one per sample
        aligned = np.tensordot(weights, T, 1).swapaxes(1, 2).reshape(m, a, 3 * k)
        parts = [
            of_output[:, :, *self.entries],
            np.einsum("maij,ij->maj", of_raw, T),
            -weights.sum(axis=1) @ (T * K),
            -aligned @ self.design.reshape(m, 3 * k, self.design.shape[-1]),
        ]
        return np.concatenate(parts, axis=2)
