"""The equation of a sensor as it is fitted, and its one Jacobian; applied: `core.model`."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sensor:
    """``x = T (K (y - b) - e)`` of values y, with e the sum of the sensor's effects.

    Attributes
    ----------
    entries : tuple
        Rows and columns of the off-diagonal elements of T that are parameters.
    T : ndarray, shape (3, 3)
        Misalignment, its diagonal ones.
    K, b : ndarray, shape (3,)
        Scale factors and biases, SI as logged.
    p : ndarray, shape (q,)
        Parameters of the effects: ``e = D p``.
    """

    entries: tuple
    T: np.ndarray
    K: np.ndarray
    b: np.ndarray
    p: np.ndarray

    @property
    def gain(self):
        """Derivative of calibrated values with respect to values as logged, (3, 3)."""
        return self.T * self.K

    def output(self, y):
        """Return ``K (y - b)`` of values as logged, (..., 3)."""
        return self.K * (y - self.b)

    def aligned(self, y):
        """Return ``T K (y - b)``: calibrated values without effects, (..., 3)."""
        return self.output(y) @ self.T.T

    def corrected(self, y, D):
        """Return ``K (y - b) - e``, (..., 3), with D the derivative of e by p, (..., 3, q)."""
        # effects of a search are hundreds, and zero about the fit without them
        return self.output(y) - D @ self.p if self.p.any() else self.output(y)

    def values(self, y, D):
        """Return calibrated values, (..., 3)."""
        return self.corrected(y, D) @ self.T.T

    def jacobian(self, A, y, D):
        """Return the derivative of the sum of ``A x`` over the k samples of each of m groups.

        Takes weights A, (m, k, a, 3), values as logged y, (m, k, 3), and D, (m, k, 3, q). The
        derivative with respect to T, K, b and p is (m, a, number of parameters).
        """
        m, k, a, _ = A.shape
        flat = A.reshape(m, k, 3 * a).swapaxes(1, 2)
        # sums of products: row of A, its column, axis of the values
        by_corrected, by_raw = (
            (flat @ values).reshape(m, a, 3, 3) for values in (self.corrected(y, D), y - self.b)
        )
        # one product of matrices instead of one per sample
        on_sensor_axes = np.tensordot(A, self.T, 1).swapaxes(1, 2).reshape(m, a, 3 * k)
        parts = [
            by_corrected[:, :, *self.entries],
            np.einsum("maij,ij->maj", by_raw, self.T),
            -A.sum(axis=1) @ self.gain,
            -on_sensor_axes @ D.reshape(m, 3 * k, D.shape[-1]),
        ]
        return np.concatenate(parts, axis=2)
