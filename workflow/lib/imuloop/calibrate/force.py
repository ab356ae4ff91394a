"""Calibrated specific force where the gyroscope needs it: at the poses and along the rotations."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Force:
    """Calibrated specific force.

    Attributes
    ----------
    poses : ndarray, shape (n, 3)
        m/s^2, at each pose.
    rotations : ndarray, shape (m, k, 3)
        m/s^2, along each rotation.
    direction_covariance : ndarray, shape (3 n, 3 n)
        Covariance of the unit vectors at the poses, pose by pose.
    """

    poses: np.ndarray
    rotations: np.ndarray
    direction_covariance: np.ndarray


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
    poses, rotations = recording.poses, recording.rotations
    sensor = "accelerometer"
    at_poses = calibration.apply(
        poses.f, recording.pose_channels(sensor, calibration.output, poses.w)
    )
    along = calibration.apply(
        rotations.f.reshape(-1, 3),
        recording.rotation_channels(sensor, calibration.output, rotations.w),
    )
    norm = np.linalg.norm(at_poses, axis=1)[:, None]
    u = at_poses / norm
    across = np.eye(3) - u[:, :, None] * u[:, None, :]
    scale = calibration.K / calibration.raw_unit.scale
    to_direction = across @ (calibration.T * scale) / norm[:, None]
    n = len(poses)
    means = poses.mean_covariance(noise)[:3]
    covariance = np.einsum("iab,bij,jcb->iajc", to_direction, means, to_direction)
    return Force(at_poses, along.reshape(rotations.f.shape), covariance.reshape(3 * n, 3 * n))
