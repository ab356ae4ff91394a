"""The two sensors at the poses: how each is fitted, with or without effects, and what is left."""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.calibrate import direction_unknown
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import Effect, FittedEffect
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import RawUnit
from imuloop.diagnose.refit import refit
from imuloop.diagnose.solution import (
    Solution,
    fitted_calibration,
    inside_of,
    key_of,
    linear,
    padded,
    size_of,
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
    # fits by effects and poses: the gyroscope's take the same as the accelerometer's
    _fits: dict = field(default_factory=dict, init=False, compare=False, repr=False)
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

    def lost(self, solution):
        """Return why a fit is none, or None if it is one."""
        return accelerometer.lost_accelerometer(
            solution.fit, self.gravity, self.settings.largest_condition
        )

    def undetermined(self, recording, keeps):
        """Return for each mask of poses whether these alone determine no calibration."""
        condition = self.settings.largest_condition
        return [
            accelerometer.untestable_accelerometer(
                recording.poses.select(keep), self.gravity, condition
            )
            is not None
            for keep in keeps
        ]

    def fit(self, recording, effects=(), start=None):
        """Return the Solution for a recording; the start is as good without another."""
        key = key_of(effects, recording.poses)
        if key not in self._fits:
            means = recording.poses.mean_covariance(self.noise)[:3]
            fit, model = accelerometer.fit_accelerometer(
                recording, means, self.gravity, effects, self.known
            )
            values, covariance = model.residuals(fit.x)[0], model.covariance(fit.x, means)
            self._fits[key] = self._solution(fit, effects, values, covariance)
        return self._fits[key]

    def refit(self, recording, keep, effects, start):
        """Return the Solution for some poses, from a start nearby, and its Refit; None without.

        Parameters
        ----------
        recording : Recording
            All poses, n of them.
        keep : ndarray of bool, shape (n,)
            The poses to fit.
        effects : sequence of Effect
            Effects to estimate.
        start : ndarray
            First parameters.
        """
        poses = recording.poses.select(keep)
        means = poses.mean_covariance(self.noise)[:3]

        def evaluate(x):
            model = self._model(recording, x, effects)
            own = replace(
                model, y=model.y[keep], design=model.design[keep], known=model.known[keep]
            )
            return *model.residuals(x), own.covariance(x, means)

        found = refit(evaluate, keep, padded(start, 9, effects))
        if found is None:
            return None
        solution = self._solution(found.fit, effects, found.values[keep], found.covariance)
        self._fits[key_of(effects, poses)] = solution
        return solution, found

    def _solution(self, fit, effects, values, covariance):
        calibration = fitted_calibration(self, accelerometer.NAMES, fit, effects)
        parts = {"gravity_norm": ("m/s^2", 1, slice(None))}
        return Solution(tuple(effects), fit, values, covariance, parts, calibration, calibration)

    def linearise(self, solution, recording, shapes=()):
        """Return the residuals of any recording, linear about a solution and in more effects."""
        model = self._model(recording, solution.fit.x, (*solution.effects, *shapes))
        p = len(solution.fit.x)
        x = np.concatenate([solution.fit.x, np.zeros(9 + model.design.shape[2] - p)])
        return linear(*model.residuals(x), p, shapes, *self.kinds(recording))

    def kinds(self, recording):
        """Return the kinds and components of the residuals of a recording, as `Linear` has them."""
        poses = np.arange(len(recording.poses))
        return {"gravity_norm": poses[:, None].repeat(2, axis=1)}, {"gravity_norm": 1}

    def covariance(self, solution, recording):
        """Return the predicted covariance of the residuals of any recording."""
        model = self._model(recording, solution.fit.x, solution.effects)
        return model.covariance(solution.fit.x, recording.poses.mean_covariance(self.noise)[:3])

    def effect_sizes(self, solution, recording):
        """Return what one unit of each effect's parameter does, root mean square, (p,), SI."""
        return size_of(self._model(recording, solution.fit.x, solution.effects).design)

    def _model(self, recording, x, effects):
        return accelerometer.accelerometer_model(recording, self.gravity, x, effects, self.known)


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
    # the path of all rotations at the last start, which the fits of all parts share
    _start: dict = field(default_factory=dict, compare=False, repr=False)
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
        if self.fallback is not None and (reason := direction_unknown(self.fallback)):
            return reason
        if reason := recording.poses.unknown_noise(self.force.noise, ANGULAR_RATE):
            return reason
        force = calibrated_force(self._force(recording), recording, self.force.noise)
        return gyroscope.untestable_gyroscope(
            recording, force, self.force.settings.largest_condition
        )

    def lost(self, solution):
        """Return why a fit is none, or None if it is one."""
        _, components, at = solution.parts["rotation"]
        rotations = len(solution.values[at]) // components
        return gyroscope.lost_gyroscope(
            solution.fit, rotations, self.force.settings.largest_condition
        )

    def fit(self, recording, effects=(), start=None):
        """Return the Solution for a recording, from the parameters of one with fewer effects."""
        noise = self.force.noise
        calibration = self._force(recording)
        force = calibrated_force(calibration, recording, noise)
        fit, model, covariance = gyroscope.fit_gyroscope(
            recording, force, noise, effects=effects, known=self.known, start=start
        )
        values, poses = model.residuals(fit.x)[0], len(recording.poses)
        return self._solution(fit, effects, values, covariance, poses, calibration)

    def undetermined(self, recording, keeps):
        """Return for each mask of poses whether these alone determine no calibration."""
        lacking = [False] * len(keeps)
        if self.fallback is None:
            lacking = self.force.undetermined(recording, keeps)
        force = calibrated_force(self._force(recording), recording, self.force.noise)
        # the design, but for what the parameters of a part differ by
        jacobian = gyroscope.start_derivative(recording, force)
        inside = [inside_of(recording, keep) for keep in keeps]
        condition = self.force.settings.largest_condition
        return [
            lacks or gyroscope.undetermined(jacobian[rows], condition) is not None
            for lacks, rows in zip(lacking, inside, strict=True)
        ]

    def refit(self, recording, keep, effects, start):
        """Return the Solution for some poses, from a start nearby, and its Refit; None without.

        As of the accelerometer, with the rotations between two poses that are kept.
        """
        noise, seen = self.force.noise, recording.select(keep)
        calibration = self._force(seen)
        part = calibrated_force(calibration, seen, noise)
        poses, inside = recording.poses, inside_of(recording, keep)
        channels = recording.pose_channels("accelerometer", calibration.output, poses.w)
        force = replace(part, poses=calibration.apply(poses.f, channels), recording=recording)
        means = seen.poses.mean_covariance(noise)[3:]
        start, shared = padded(start, 12, effects), not effects and not self.known

        fitted = None

        def evaluate(x):
            nonlocal fitted
            model = gyroscope.gyroscope_model(recording, force, x, effects, self.known)
            if shared and np.array_equal(x, start):
                model = replace(model, _paths=self._start)
            values, jacobian = model.residuals(x)
            own = gyroscope.seen_only(model, x, keep, inside, seen.rotations)
            fitted = own, x
            errors = gyroscope.rotation_covariance(
                own, x, seen.poses.run, part.direction_covariance, noise
            )
            return values, jacobian, gyroscope.residual_covariance(means, errors)

        rows = np.concatenate([np.repeat(keep, 3), np.repeat(inside, 2)])
        found = refit(evaluate, rows, start)
        if found is None:
            return None
        solution = self._solution(
            found.fit, effects, found.values[rows], found.covariance, len(seen.poses), calibration
        )
        return replace(solution, fitted=fitted), found

    def _solution(self, fit, effects, values, covariance, poses, force):
        calibration = fitted_calibration(self, gyroscope.NAMES, fit, effects)
        parts = {
            "pose_rate": ("rad/s", 3, slice(0, 3 * poses)),
            "rotation": ("rad", 2, slice(3 * poses, None)),
        }
        return Solution(tuple(effects), fit, values, covariance, parts, calibration, force)

    def linearise(self, solution, recording, shapes=()):
        """Return the residuals of any recording, linear about a solution and in more effects."""
        force = calibrated_force(solution.accelerometer, recording, self.force.noise)
        effects = (*solution.effects, *shapes)
        model = gyroscope.gyroscope_model(recording, force, solution.fit.x, effects, self.known)
        p = len(solution.fit.x)
        x = np.concatenate([solution.fit.x, np.zeros(12 + model.rate_design.shape[2] - p)])
        return linear(*model.residuals(x), p, shapes, *self.kinds(recording))

    def kinds(self, recording):
        """Return the kinds and components of the residuals of a recording, as `Linear` has them."""
        poses, first = np.arange(len(recording.poses)), recording.rotations.first
        kinds = {
            "pose_rate": poses[:, None].repeat(2, axis=1),
            "rotation": np.column_stack([first, first + 1]),
        }
        return kinds, {"pose_rate": 3, "rotation": 2}

    def covariance(self, solution, recording):
        """Return the predicted covariance of the residuals of any recording."""
        noise, poses = self.force.noise, recording.poses
        model, x = solution.fitted or (None, None)
        if model is not None and np.array_equal(model.rate, poses.w):
            force = calibrated_force(solution.accelerometer, recording, noise)
        else:
            x, (model, force) = solution.fit.x, self._model(solution, recording)
        errors = gyroscope.rotation_covariance(
            model, x, poses.run, force.direction_covariance, noise
        )
        return gyroscope.residual_covariance(poses.mean_covariance(noise)[3:], errors)

    def effect_sizes(self, solution, recording):
        """Return what one unit of each effect's parameter does, root mean square, (p,), SI.

        At the poses or along the rotations, whichever is more.
        """
        model, _ = self._model(solution, recording)
        along = model.rotation_design.reshape(-1, *model.rotation_design.shape[2:])
        return np.maximum(size_of(model.rate_design), size_of(along))

    def _model(self, solution, recording):
        force = calibrated_force(solution.accelerometer, recording, self.force.noise)
        model = gyroscope.gyroscope_model(
            recording, force, solution.fit.x, solution.effects, self.known
        )
        return model, force
