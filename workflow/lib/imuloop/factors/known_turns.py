"""Turns of a known angle, or at a known rate: a reference of one number each."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.model.sensor import Sensor
from imuloop.model.state import ENTRIES

# rad; standard deviation of an end of a turn that is made by hand against an edge, half a turn's
# worth on each axis
BY_HAND = 0.005


@dataclass(frozen=True)
class KnownTurns:
    """Turns about fixed axes: ``T K (a - b L) = θ u``, with a the integral of the rate as logged.

    `turned` a, rad as logged, (m, 3); `seconds` L, (m,); `target` θ u, rad on body axes, (m, 3);
    `bias` of the rests beside them, rad/s as logged, (3,).
    """

    turned: np.ndarray
    seconds: np.ndarray
    target: np.ndarray
    bias: np.ndarray

    def __len__(self):
        return len(self.seconds)

    def select(self, keep):
        """Return the turns of an index or mask."""
        own = {name: getattr(self, name)[keep] for name in ("turned", "seconds", "target")}
        return replace(self, **own)

    @property
    def rate(self):
        """Mean angular rate of each turn, rad/s as logged, (m, 3)."""
        return self.turned / self.seconds[:, None]

    def start(self):
        """Return the Sensor by the turns alone, nominal where they determine nothing."""
        raw, found = self.turned - self.seconds[:, None] * self.bias, np.eye(3)
        if len(self) and np.linalg.matrix_rank(raw, tol=0.1 * np.abs(raw).max()) == 3:
            found = np.linalg.lstsq(raw, self.target, rcond=None)[0].T
        K = np.diag(found)
        return Sensor(ENTRIES["gyroscope"], found / K, K, self.bias, np.zeros(0))

    def rows(self):
        """Return rows R, (3 m, 12), and z of what they say: ``R x - z`` has variance one."""
        sensor, m = self.start(), len(self)
        x = np.concatenate([sensor.T[sensor.entries], sensor.K, sensor.b])
        weights = self.seconds[:, None, None, None] * np.eye(3)
        J = sensor.jacobian(weights, self.rate[:, None], np.zeros((m, 1, 3, 0))).reshape(-1, 12)
        left = self.seconds[:, None] * sensor.aligned(self.rate) - self.target
        return J / BY_HAND, (J @ x - left.ravel()) / BY_HAND

    def errors(self, calibration):
        """Return what a SensorCalibration leaves of each turn, rad, (m, 3)."""
        return self.seconds[:, None] * calibration.aligned(self.rate) - self.target
