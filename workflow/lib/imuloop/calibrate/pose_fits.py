"""The two sensors at the poses: how each is fitted, with or without effects, and what is left."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.linalg import block_diag

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.least_squares import Fit
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import Effect, FittedEffect
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import RawUnit


@dataclass(frozen=True)
class Solution:
    """A sensor fitted to poses with some effects.

    Attributes
    ----------
    effects : tuple of Effect
        The effects that were estimated.
    fit : Fit
        Parameters of the base model, then the effects', SI as logged.
    accelerometer : SensorCalibration or None
        Calibration that gave the direction of gravity; None of an accelerometer.
    calibration : SensorCalibration or None
        Fitted calibration; None while nobody needs it.
    """

    effects: tuple[Effect, ...]
    fit: Fit
    accelerometer: SensorCalibration | None
    calibration: SensorCalibration | None = None


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
    names = accelerometer.NAMES
    # kinds of residuals: SI unit and components
    kinds: ClassVar = {"gravity_norm": ("m/s^2", 1)}

    def untestable(self, recording):
        """Return why the data determine no calibration, or None."""
        return accelerometer.untestable_accelerometer(
            recording.poses, self.gravity, self.settings.largest_condition
        ) or recording.poses.unknown_noise(self.noise, ACCELERATION)

    def lost(self, solution, recording):
        """Return why a fit is none, or None if it is one."""
        condition = self.settings.largest_condition
        return accelerometer.lost_accelerometer(solution.fit, self.gravity, condition)

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

    def fit(self, recording, effects=(), start=None, prior=None):
        """Return the Solution for a recording; the start is as good without another.

        Parameters
        ----------
        recording : Recording
            Poses.
        effects : sequence of Effect
            Effects to estimate.
        start : ndarray, optional
            Parameters of a fit with fewer effects.
        prior : (ndarray, ndarray), optional
            What other data tell of the parameters, as of `least_squares.fit`.
        """
        means = recording.poses.mean_covariance(self.noise)[:3]
        fit, _ = accelerometer.fit_accelerometer(
            recording, means, self.gravity, effects, prior=prior
        )
        return Solution(tuple(effects), fit, None)

    def rows(self, recording):
        """Return the poses where each residual starts and ends, (N, 2), and its kind, (N,)."""
        poses = np.arange(len(recording.poses))
        return np.column_stack([poses, poses]), np.zeros(len(poses), dtype=int)

    def model(self, solution, recording, shapes=()):
        """Return the AccelerometerModel of any recording about a solution, with more effects."""
        effects = (*solution.effects, *shapes)
        return accelerometer.accelerometer_model(recording, self.gravity, solution.fit.x, effects)

    def covariance(self, solution, recording, noise=None):
        """Return the covariance of the residuals of any recording, by a noise model."""
        means = recording.poses.mean_covariance(noise or self.noise)[:3]
        return self.model(solution, recording).covariance(solution.fit.x, means)

    def directions(self, solution, recording):
        """Return gravity's direction at the poses, shape (n, 3)."""
        force, _ = self.model(solution, recording).force(solution.fit.x)
        return force / np.linalg.norm(force, axis=1, keepdims=True)

    def effect_sizes(self, solution, recording):
        """Return what one unit of each effect's parameter does, root mean square, (p,), SI."""
        return size_of(self.model(solution, recording).design)


@dataclass(frozen=True)
class GyroscopePoses:
    """The gyroscope at the poses: no rate at rest, and rotations carry gravity to the next pose.

    Attributes
    ----------
    noise : NoiseModel
        Noise of the device.
    accelerometer : SensorCalibration
        Calibration of the accelerometer of the same device.
    unit : RawUnit
        Unit of the log.
    settings : CalibrateSettings
        Settings of the calibration.
    bias : tuple of two ndarrays, shape (3,), optional
        Bias and its variance, rad/s as logged, where it is held instead of estimated.
    """

    noise: NoiseModel
    accelerometer: SensorCalibration
    unit: RawUnit
    settings: CalibrateSettings
    bias: tuple[np.ndarray, np.ndarray] | None = None
    sensor = "gyroscope"
    names = gyroscope.NAMES
    kinds: ClassVar = {"pose_rate": ("rad/s", 3), "rotation": ("rad", 2)}

    def untestable(self, recording):
        """Return why the data determine no calibration, or None."""
        if not len(recording.poses):
            return "no multi_position session with a pose"
        return (
            direction_unknown(self.accelerometer)
            or recording.poses.unknown_noise(self.noise, ANGULAR_RATE)
            or gyroscope.untestable_gyroscope(
                recording, self._force(recording), self.settings.largest_condition
            )
        )

    def lost(self, solution, recording):
        """Return why a fit is none, or None if it is one."""
        condition = self.settings.largest_condition
        return gyroscope.lost_gyroscope(solution.fit, len(recording.rotations), condition)

    def undetermined(self, recording, keeps):
        """Return for each mask of poses whether these alone determine no calibration."""
        # the design, but for what the parameters of a part differ by
        jacobian = gyroscope.start_derivative(recording, self._force(recording))
        condition, first = self.settings.largest_condition, recording.rotations.first
        return [
            gyroscope.undetermined(jacobian[keep[first] & keep[first + 1]], condition) is not None
            for keep in keeps
        ]

    def fit(self, recording, effects=(), start=None, prior=None):
        """Return the Solution for a recording; arguments as of the accelerometer."""
        fit, _, _ = gyroscope.fit_gyroscope(
            recording,
            self._force(recording),
            self.noise,
            effects=effects,
            bias=None if self.bias is None else self.bias[0],
            start=start,
            prior=prior,
        )
        return Solution(tuple(effects), fit, self.accelerometer)

    def rows(self, recording):
        """Return the poses where each residual starts and ends, (N, 2), and its kind, (N,)."""
        poses, first = np.arange(len(recording.poses)), recording.rotations.first
        ends = np.concatenate([np.repeat(poses, 3), np.repeat(first, 2)])
        kind = np.repeat([0, 1], [3 * len(poses), 2 * len(first)])
        return np.column_stack([ends, ends + kind]), kind

    def model(self, solution, recording, shapes=()):
        """Return the GyroscopeModel of any recording about a solution, with more effects."""
        force = calibrated_force(solution.accelerometer, recording, self.noise)
        effects = (*solution.effects, *shapes)
        return gyroscope.gyroscope_model(recording, force, solution.fit.x, effects)

    def covariance(self, solution, recording, noise=None):
        """Return the covariance of the residuals of any recording, by a noise model."""
        noise, poses = noise or self.noise, recording.poses
        force = calibrated_force(solution.accelerometer, recording, noise)
        model = self.model(solution, recording)
        return gyroscope.residual_covariance(
            model, solution.fit.x, poses, force.direction_covariance, noise
        )

    def effect_sizes(self, solution, recording):
        """Return what one unit of each effect's parameter does, root mean square, (p,), SI.

        At the poses or along the rotations, whichever is more.
        """
        model = self.model(solution, recording)
        along = model.rotation_design.reshape(-1, *model.rotation_design.shape[2:])
        return np.maximum(size_of(model.rate_design), size_of(along))

    def _force(self, recording):
        return calibrated_force(self.accelerometer, recording, self.noise)


def residuals(model, x):
    """Return residuals and their derivative at x, the parameters of further effects zero."""
    count = model.start().shape[0]
    return model.residuals(np.append(x, np.zeros(count - len(x))))


def in_raw_units(unit, base, x, covariance, *, method, effects=(), known=(), reduced_chi2=None):
    """Return the calibration that parameters in SI as logged stand for, in raw units.

    ``K_raw = K s`` and ``b_raw = b / s + offset`` for ``SI = s (raw - offset)``.

    Parameters
    ----------
    unit : RawUnit
        Unit of the log.
    base : tuple of str
        Names of the base parameters: misalignment, three scale factors, three biases.
    x : ndarray, shape (p,)
        The base parameters, then those of the effects; SI as logged.
    covariance : ndarray, shape (p, p)
        Theirs.
    method : {'multi_position', 'six_position'}
        What they come from.
    effects : sequence of Effect
        The effects whose parameters follow the base's.
    known : sequence of FittedEffect
        Effects that are known from elsewhere.
    reduced_chi2 : float, optional
        Of the fit.

    Returns
    -------
    SensorCalibration
        Names of an effect's parameters begin with its own: ``g_sensitivity.G00``.
    """
    count = len(base)
    factor = np.ones(len(x))
    factor[count - 6 : count - 3] = unit.scale
    factor[count - 3 : count] = 1 / unit.scale
    raw = x * factor
    T = np.eye(3)
    for name, value in zip(base[:-6], x[: count - 6], strict=True):
        T[int(name[1]), int(name[2])] = value
    std = np.sqrt(np.diag(covariance))
    fitted, names, at = [], list(base), count
    for effect in effects:
        part = slice(at, at + len(effect.parameters))
        fitted.append(
            FittedEffect(
                effect,
                dict(zip(effect.parameters, x[part].tolist(), strict=True)),
                dict(zip(effect.parameters, std[part].tolist(), strict=True)),
            )
        )
        names += [f"{effect.name}.{p}" for p in effect.parameters]
        at = part.stop
    return SensorCalibration(
        raw_unit=unit,
        T=T,
        K=raw[count - 6 : count - 3],
        b=raw[count - 3 : count] + unit.offset,
        names=tuple(names),
        covariance=covariance * np.outer(factor, factor),
        effects=(*known, *fitted),
        method=method,
        reduced_chi2=reduced_chi2,
    )


def fitted_calibration(sensor, solution, covariance=None):
    """Return the calibration of a solution; its variances grow with what it leaves unexplained."""
    fit = solution.fit
    covariance = fit.scaled_covariance if covariance is None else covariance
    if len(covariance) < len(fit.x):
        # of a bias that was held
        covariance = block_diag(covariance, np.diag(sensor.bias[1]))
    return in_raw_units(
        sensor.unit,
        sensor.names,
        fit.x,
        covariance,
        method="multi_position",
        effects=solution.effects,
        reduced_chi2=fit.reduced_chi2,
    )


def direction_unknown(force):
    """Return why the direction of gravity at the poses is not known, or None if it is.

    An accelerometer as its data sheet has it may be degrees off: what a gyroscope fits to that is
    no better than its own data sheet. One that is nominal for no reason is taken as known.

    Parameters
    ----------
    force : SensorCalibration
        The best of the accelerometer.
    """
    if force.method != "nominal" or force.not_testable is None:
        return None
    return f"direction of gravity not known: {force.not_testable}"


def size_of(design):
    """Return the root mean square of the vectors of a design, (n, 3, p) to (p,)."""
    return np.sqrt((design**2).sum(axis=1).mean(axis=0))
