"""Calibrated specific force where the gyroscope needs it: at the poses and along the rotations."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imuloop.calibrate.recording import Recording
from imuloop.core.model import SensorCalibration


@dataclass(frozen=True)
class Force:
    """Calibrated specific force.

    Attributes
    ----------
    poses : ndarray, shape (n, 3)
        m/s^2, at each pose.
    direction_covariance : ndarray, shape (3 n, 3 n)
        Covariance of the unit vectors at the poses, pose by pose.
    calibration : SensorCalibration
        Of the accelerometer.
    recording : Recording
        Poses, n of them, and rotations, m of k samples.
    """

    poses: np.ndarray
    direction_covariance: np.ndarray
    calibration: SensorCalibration
    recording: Recording

    @cached_property
    def rotations(self):
        """m/s^2, along each rotation, shape (m, k, 3)."""
        calibration, rotations = self.calibration, self.recording.rotations
        along = calibration.apply(
            rotations.f.reshape(-1, 3),
            self.recording.rotation_channels("accelerometer", calibration.output, rotations.w),
        )
        return along.reshape(rotations.f.shape)


def calibrated_force(calibration, recording, noise):
    """Return calibrated specific force at the poses and along the rotations.

    The direction ``u = f / |f|`` has the error ``δu = (I - u uᵀ) T K δy / |f|`` from that of the
    pose's mean.

    Parameters
    ----------
    calibration : SensorCalibration
        Of the accelerometer.
    recording : Recording
        Poses, n of them, and rotations, m of k samples.
    noise : NoiseModel
        Noise of the device.
    """
    poses = recording.poses
    at_poses = calibration.apply(
        poses.f, recording.pose_channels("accelerometer", calibration.output, poses.w)
    )
    norm = np.linalg.norm(at_poses, axis=1)[:, None]
    u = at_poses / norm
    across = np.eye(3) - u[:, :, None] * u[:, None, :]
    scale = calibration.K / calibration.raw_unit.scale
    to_direction = across @ (calibration.T * scale) / norm[:, None]
    n = len(poses)
    means = poses.mean_covariance(noise)[:3]
    covariance = np.einsum("iab,bij,jcb->iajc", to_direction, means, to_direction)
    return Force(at_poses, covariance.reshape(3 * n, 3 * n), calibration, recording)
