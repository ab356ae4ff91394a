"""Multi-position model of a gyroscope: its rotations carry gravity from pose to pose."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from imuloop.calibrate.poses import Rotations
from imuloop.core.effect import effect_design
from imuloop.core.rotation import exponential, matrix, multiply, prefix_product, step_vectors

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

    last: np.ndarray  # C at the end, (m, 3, 3)
    middle: np.ndarray  # C at the middle of each step, (m, k - 1, 3, 3)
    steps: np.ndarray  # s
    after: np.ndarray  # quaternions of C after each step, (m, k - 1, 4)


@dataclass(frozen=True)
class GyroscopeModel:
    """``w = T (K (y - b) - e)``, from the mean rate of n poses and every rotation between them."""

    # mean angular rate of each pose, rad/s as logged, (n, 3), and the derivative of e, (n, 3, p)
    rate: np.ndarray
    rate_design: np.ndarray
    rotations: Rotations  # m of k samples
    rotation_design: np.ndarray  # the derivative of e along them, (m, k, 3, p)
    directions: np.ndarray  # unit vector of calibrated specific force at each pose, (n, 3)
    # turns from there to the start and to the end of a pose, rad, (n, 3) or zero
    to_start: np.ndarray | float = 0.0
    to_end: np.ndarray | float = 0.0
    # the last path, which depends on no direction: residuals and covariance at one x share it
    _paths: dict = field(default_factory=dict, compare=False, repr=False)

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
        return K * (self.rate - b) - self.rate_design @ x[12:], jacobian

    def path(self, x):
        """Return the AttitudePath with parameters x."""
        key = np.asarray(x, dtype=float).tobytes()
        if key not in self._paths:
            self._paths.clear()
            self._paths[key] = self._path(x)
        return self._paths[key]

    def _path(self, x):
        rotations, rates = self.rotations, self.output(x) @ unpack(x)[0].T
        half = exponential(step_vectors(rates, rotations.steps, rotations.uneven) / 2)
        after = prefix_product(multiply(half, half))
        # the middle of a step is half a step back from its end
        half[..., 1:] *= -1
        middle = matrix(multiply(after, half))
        return AttitudePath(matrix(after[:, -1]), middle, rotations.steps, after)

    def output(self, x):
        """Return ``K (y - b) - e`` along the rotations, rad/s, (m, k, 3)."""
        _, K, b = unpack(x)
        found = K * (self.rotations.w - b)
        # effects of a search are hundreds, and zero about the fit without them
        return found - self.rotation_design @ x[12:] if x[12:].any() else found

    def summed(self, middle, x):
        """Return ``∫ A (dw/dx) dt`` of matrices A in the middle of each step, (m, 3, 12 + p).

        Takes (m, k - 1, 3, 3). A step's rate is the mean of those at its ends.
        """
        T, K, b = unpack(x)
        m, k = self.rotations.w.shape[:2]
        # half of each step to the samples at its ends: entry of A, sample
        half = (middle * (self.rotations.steps[..., None, None] / 2)).reshape(m, k - 1, 9)
        entries = np.zeros((m, 9, k))
        entries[:, :, 1:] = half.swapaxes(1, 2)
        entries[:, :, :-1] += half.swapaxes(1, 2)
        # moments: entry of A, axis
        of_raw, of_output = (
            (entries @ seen).reshape(m, 3, 3, 3) for seen in (self.rotations.w - b, self.output(x))
        )
        found = np.zeros((m, 3, len(x)))
        found[:, :, :6] = of_output[:, :, *_OFF_DIAGONAL]
        found[:, :, 6:9] = np.einsum("maij,ij->maj", of_raw, T)
        found[:, :, 9:12] = -entries.sum(axis=2).reshape(m, 3, 3) @ (T * K)
        if len(x) > 12:
            seen = (T.T @ entries.reshape(m, 3, 3, k)).swapaxes(2, 3).reshape(m, 3, 3 * k)
            found[:, :, 12:] = -seen @ self.rotation_design.reshape(m, 3 * k, len(x) - 12)
        return found

    def rotation_errors(self, x):
        """Return the angle between predicted and measured gravity, and its derivative.

        With C the attitude, ``u_end = Cᵀ u_start`` and a small change of rate δw gives
        ``δu_end = Cᵀ (u_start × φ), φ = ∫ C(t) δw(t) dt``. In the plane normal to the measured
        direction, rad, (m, 2); the derivative has (m, 2, 12 + p).
        """
        path, start = self.path(x), self.departures
        across = cross_matrix(start) @ self.summed(path.middle, x)
        return self.angles(x), self.plane @ (path.last.swapaxes(1, 2) @ across)

    def angles(self, x):
        """Return the angles of `rotation_errors` alone."""
        turned = np.einsum("mji,mj->mi", self.path(x).last, self.departures)
        return np.einsum("mij,mj->mi", self.plane, turned)

    @cached_property
    def plane(self):
        """Two unit vectors normal to the measured direction after each rotation, (m, 2, 3)."""
        return tangents(self._turned(self.to_start)[self.rotations.first + 1])

    @cached_property
    def departures(self):
        """Direction of gravity where each rotation starts, (m, 3)."""
        return self._turned(self.to_end)[self.rotations.first]

    def _turned(self, turns):
        """Return the directions at the poses after small turns from there, (n, 3)."""
        return self.directions + np.cross(self.directions, np.broadcast_to(turns, self.rate.shape))


def midpoints(values):
    """Return the means of neighbours along the second axis."""
    return (values[:, 1:] + values[:, :-1]) / 2


def tangents(directions):
    """Return two unit vectors normal to each direction and to each other, shape (n, 2, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def cross_matrix(vectors):
    """Return the matrices of ``v ×``, shape (n, 3, 3)."""
    return np.cross(np.eye(3), vectors[:, None])


def gyroscope_model(recording, see, x, effects=()):
    """Return the model of a Recording's rates at rest and rotations.

    With effects, which depend on the output with K and b of the parameters x; `see` takes specific
    force as logged to what the effects see of it.
    """
    T, K, b = unpack(x)
    values, rotations = x[len(NAMES) :], recording.rotations
    shape, poses = rotations.w.shape, recording.poses

    def output(y):
        return K * (y - b)

    force = see(poses.f)
    at_rest = recording.pose_channels("gyroscope", output, force, see)
    design = np.zeros((*shape, len(values)))
    if len(rotations) and effects:
        along = recording.rotation_channels("gyroscope", output, see(rotations.f), see)
        design = effect_design(effects, along, values).reshape(design.shape)
    return GyroscopeModel(
        rate=poses.w,
        rate_design=effect_design(effects, at_rest, values),
        rotations=rotations,
        rotation_design=design,
        directions=force / np.linalg.norm(force, axis=1, keepdims=True),
        # small turns, so those that the sensor gives are scaled and aligned as rates are
        to_start=poses.to_start @ (T * K).T if np.ndim(poses.to_start) else 0.0,
        to_end=poses.to_end @ (T * K).T if np.ndim(poses.to_end) else 0.0,
    )
