"""Calibrated specific force where the gyroscope needs it: at the poses and along the rotations."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imuloop.calibrate.recording import Recording
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import ANGULAR_RATE

_UPPER = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class Force:
    """Calibrated specific force of a recording, at its poses, m/s^2, shape (n, 3)."""

    poses: np.ndarray
    calibration: SensorCalibration
    recording: Recording
    noise: NoiseModel

    @cached_property
    def direction_covariance(self):
        """Covariance of the unit vectors at the poses, pose by pose, shape (3 n, 3 n).

        The direction ``u = f / |f|`` has the error ``δu = (I - u uᵀ) T K δy / |f|`` from that of
        the pose's mean, and ``(I - u uᵀ) δf / |f|`` from that of the calibration.
        """
        calibration, n = self.calibration, len(self.poses)
        norm = np.linalg.norm(self.poses, axis=1)[:, None]
        u = self.poses / norm
        across = (np.eye(3) - u[:, :, None] * u[:, None, :]) / norm[:, None]
        to_direction = across @ (calibration.T * calibration.K / calibration.raw_unit.scale)
        means = self.recording.poses.mean_covariance(self.noise)[:3]
        # the second pose before the first, its three components, the axes last
        left = means.T[:, :, None] * to_direction
        found = left.reshape(n, 3 * n, 3) @ to_direction.swapaxes(1, 2)
        change, covariance = self._of_parameters
        change = (across @ change).reshape(3 * n, -1)
        found = found.swapaxes(0, 1).reshape(3 * n, 3 * n) + change @ covariance @ change.T
        own = 3 * np.arange(n)[:, None] + np.arange(3)
        found[own[:, :, None], own[:, None]] += self._of_tilts(u)
        return found

    def _of_tilts(self, u):
        """Return what the gyroscope adds to directions that it turns within a rest, (n, 3, 3)."""
        poses = self.recording.poses
        if poses.tilt is None:
            return 0.0
        # the mean of a walk over T, from either end, has a third of the variance at T
        seconds = np.where(poses.tilt > 0, poses.duration_s / 3, 0.0)[:, None, None]
        white = [self.noise.axes[name].N.square for name in ANGULAR_RATE]
        crossed = np.cross(np.eye(3), u[:, None])
        return seconds * (crossed * white) @ crossed.swapaxes(1, 2)

    @cached_property
    def _of_parameters(self):
        """The derivative of specific force with respect to the calibration, and its covariance."""
        calibration, poses = self.calibration, self.recording.poses
        if not calibration.names:
            return np.zeros((len(poses), 3, 0)), np.zeros((0, 0))
        T, K = calibration.T, calibration.K
        raw = calibration.raw_unit.from_si(poses.f) - calibration.b
        channels = self.recording.pose_channels("accelerometer", calibration.output, poses.w)
        output = calibration.output(poses.f) - sum(e.output(channels) for e in calibration.effects)
        columns = {f"T{i}{j}": np.outer(output[:, j], np.eye(3)[i]) for i, j in _UPPER}
        columns |= {f"K{k}": np.outer(raw[:, k], T[:, k]) for k in range(3)}
        columns |= {f"b{k}": np.tile(-K[k] * T[:, k], (len(raw), 1)) for k in range(3)}
        for fitted in calibration.effects:
            design = -T @ fitted.effect.design(channels)
            names = (f"{fitted.name}.{name}" for name in fitted.effect.parameters)
            columns |= dict(zip(names, np.moveaxis(design, 2, 0), strict=True))
        # what a plan leaves out has no column
        known = [k for k, name in enumerate(calibration.names) if name in columns]
        change = np.stack([columns[calibration.names[k]] for k in known], axis=2)
        return change, calibration.covariance[np.ix_(known, known)]

    @cached_property
    def rotations(self):
        """m/s^2, along each rotation, shape (m, k, 3)."""
        calibration, recording = self.calibration, self.recording
        f, w = recording.rotations.f, recording.rotations.w
        channels = recording.rotation_channels("accelerometer", calibration.output, w)
        return calibration.apply(f.reshape(-1, 3), channels).reshape(f.shape)


def calibrated_force(calibration, recording, noise):
    """Return the Force of a recording by an accelerometer's calibration."""
    poses = recording.poses
    channels = recording.pose_channels("accelerometer", calibration.output, poses.w)
    return Force(calibration.apply(poses.f, channels), calibration, recording, noise)
