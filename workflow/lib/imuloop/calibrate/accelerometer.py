"""Multi-position calibration of an accelerometer: at rest it measures the norm of gravity."""

from dataclasses import dataclass

import numpy as np

from imuloop.calibrate.least_squares import condition_number, fit
from imuloop.core.effect import Channels, effect_design

# parameters of the base model
NAMES = ("T01", "T02", "T12", "K0", "K1", "K2", "b0", "b1", "b2")
_UPPER = ((0, 0, 1), (1, 2, 2))


@dataclass(frozen=True)
class AccelerometerModel:
    """``x = T (K (y - b) - e)`` with T upper triangular, from the mean y of each pose.

    Attributes
    ----------
    y : ndarray, shape (n, 3)
        Mean specific force of each pose, m/s^2 as logged.
    design : ndarray, shape (n, 3, p)
        Derivative of e with respect to the parameters of the effects; p may be 0.
    gravity : float
        Local gravity, m/s^2.
    """

    y: np.ndarray
    design: np.ndarray
    gravity: float

    def start(self):
        """Return parameters to start from: no misalignment, no bias, the mean norm as it is."""
        scale = self.gravity / np.median(np.linalg.norm(self.y, axis=1))
        return np.concatenate([np.zeros(3), np.full(3, scale), np.zeros(3 + self.design.shape[2])])

    def force(self, x):
        """Return calibrated specific force, shape (n, 3), and T."""
        T = unpack(x)[0]
        return self._output(x) @ T.T, T

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
        rows, columns = _UPPER
        jacobian = np.concatenate(
            [
                u[:, rows] * output[:, columns],
                along * (self.y - b),
                -along * K,
                -np.einsum("ni,nip->np", along, self.design),
            ],
            axis=1,
        )
        return norm - self.gravity, jacobian

    def covariance(self, x, means):
        """Return the residuals' covariance, (n, n), from that of the means, (3, n, n)."""
        T, K, _ = unpack(x)
        force, _ = self.force(x)
        weights = (force / np.linalg.norm(force, axis=1)[:, None]) @ T * K
        return np.einsum("ia,aij,ja->ij", weights, means, weights)


def unpack(x):
    """Return T (3, 3), K (3,) and b (3,) of the parameters in the order of `NAMES`."""
    T = np.eye(3)
    T[_UPPER] = x[:3]
    return T, x[3:6], x[6:9]


def fit_accelerometer(poses, means, gravity, effects=()):
    """Fit the nine-parameter model, and effects, to the norm of gravity at the poses.

    Minimises ``Σ (|T (K (y - b) - e)| - g)²`` weighted with the covariance that the noise model
    predicts for the pose means.

    Parameters
    ----------
    poses : Poses
        Poses, n of them.
    means : array_like, shape (3, n, n)
        Covariance of their mean specific force, (m/s^2)^2.
    gravity : float
        Local gravity, m/s^2.
    effects : sequence of Effect
        Effects to add.

    Returns
    -------
    Fit, AccelerometerModel
        Parameters in the order of `NAMES`, then the effects'; SI units as logged.

    References
    ----------
    Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration without
    external equipments", ICRA 2014, section IV-A.
    """
    channels = Channels(poses.mid_s, poses.f, poses.w, poses.temperature)
    model = AccelerometerModel(poses.f, effect_design(effects, channels), gravity)
    # weights depend on the attitude of the calibrated force, which the start gives to 1 %
    first = fit(model.residuals, model.start(), model.covariance(model.start(), means))
    return fit(model.residuals, first.x, model.covariance(first.x, means)), model


def untestable_accelerometer(poses, gravity, largest_condition):
    """Return why the poses do not determine the nine parameters, or None if they do.

    Parameters
    ----------
    poses : Poses
        Poses.
    gravity : float
        Local gravity, m/s^2.
    largest_condition : float
        Condition number beyond which they are called undetermined.
    """
    if not len(poses):
        return "no multi_position session with a pose"
    needed = len(NAMES) + 1
    if len(poses) < needed:
        return f"{len(poses)} poses found, at least {needed} needed for 9 parameters and a check"
    model = AccelerometerModel(poses.f, np.zeros((len(poses), 3, 0)), gravity)
    condition = condition_number(
        model.residuals(model.start())[1], np.repeat([1.0, 1.0, gravity], 3)
    )
    if condition > largest_condition:
        return (
            f"the attitudes of {len(poses)} poses do not determine 9 parameters: condition number "
            f"{condition:.3g}, at most {largest_condition:g} allowed; add poses that point each "
            f"axis up and down and in between"
        )
    return None
