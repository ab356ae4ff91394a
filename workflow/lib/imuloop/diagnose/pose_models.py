"""The two sensors at the poses: how each is fitted, with or without effects, and what is left."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.calibrate import in_raw_units
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import Effect, FittedEffect
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import RawUnit
from imuloop.diagnose.residuals import Residual, judge
from imuloop.diagnose.trial import Linear


@dataclass(frozen=True)
class Solution:
    """A sensor fitted with some effects.

    Attributes
    ----------
    effects : tuple of Effect
        The effects that were estimated.
    x : ndarray, shape (p,)
        Parameters of the base model, then the effects', SI as logged.
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
    """

    effects: tuple[Effect, ...]
    x: np.ndarray
    calibration: SensorCalibration
    accelerometer: SensorCalibration
    chi2: float
    dof: int
    residuals: dict[str, Residual]
    covariance: np.ndarray
    jacobian: np.ndarray


def linear(values, jacobian, parameters, shapes, kinds, components):
    """Return the `Linear` of residuals whose derivative holds the shapes' columns at its end."""
    widths = [len(shape.parameters) for shape in shapes]
    columns = np.split(jacobian[:, parameters:], np.cumsum(widths)[:-1], axis=1) if shapes else ()
    return Linear(
        values, jacobian[:, :parameters], tuple(shapes), tuple(columns), kinds, components
    )


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
    known : tuple of FittedEffect
        Effects of the accelerometer that are known from elsewhere.
    """

    noise: NoiseModel
    gravity: float
    unit: RawUnit
    settings: CalibrateSettings
    known: tuple[FittedEffect, ...] = ()
    sensor = "accelerometer"

    def at_limits(self):
        """Return the model with `NoiseModel.at_limits`, None where that is None."""
        noise = self.noise.at_limits()
        return noise and replace(self, noise=noise)

    def untestable(self, recording):
        """Return why the data determine no calibration, or None."""
        return accelerometer.untestable_accelerometer(
            recording.poses, self.gravity, self.settings.largest_condition
        ) or recording.poses.unknown_noise(self.noise, ACCELERATION)

    def fit(self, recording, effects=(), start=None):
        """Return the Solution for a recording; the start is as good without another."""
        means = recording.poses.mean_covariance(self.noise)[:3]
        fit, model = accelerometer.fit_accelerometer(
            recording, means, self.gravity, effects, self.known
        )
        calibration = in_raw_units(
            self.unit,
            accelerometer.NAMES,
            fit.x,
            fit.scaled_covariance,
            method="multi_position",
            effects=effects,
            known=self.known,
            reduced_chi2=fit.reduced_chi2,
        )
        predicted = model.covariance(fit.x, means)
        values = model.residuals(fit.x)[0][:, None]
        residual = judge("m/s^2", values, predicted, fit.jacobian, fit.covariance)
        return Solution(
            tuple(effects),
            fit.x,
            calibration,
            calibration,
            fit.chi2,
            fit.dof,
            {"gravity_norm": residual},
            predicted,
            fit.jacobian,
        )

    def linearise(self, solution, recording, shapes=()):
        """Return the residuals of any recording, linear about a solution and in more effects."""
        effects = (*solution.effects, *shapes)
        model = accelerometer.accelerometer_model(
            recording, self.gravity, solution.x, effects, self.known
        )
        p, n = len(solution.x), len(recording.poses)
        x = np.concatenate([solution.x, np.zeros(9 + model.design.shape[2] - p)])
        values, jacobian = model.residuals(x)
        kinds = {"gravity_norm": np.arange(n)[:, None].repeat(2, axis=1)}
        return linear(values, jacobian, p, shapes, kinds, {"gravity_norm": 1})

    def covariance(self, solution, recording):
        """Return the predicted covariance of the residuals of any recording."""
        model = self._model(solution, recording)
        return model.covariance(solution.x, recording.poses.mean_covariance(self.noise)[:3])

    def effect_sizes(self, solution, recording):
        """Return what one unit of each effect's parameter does, root mean square, (p,), SI."""
        return _size(self._model(solution, recording).design)

    def _model(self, solution, recording):
        return accelerometer.accelerometer_model(
            recording, self.gravity, solution.x, solution.effects, self.known
        )


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
    force_effects : tuple of Effect
        Effects that the accelerometer's model has.
    unit : RawUnit
        Unit of the log.
    known : tuple of FittedEffect
        Effects of the gyroscope that are known from elsewhere.
    """

    force: AccelerometerPoses
    fallback: SensorCalibration | None
    force_effects: tuple[Effect, ...]
    unit: RawUnit
    known: tuple[FittedEffect, ...] = ()
    sensor = "gyroscope"

    def at_limits(self):
        """Return the model with `NoiseModel.at_limits`, None where that is None."""
        force = self.force.at_limits()
        return force and replace(self, force=force)

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
        force = calibrated_force(self._force(recording), recording, self.force.noise)
        return gyroscope.untestable_gyroscope(
            recording, force, self.force.settings.largest_condition
        )

    def fit(self, recording, effects=(), start=None):
        """Return the Solution for a recording, from the parameters of one with fewer effects."""
        noise = self.force.noise
        accelerometer_calibration = self._force(recording)
        force = calibrated_force(accelerometer_calibration, recording, noise)
        fit, model, covariance = gyroscope.fit_gyroscope(
            recording, force, noise, effects=effects, known=self.known, start=start
        )
        calibration = in_raw_units(
            self.unit,
            gyroscope.NAMES,
            fit.x,
            fit.scaled_covariance,
            method="multi_position",
            effects=effects,
            known=self.known,
            reduced_chi2=fit.reduced_chi2,
        )
        split = 3 * len(recording.poses)
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
            fit.x,
            calibration,
            accelerometer_calibration,
            fit.chi2,
            fit.dof,
            judged,
            covariance,
            fit.jacobian,
        )

    def linearise(self, solution, recording, shapes=()):
        """Return the residuals of any recording, linear about a solution and in more effects."""
        force = calibrated_force(solution.accelerometer, recording, self.force.noise)
        effects = (*solution.effects, *shapes)
        model = gyroscope.gyroscope_model(recording, force, solution.x, effects, self.known)
        p, n = len(solution.x), len(recording.poses)
        x = np.concatenate([solution.x, np.zeros(12 + model.rate_design.shape[2] - p)])
        values, jacobian = model.residuals(x)
        first = recording.rotations.first
        kinds = {
            "pose_rate": np.arange(n)[:, None].repeat(2, axis=1),
            "rotation": np.column_stack([first, first + 1]),
        }
        return linear(values, jacobian, p, shapes, kinds, {"pose_rate": 3, "rotation": 2})

    def covariance(self, solution, recording):
        """Return the predicted covariance of the residuals of any recording."""
        noise, poses = self.force.noise, recording.poses
        model, force = self._model(solution, recording)
        errors = gyroscope.rotation_covariance(
            model, solution.x, poses.session, force.direction_covariance, noise
        )
        return gyroscope.residual_covariance(poses.mean_covariance(noise)[3:], errors)

    def effect_sizes(self, solution, recording):
        """Return what one unit of each effect's parameter does, root mean square, (p,), SI.

        At the poses or along the rotations, whichever is more.
        """
        model, _ = self._model(solution, recording)
        along = model.rotation_design.reshape(-1, *model.rotation_design.shape[2:])
        return np.maximum(_size(model.rate_design), _size(along))

    def _model(self, solution, recording):
        force = calibrated_force(solution.accelerometer, recording, self.force.noise)
        model = gyroscope.gyroscope_model(
            recording, force, solution.x, solution.effects, self.known
        )
        return model, force


def _size(design):
    """Return the root mean square of the vectors of a design, (n, 3, p) to (p,)."""
    return np.sqrt((design**2).sum(axis=1).mean(axis=0))
