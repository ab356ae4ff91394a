"""Multi-position model of a gyroscope: its rotations carry gravity from pose to pose."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from imuloop.calibrate.gyroscope_covariance import cross_matrix, residual_covariance, tangents
from imuloop.calibrate.poses import Rotations
from imuloop.core.effect import effect_design
from imuloop.core.rotation import exponential, matrix, multiply, prefix_product, step_vectors

__all__ = ["NAMES", "GyroscopeModel", "gyroscope_model", "residual_covariance", "unpack"]

# parameters of the base model
NAMES = ("T01", "T02", "T10", "T12", "T20", "T21", "K0", "K1", "K2", "b0", "b1", "b2")
_OFF_DIAGONAL = ((0, 0, 1, 1, 2, 2), (1, 2, 0, 2, 0, 1))


def unpack(x):
    """Return T (3, 3), K (3,) and b (3,) of the parameters in the order of `NAMES`."""
    T = np.eye(3)
    T[_OFF_DIAGONAL] = x[:6]
    return T, x[6:9], x[9:12]


@dataclass(frozen=True)
class AttitudePath:
    """What residuals and covariances take of the attitude C along m rotations.

    C takes body axes to those at the start of the rotation.
    """

    # C at the end, (m, 3, 3)
    last: np.ndarray
    # ∫ C (dw/dx) dt, the rotation at the start that a change of each parameter makes, rad
    turn: np.ndarray
    # ∫ C dt, s, (m, 3, 3)
    mean: np.ndarray
    # C at the middle of each step, (m, k - 1, 3, 3), and the steps, s
    middle: np.ndarray
    steps: np.ndarray
    # covariance that the time stamps add, on axes at the start, rad², (m, 3, 3)
    added: np.ndarray | None

    @cached_property
    def spread(self):
        """``∫ c cᵀ dt`` with c the column of C of each axis of the sensor, s, (m, 3, 3, 3)."""
        columns = self.middle.transpose(0, 3, 2, 1)
        return (columns * self.steps[:, None, None]) @ columns.swapaxes(2, 3)


@dataclass(frozen=True)
class GyroscopeModel:
    """``w = T (K (y - b) - e)``, from the mean rate of n poses and every rotation between them."""

    # mean angular rate of each pose, rad/s as logged, (n, 3), and the derivative of e, (n, 3, p)
    rate: np.ndarray
    rate_design: np.ndarray
    # m rotations of k samples, and the derivative of e along them, (m, k, 3, p)
    rotations: Rotations
    rotation_design: np.ndarray
    # unit vector of calibrated specific force at each pose, (n, 3)
    directions: np.ndarray
    # part of e that is known, rad/s, (n, 3) and (m, k, 3)
    rate_known: np.ndarray | float = 0.0
    rotation_known: np.ndarray | float = 0.0
    # the last path, which depends on no direction: residuals and covariance at one x share it
    _paths: dict = field(default_factory=dict, compare=False, repr=False)

    def start(self):
        """Return parameters to start from: as logged, the mean rate of the poses as bias."""
        effects = np.zeros(self.rate_design.shape[2])
        return np.concatenate([np.zeros(6), np.ones(3), self.rate.mean(axis=0), effects])

    def pose_rates(self, x):
        """Return ``K (y - b) - e`` at the poses, zero at rest, and its derivative.

        On the sensor's own axes, rad/s, shape (n, 3); the derivative has (n, 3, 12 + p).
        """
        _, K, b = unpack(x)
        jacobian = np.zeros((len(self.rate), 3, len(x)))
        axes = np.arange(3)
        jacobian[:, axes, 6 + axes] = self.rate - b
        jacobian[:, axes, 9 + axes] = -K
        jacobian[:, :, 12:] = -self.rate_design
        return K * (self.rate - b) - self.rate_known - self.rate_design @ x[12:], jacobian

    def path(self, x):
        """Return the AttitudePath with parameters x."""
        key = np.asarray(x, dtype=float).tobytes()
        if key not in self._paths:
            self._paths.clear()
            self._paths[key] = self._path(x)
        return self._paths[key]

    def _path(self, x):
        T, K, b = unpack(x)
        rotations, m = self.rotations, len(self.rotations)
        dt = rotations.steps[..., None]
        raw = rotations.w - b
        effects = self.rotation_design @ x[12:] + self.rotation_known
        rates = (K * raw - effects) @ T.T
        half = exponential(step_vectors(rates, rotations.steps, rotations.uneven) / 2)
        after = prefix_product(multiply(half, half))
        # the middle of a step is half a step back from its end
        half[..., 1:] *= -1
        middle = matrix(multiply(after, half))
        # moments of the attitude with what each step turns by: entry of C, axis
        entries = middle.reshape(m, -1, 9).swapaxes(1, 2)
        of_raw = (entries @ (midpoints(raw, 1) * dt)).reshape(m, 3, 3, 3)
        of_effects = (entries @ (midpoints(effects, 1) * dt)).reshape(m, 3, 3, 3)
        mean = (entries @ dt).reshape(m, 3, 3)
        turn = np.zeros((m, 3, len(x)))
        turn[:, :, :6] = (K * of_raw - of_effects)[:, :, *_OFF_DIAGONAL]
        turn[:, :, 6:9] = np.einsum("maij,ij->maj", of_raw, T)
        turn[:, :, 9:12] = -mean @ (T * K)
        if len(x) > 12:
            seen = (middle @ T).swapaxes(1, 2).reshape(m, 3, -1)
            turn[:, :, 12:] = -seen @ self._design_steps
        return AttitudePath(
            matrix(after[:, -1]), turn, mean, middle, rotations.steps, self._added(middle)
        )

    def _added(self, middle):
        """Return the covariance that time stamps add, each error turned by the attitude there."""
        rotations = self.rotations
        if rotations.added is None:
            return None
        attitude = middle[np.arange(len(middle))[:, None], rotations.added_at]
        return (attitude @ rotations.added @ attitude.swapaxes(2, 3)).sum(axis=1)

    @cached_property
    def _design_steps(self):
        """What each parameter of the effects adds in each step, (m, 3 (k - 1), p)."""
        steps = midpoints(self.rotation_design, 1) * self.rotations.steps[..., None, None]
        return steps.reshape(len(steps), -1, steps.shape[-1])

    def turned(self, x):
        """Return gravity's direction after each rotation and its derivative.

        With C the attitude, ``u_end = Cᵀ u_start`` and a small change of rate δw gives
        ``δu_end = Cᵀ (u_start × φ), φ = ∫ C(t) δw(t) dt``. On the axes at the end, shape (m, 3);
        the derivative has (m, 3, 12 + p).
        """
        path = self.path(x)
        start = self.directions[self.rotations.first]
        turned = np.einsum("mji,mj->mi", path.last, start)
        return turned, path.last.swapaxes(1, 2) @ (cross_matrix(start) @ path.turn)

    def rotation_errors(self, x):
        """Return the angle between predicted and measured gravity, and its derivative.

        In the plane normal to the measured direction, rad, (m, 2), derivative (m, 2, 12 + p).
        """
        turned, jacobian = self.turned(x)
        return np.einsum("mij,mj->mi", self.plane, turned), self.plane @ jacobian

    @cached_property
    def plane(self):
        """Two unit vectors normal to the measured direction after each rotation, (m, 2, 3)."""
        return tangents(self.directions[self.rotations.first + 1])

    def residuals(self, x):
        """Return all residuals in one vector, and their derivative."""
        rates, of_rates = self.pose_rates(x)
        errors, of_errors = self.rotation_errors(x)
        parts = [each.reshape(-1, len(x)) for each in (of_rates, of_errors)]
        return np.concatenate([rates.ravel(), errors.ravel()]), np.concatenate(parts)


def midpoints(values, axis=-1):
    """Return the means of neighbours along an axis."""
    values = np.moveaxis(values, axis, 0)
    return np.moveaxis((values[1:] + values[:-1]) / 2, 0, axis)


def gyroscope_model(recording, force, x=None, effects=(), known=()):
    """Return the model of the poses' rates and rotations, its effects seen with parameters x.

    Parameters
    ----------
    recording : Recording
        Poses and the rotations between them.
    force : Force
        Calibrated specific force at the poses and along the rotations.
    x : array_like, optional
        Parameters whose K and b give the output that the effects depend on; as logged without.
    effects, known : sequence of Effect, sequence of FittedEffect
        Effects to estimate, and known ones.
    """
    _, K, b = (None, 1.0, 0.0) if x is None else unpack(x)
    rotations, shape, along = recording.rotations, recording.rotations.w.shape, None

    def output(y):
        return K * (y - b)

    poses = recording.pose_channels("gyroscope", output, force.poses)
    design = np.zeros((*shape, 0))
    if effects or known:
        along = recording.rotation_channels("gyroscope", output, force.rotations)
        parameters = sum(len(effect.parameters) for effect in effects)
        design = effect_design(effects, along).reshape(*shape, parameters)
    return GyroscopeModel(
        rate=recording.poses.w,
        rate_design=effect_design(effects, poses),
        rotations=rotations,
        rotation_design=design,
        directions=force.poses / np.linalg.norm(force.poses, axis=1, keepdims=True),
        rate_known=sum(effect.output(poses) for effect in known),
        rotation_known=sum(effect.output(along).reshape(shape) for effect in known),
    )
