"""The two sensors at the poses: how each is fitted, with or without effects, and what is left."""

from dataclasses import dataclass

import numpy as np

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.calibrate import in_raw_units
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import RawUnit
from imuloop.diagnose import residuals
from imuloop.diagnose.residuals import Residual, judge


@dataclass(frozen=True)
class Solution:
    """A sensor fitted with some effects.

    Attributes
    ----------
    effects : tuple of type
        Classes of the effects in the fit.
    calibration : SensorCalibration
        Fitted calibration.
    accelerometer : SensorCalibration
        Calibration that gave the direction of gravity.
    chi2, dof : float, int
        Of the whole fit, against the noise model.
    residuals : dict of str to Residual
        Each kind of residual of the sensor, on the data of the fit.
    covariance : ndarray, shape (n, n)
        Predicted covariance of all residuals, kind after kind.
    jacobian : ndarray, shape (n, p)
        Their derivative with respect to all parameters.
    parameters : ndarray, shape (p, p)
        Covariance of all parameters from the noise alone.
    """

    effects: tuple
    calibration: SensorCalibration
    accelerometer: SensorCalibration
    chi2: float
    dof: int
    residuals: dict[str, Residual]
    covariance: np.ndarray
    jacobian: np.ndarray
    parameters: np.ndarray


@dataclass(frozen=True)
class AccelerometerPoses:
    """The accelerometer at the poses: the norm of specific force is gravity.

    Attributes
    ----------
    noise : NoiseModel
        Noise of the device.
    gravity : float
        m/s^2.
    unit : RawUnit
        Unit of the log.
    settings : CalibrateSettings
        Settings of the calibration.
    """

    noise: NoiseModel
    gravity: float
    unit: RawUnit
    settings: CalibrateSettings
    sensor = "accelerometer"
    # the residual that a ranking of effects goes by
    headline = "gravity_norm"

    def untestable(self, recording):
        """Return why the data determine no calibration, or None."""
        return accelerometer.untestable_accelerometer(
            recording.poses, self.gravity, self.settings.largest_condition
        ) or recording.poses.unknown_noise(self.noise, ACCELERATION)

    def fit(self, recording, effects=()):
        """Return the Solution for a recording."""
        means = recording.poses.mean_covariance(self.noise)[:3]
        fit, model = accelerometer.fit_accelerometer(recording.poses, means, self.gravity, effects)
        calibration = in_raw_units(
            self.unit,
            accelerometer.NAMES,
            fit.x,
            fit.scaled_covariance,
            method="multi_position",
            effects=effects,
            reduced_chi2=fit.reduced_chi2,
        )
        predicted = model.covariance(fit.x, means)
        values = model.residuals(fit.x)[0][:, None]
        residual = judge("m/s^2", values, predicted, fit.jacobian, fit.covariance)
        return Solution(
            tuple(effects),
            calibration,
            calibration,
            fit.chi2,
            fit.dof,
            {"gravity_norm": residual},
            predicted,
            fit.jacobian,
            fit.covariance,
        )

    def errors(self, solution, recording):
        """Return the residuals of any recording and, for each, the poses it starts and ends at."""
        values = residuals.gravity_norm(solution.calibration, self.gravity, recording.poses)
        return {"gravity_norm": (values, np.arange(len(values))[:, None].repeat(2, axis=1))}


@dataclass(frozen=True)
class GyroscopePoses:
    """The gyroscope at the poses: no rate at rest, and rotations carry gravity to the next pose.

    Attributes
    ----------
    force : AccelerometerPoses
        The accelerometer of the same device, fitted to the same poses.
    fallback : SensorCalibration or None
        Calibration of the accelerometer from elsewhere, where all poses together determine none;
        else None: each fit calibrates the accelerometer with its own poses, held-out ones unseen.
    force_effects : tuple of type
        Effects that the accelerometer's model has.
    unit : RawUnit
        Unit of the log.
    """

    force: AccelerometerPoses
    fallback: SensorCalibration | None
    force_effects: tuple
    unit: RawUnit
    sensor = "gyroscope"
    headline = "pose_rate"

    def _force(self, recording):
        if self.fallback is not None:
            return self.fallback
        return self.force.fit(recording, self.force_effects).calibration

    def untestable(self, recording):
        """Return why the data determine no calibration, or None."""
        if not len(recording.poses):
            return "no multi_position session with a pose"
        if self.fallback is None and (reason := self.force.untestable(recording)):
            return f"direction of gravity not known: {reason}"
        if reason := recording.poses.unknown_noise(self.force.noise, ANGULAR_RATE):
            return reason
        force = calibrated_force(
            self._force(recording), recording.poses, recording.rotations, self.force.noise
        )
        return gyroscope.untestable_gyroscope(
            recording.poses,
            recording.rotations,
            force,
            self.force.settings.largest_condition,
        )

    def fit(self, recording, effects=()):
        """Return the Solution for a recording."""
        poses, rotations = recording.poses, recording.rotations
        noise = self.force.noise
        accelerometer_calibration = self._force(recording)
        force = calibrated_force(accelerometer_calibration, poses, rotations, noise)
        fit, model, covariance = gyroscope.fit_gyroscope(
            poses, rotations, force, noise, effects=effects
        )
        calibration = in_raw_units(
            self.unit,
            gyroscope.NAMES,
            fit.x,
            fit.scaled_covariance,
            method="multi_position",
            effects=effects,
            reduced_chi2=fit.reduced_chi2,
        )
        split = 3 * len(poses)
        parts = {
            "pose_rate": ("rad/s", model.pose_rates(fit.x)[0], slice(0, split)),
            "rotation": ("rad", model.rotation_errors(fit.x)[0], slice(split, None)),
        }
        judged = {
            kind: judge(unit, values, covariance[at, at], fit.jacobian[at], fit.covariance)
            for kind, (unit, values, at) in parts.items()
        }
        return Solution(
            tuple(effects),
            calibration,
            accelerometer_calibration,
            fit.chi2,
            fit.dof,
            judged,
            covariance,
            fit.jacobian,
            fit.covariance,
        )

    def errors(self, solution, recording):
        """Return the residuals of any recording and, for each, the poses it starts and ends at."""
        force = calibrated_force(
            solution.accelerometer, recording.poses, recording.rotations, self.force.noise
        )
        rates = residuals.pose_rate(solution.calibration, force, recording.poses)
        turns = residuals.rotation(solution.calibration, force, recording)
        first = recording.rotations.first
        return {
            "pose_rate": (rates, np.arange(len(rates))[:, None].repeat(2, axis=1)),
            "rotation": (turns, np.column_stack([first, first + 1])),
        }
