"""Multi-position model of an accelerometer: at rest it measures the norm of gravity."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imuloop.calibrate.sensor_model import SensorModel

# parameters of the base model
NAMES = ("T01", "T02", "T12", "K0", "K1", "K2", "b0", "b1", "b2")


class SpecificForce(SensorModel):
    """Specific force: its axes are those of the body, so T is upper triangular."""

    entries: ClassVar = ((0, 0, 1), (1, 2, 2))


@dataclass(frozen=True)
class AccelerometerModel(SpecificForce):
    """Specific force from the mean y of n poses."""

    gravity: float  # m/s^2

    def start(self):
        """Return parameters to start from: no misalignment, no bias, the mean norm as it is."""
        scale = self.gravity / np.median(np.linalg.norm(self.y, axis=1))
        return np.concatenate([np.zeros(3), np.full(3, scale), np.zeros(3 + self.design.shape[2])])

    def residuals(self, x):
        """Return ``|x| - g``, m/s^2, shape (n,), and its derivative, shape (n, 9 + p)."""
        force = self.values(x)
        norm = np.linalg.norm(force, axis=1)
        u = force / norm[:, None]
        return norm - self.gravity, self.summed(u[:, None, None], x)[:, 0]

    def derivative(self, x):
        """Return the derivative of calibrated specific force, shape (n, 3, 9 + p)."""
        return self.summed(np.tile(np.eye(3), (len(self.y), 1, 1, 1)), x)


unpack = SpecificForce.unpack
