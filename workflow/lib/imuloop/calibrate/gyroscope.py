"""Multi-position model of a gyroscope: its rotations carry gravity from pose to pose."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from imuloop.calibrate.poses import Rotations
from imuloop.calibrate.sensor_model import SensorModel
from imuloop.core.rotation import exponential, matrix, multiply, prefix_product, step_vectors

# parameters of the base model
NAMES = ("T01", "T02", "T10", "T12", "T20", "T21", "K0", "K1", "K2", "b0", "b1", "b2")


class AngularRate(SensorModel):
    """Angular rate on the body axes, which the accelerometer defines."""

    entries: ClassVar = ((0, 0, 1, 1, 2, 2), (1, 2, 0, 2, 0, 1))


unpack = AngularRate.unpack


@dataclass(frozen=True)
class AttitudePath:
    """Attitude C along m rotations, which takes body axes to those at their start."""

    after: np.ndarray  # quaternions of C after each step, (m, k - 1, 4)
    middle: np.ndarray  # C at the middle of each step, (m, k - 1, 3, 3)

    @cached_property
    def last(self):
        """C at the end, (m, 3, 3)."""
        return matrix(self.after[:, -1])

    @cached_property
    def at_samples(self):
        """C at the samples, (m, k, 3, 3)."""
        start = np.tile(np.eye(3), (len(self.after), 1, 1, 1))
        return np.concatenate([start, matrix(self.after)], axis=1)


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
        (_, K, b), axes = unpack(x), np.arange(3)
        jacobian = np.zeros((len(self.rate), 3, len(x)))
        jacobian[:, axes, 6 + axes] = self.rate - b
        jacobian[:, axes, 9 + axes] = -K
        jacobian[:, :, 12:] = -self.rate_design
        return AngularRate(self.rate, self.rate_design).output(x), jacobian

    def path(self, x):
        """Return the AttitudePath with parameters x."""
        key = np.asarray(x, dtype=float).tobytes()
        if key not in self._paths:
            self._paths.clear()
            self._paths[key] = self._path(x)
        return self._paths[key]

    @cached_property
    def along(self):
        """The AngularRate along the rotations."""
        return AngularRate(self.rotations.w, self.rotation_design)

    def _path(self, x):
        rotations, rates = self.rotations, self.along.values(x)
        half = exponential(step_vectors(rates, rotations.steps, rotations.uneven) / 2)
        after = prefix_product(multiply(half, half))
        # the middle of a step is half a step back from its end
        half[..., 1:] *= -1
        return AttitudePath(after, matrix(multiply(after, half)))

    def summed(self, middle, x):
        """Return ``∫ A (dw/dx) dt`` of matrices A in the middle of each step, (m, a, 12 + p).

        Takes (m, k - 1, a, 3). A step's rate is the mean of those at its ends.
        """
        half = middle * (self.rotations.steps[..., None, None] / 2)
        return self.along.summed(at_both_ends(half), x)

    def carried(self, x):
        """Return what takes gravity at the start of a rotation to its residual, (m, 2, 3).

        That is the angle to gravity as it is measured at the end, in the plane normal to that, rad.
        """
        return self.plane @ self.path(x).last.swapaxes(1, 2)

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
    """Return the means of neighbours along the second axis: of (m, k, ...), (m, k - 1, ...)."""
    return (values[:, 1:] + values[:, :-1]) / 2


def at_both_ends(values):
    """Return at each sample the sum of the values of the steps beside it, (m, k, ...).

    Takes the values of the steps, (m, k - 1, ...).
    """
    found = np.zeros((len(values), values.shape[1] + 1, *values.shape[2:]))
    found[:, 1:] = values
    found[:, :-1] += values
    return found


def tangents(directions):
    """Return two unit vectors normal to each direction, (n, 3), and to each other, (n, 2, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def cross_matrix(vectors):
    """Return the matrices of ``v ×``, shape (n, 3, 3), of vectors v, (n, 3)."""
    return np.cross(np.eye(3), vectors[:, None])
