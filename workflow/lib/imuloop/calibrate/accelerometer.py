"""Multi-position model of an accelerometer: at rest it measures the norm of gravity."""

from dataclasses import dataclass

import numpy as np

# parameters of the base model
NAMES = ("T01", "T02", "T12", "K0", "K1", "K2", "b0", "b1", "b2")
# rows and columns of T that are estimated
UPPER = ((0, 0, 1), (1, 2, 2))


@dataclass(frozen=True)
class AccelerometerModel:
    """``x = T (K (y - b) - e)`` with T upper triangular, from the mean y of n poses."""

    y: np.ndarray  # m/s^2 as logged, (n, 3)
    design: np.ndarray  # derivative of e with respect to the parameters of the effects, (n, 3, p)
    gravity: float  # m/s^2

    def start(self):
        """Return parameters to start from: no misalignment, no bias, the mean norm as it is."""
        scale = self.gravity / np.median(np.linalg.norm(self.y, axis=1))
        return np.concatenate([np.zeros(3), np.full(3, scale), np.zeros(3 + self.design.shape[2])])

    def force(self, x):
        """Return calibrated specific force, shape (n, 3)."""
        return self._output(x) @ unpack(x)[0].T

    def _output(self, x):
        _, K, b = unpack(x)
        return K * (self.y - b) - self.design @ x[9:]

    def residuals(self, x):
        """Return ``|x| - g``, m/s^2, shape (n,), and its derivative, shape (n, 9 + p)."""
        T, K, b = unpack(x)
        output = self._output(x)
        force = output @ T.T
        norm = np.linalg.norm(force, axis=1)
        u = force / norm[:, None]
        along = u @ T
        rows, columns = UPPER
        of_effects = -np.einsum("ni,nip->np", along, self.design)
        parts = [u[:, rows] * output[:, columns], along * (self.y - b), -along * K, of_effects]
        return norm - self.gravity, np.concatenate(parts, axis=1)

    def derivative(self, x):
        """Return the derivative of calibrated specific force, shape (n, 3, 9 + p)."""
        T, K, b = unpack(x)
        output = self._output(x)
        found = np.zeros((len(self.y), 3, len(x)))
        for k, (row, column) in enumerate(zip(*UPPER, strict=True)):
            found[:, row, k] = output[:, column]
        found[:, :, 3:6] = T * (self.y - b)[:, None]
        found[:, :, 6:9] = -T * K
        found[:, :, 9:] = -T @ self.design
        return found


def unpack(x):
    """Return T (3, 3), K (3,) and b (3,) of the parameters in the order of `NAMES`."""
    T = np.eye(3)
    T[UPPER] = x[:3]
    return T, x[3:6], x[6:9]
