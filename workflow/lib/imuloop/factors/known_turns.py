"""Turns by a known angle or at a known rate, as a reference for the gyroscope."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.model.sensor import Sensor
from imuloop.model.state import BASE, ENTRIES

# standard deviation of each component of a turn that is made by hand against an edge, rad
BY_HAND = 0.005


@dataclass(frozen=True)
class KnownTurns:
    """m turns about fixed axes: ``T K (a - b L) = θ u``.

    T, K and b are the misalignment, the scale factors and the bias of the gyroscope. a is the
    integral of the angular rate over the turn, L its duration, θ its known angle and u its axis, a
    unit vector. Nominal SI values are raw readings minus the offset, times the scale of the data
    sheet.
    """

    turned: np.ndarray  # (m, 3): a, rad, nominal SI
    seconds: np.ndarray  # (m,): L, s
    target: np.ndarray  # (m, 3): θ u, rad, on body axes
    bias: np.ndarray  # (3,): mean angular rate of the rests in the same sessions, rad/s, nominal SI

    def __len__(self):
        return len(self.seconds)

    def select(self, keep):
        """Return the KnownTurns that `keep`, an index array or a mask, chooses."""
        chosen = {name: getattr(self, name)[keep] for name in ("turned", "seconds", "target")}
        return replace(self, **chosen)

    @property
    def rate(self):
        """Mean angular rate of each turn, rad/s, nominal SI, (m, 3)."""
        return self.turned / self.seconds[:, None]

    def estimate_sensor(self):
        """Return the gyroscope, a Sensor, that fits the turns best.

        Its bias b is the mean angular rate of the rests. Its matrix T K, misalignment times scale
        factors, is the least-squares solution of ``T K (a - b L) = θ u`` for all turns. a is the
        integral of the angular rate over a turn, L its duration, θ its known angle, and u its axis.
        Exception: if the turns do not determine T K, as turns about a single axis do not, T K is
        the identity.
        """
        raw, gain = self.turned - self.seconds[:, None] * self.bias, np.eye(3)
        if len(self) and np.linalg.matrix_rank(raw, tol=0.1 * np.abs(raw).max()) == 3:
            gain = np.linalg.lstsq(raw, self.target, rcond=None)[0].T
        # T has ones on its diagonal
        K = np.diag(gain)
        return Sensor(ENTRIES["gyroscope"], T=gain / K, K=K, b=self.bias, p=np.zeros(0))

    def rows(self):
        """Return the turns as a prior: R, (3 m, 21), and z, (3 m,), with ``R x - z`` near zero.

        x is the state: the 21 parameters of both sensors, without effects, in nominal SI.
        ``R x - z`` has mean zero and variance one. It has the three components of the residual
        ``T K (a - b L) - θ u`` of each of m turns, over their standard deviation `BY_HAND`. T K and
        b are matrix and bias of the gyroscope, a is the integral of the angular rate, L the
        duration, θ the known angle, and u the axis of the turn. The residuals are linearised about
        the gyroscope that fits the turns best.
        """
        sensor, m = self.estimate_sensor(), len(self)
        best = np.concatenate([sensor.T[sensor.entries], sensor.K, sensor.b])
        # T K (a - b L) is L times T K (a/L - b), the calibrated mean rate, with one value per turn.
        # The model lacks effects here, so the array of their derivatives is empty
        weights, no_effects = self.seconds[:, None, None, None] * np.eye(3), np.zeros((m, 1, 3, 0))
        J = sensor.jacobian(weights, self.rate[:, None], no_effects).reshape(-1, 12)
        # at parameters x the residuals are those at `best` plus J (x - best), which is J x - z
        z = J @ best - self.errors(sensor).ravel()
        # the accelerometer's parameters come first in the state: their columns are zero
        return np.pad(J, ((0, 0), (BASE["gyroscope"].start, 0))) / BY_HAND, z / BY_HAND

    def errors(self, calibration):
        """Return for each turn the rotation by the gyroscope minus the known rotation, rad, (m, 3).

        It is ``T K (a - b L) - θ u`` on body axes, with the matrix T K and the bias b of the
        gyroscope, the integral a of the angular rate, the duration L, the angle θ and the axis u.
        `calibration` is the calibration of the gyroscope, a SensorCalibration or a Sensor.
        """
        return self.seconds[:, None] * calibration.aligned(self.rate) - self.target
