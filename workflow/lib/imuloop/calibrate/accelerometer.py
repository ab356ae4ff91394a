"""Multi-position calibration of an accelerometer: at rest it measures the norm of gravity."""

from dataclasses import dataclass

import numpy as np

from imuloop.calibrate.least_squares import condition_number, fit, too_large
from imuloop.core.effect import effect_design

# parameters of the base model
NAMES = ("T01", "T02", "T12", "K0", "K1", "K2", "b0", "b1", "b2")
_UPPER = ((0, 0, 1), (1, 2, 2))
# the axes of an accelerometer, cheap ones and three glued to a cube too, are less off square, rad
SLANT = 0.3


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
    known : ndarray, shape (n, 3), or 0
        Part of e that is known, m/s^2.
    """

    y: np.ndarray
    design: np.ndarray
    gravity: float
    known: np.ndarray | float = 0.0

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
        return K * (self.y - b) - self.known - self.design @ x[9:]

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


def accelerometer_model(recording, gravity, x=None, effects=(), known=()):
    """Return the model of a recording's poses, its effects seen with the parameters x.

    Parameters
    ----------
    recording : Recording
        Poses, n of them.
    gravity : float
        Local gravity, m/s^2.
    x : array_like, optional
        Parameters whose K and b give the output that the effects depend on; as logged without.
    effects, known : sequence of Effect, sequence of FittedEffect
        Effects to estimate, and known ones.
    """
    _, K, b = (None, 1.0, 0.0) if x is None else unpack(x)
    poses = recording.poses
    channels = recording.pose_channels("accelerometer", lambda y: K * (y - b), poses.w)
    return AccelerometerModel(
        poses.f,
        effect_design(effects, channels),
        gravity,
        sum((effect.output(channels) for effect in known), start=np.zeros((len(poses), 3))),
    )


def fit_accelerometer(recording, means, gravity, effects=(), known=(), prior=None):
    """Fit the nine-parameter model, and effects, to the norm of gravity at the poses.

    Minimises ``Σ (|T (K (y - b) - e)| - g)²`` weighted with the covariance that the noise model
    predicts for the pose means.

    Parameters
    ----------
    recording : Recording
        Poses, n of them.
    means : array_like, shape (3, n, n)
        Covariance of their mean specific force, (m/s^2)^2.
    gravity : float
        Local gravity, m/s^2.
    effects : sequence of Effect
        Effects to estimate.
    known : sequence of FittedEffect
        Effects that are known from elsewhere.
    prior : (ndarray, ndarray), optional
        What other data tell of the parameters, as of `least_squares.fit`.

    Returns
    -------
    Fit, AccelerometerModel
        Parameters in the order of `NAMES`, then the effects'; SI units as logged.

    References
    ----------
    Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration without
    external equipments", ICRA 2014, section IV-A.
    """
    model = accelerometer_model(recording, gravity, None, effects, known)
    x = model.start()
    # weights and effects depend on the calibrated output, which the start gives to 1 %
    for _ in range(3 if effects or known else 2):
        model = accelerometer_model(recording, gravity, x, effects, known)
        found = fit(model.residuals, x, model.covariance(x, means), prior)
        x = found.x
    return found, model


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
    x = model.start()
    condition = _condition(model.residuals(x)[1], x, gravity)
    if condition > largest_condition:
        return (
            f"the attitudes of {len(poses)} poses do not determine 9 parameters: "
            f"{too_large(condition, largest_condition)}; add poses that point each axis up and "
            "down and in between"
        )
    return None


def lost_accelerometer(fit, gravity, largest_condition):
    """Return why a fit is none, or None if it is one.

    Gravity's norm is also met where K tends to zero and K b to a vector as long as gravity. What
    lies on no ellipsoid is drawn there, and there the poses determine nothing; or to axes that no
    accelerometer has.

    Parameters
    ----------
    fit : Fit
        From `fit_accelerometer`.
    gravity, largest_condition : float
        As of `untestable_accelerometer`.
    """
    condition = _condition(fit.jacobian, fit.x, gravity)
    slant = np.max(np.abs(fit.x[:3]))
    if not condition <= largest_condition:
        leads = f"where they determine nothing, {too_large(condition, largest_condition)}"
    elif slant > SLANT or np.min(fit.x[3:6]) <= 0:
        leads = f"axes {slant:.2g} rad from square, at most {SLANT:g} is plausible"
    else:
        return None
    return (
        f"specific force at {len(fit.jacobian)} poses lies on no ellipsoid of an accelerometer: "
        f"the fit leads to {leads}; was a pose clipped or wrapped around, did scale or offset "
        f"change midway?"
    )


def _condition(jacobian, x, gravity):
    """Return the condition number of the nine parameters at x, each by its natural size."""
    K = np.abs(x[3:6])
    return condition_number(jacobian[:, :9], np.concatenate([np.ones(3), K, gravity / K]))
