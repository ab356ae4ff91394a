"""The two sensors at the poses: how each is fitted, with or without effects, and what is left."""

from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
from scipy.linalg import block_diag

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.least_squares import FitResult, condition_number, fit, too_large
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import Effect, FittedEffect
from imuloop.core.errors import plural
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import RawUnit

# the axes of an accelerometer, cheap ones and three glued to a cube too, are less off square, rad
SLANT = 0.3
# what data sheets of MEMS gyroscopes allow: misalignment, rad; scale factor, 1
AXES, SCALE = 0.02, 0.03
NO_POSE = "no multi_position session with a pose"


@dataclass(frozen=True)
class Solution:
    """A sensor fitted to poses: the effects that were estimated, and the calibration, if needed.

    The fit has the parameters of the base model, then the effects', SI as logged.
    """

    effects: tuple[Effect, ...]
    fit: FitResult
    calibration: SensorCalibration | None = None


class SensorPoses:
    """A sensor at the poses: its model about parameters, and the covariance of its residuals."""

    # bias and its variance, where it is held instead of estimated
    bias = None

    def fit(self, recording, effects=(), start=None, prior=None):
        """Return the Solution for a recording.

        All residuals together, weighted with the covariance that the noise model predicts. A bias
        that is held is not in the fit's covariance and derivative. `start` are parameters of a fit
        with fewer effects, `prior` is what other data tell, as of `least_squares.fit`.

        References
        ----------
        Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration
        without external equipments", ICRA 2014, section IV.
        """
        x = self.model_at(None, recording, effects).start()
        if start is not None:
            x[: len(start)] = start
        free = np.ones(len(x), dtype=bool)
        if self.bias is not None:
            x[9:12], free[9:12] = self.bias[0], False
        # weights and effects depend on the calibrated output, which the start gives to 1 %
        for _ in range(3 if start is None and effects else 2):
            model = self.model_at(x, recording, effects)
            covariance = self.covariance_at(x, model, recording, self.noise)
            found = fit(partial(_of_free, model, x, free), x[free], covariance, prior)
            x[free] = found.x
        return Solution(tuple(effects), replace(found, x=x))

    def model(self, solution, recording, shapes=()):
        """Return the model of any recording about a solution, with more effects."""
        return self.model_at(solution.fit.x, recording, (*solution.effects, *shapes))

    def covariances(self, solution, recording):
        """Return what gives the covariance of the residuals of a recording by a noise model."""
        model = self.model(solution, recording)
        return partial(self.covariance_at, solution.fit.x, model, recording)


@dataclass(frozen=True)
class AccelerometerPoses(SensorPoses):
    """The accelerometer at the poses: the norm of specific force is gravity, m/s^2."""

    noise: NoiseModel
    gravity: float
    unit: RawUnit
    settings: CalibrateSettings
    sensor = "accelerometer"
    axes = ACCELERATION
    names = accelerometer.NAMES
    # kinds of residuals: SI unit and components
    kinds: ClassVar = {"gravity_norm": ("m/s^2", 1)}

    def untestable(self, recording):
        """Return why the data determine no calibration, or None."""
        silent = partial(recording.poses.unknown_noise, self.noise, ACCELERATION)
        return self._undetermined(recording.poses) or silent()

    def undetermined(self, recording, keeps):
        """Return for each mask of poses whether these alone determine no calibration."""
        return [self._undetermined(recording.poses.select(keep)) is not None for keep in keeps]

    def _undetermined(self, poses):
        """Return why the poses do not determine the nine parameters, or None if they do."""
        n, needed, largest = len(poses), len(self.names) + 1, self.settings.largest_condition
        if not n:
            return NO_POSE
        if n < needed:
            return (
                f"{plural(n, 'pose')} found, at least {needed} needed for 9 parameters and a check"
            )
        model = accelerometer.AccelerometerModel(poses.f, np.zeros((n, 3, 0)), self.gravity)
        x = model.start()
        condition = self._condition(model.residuals(x)[1], x)
        if condition <= largest:
            return None
        return (
            f"the attitudes of {n} poses do not determine 9 parameters: "
            f"{too_large(condition, largest)}; add poses in between each axis up "
            "and down; of six faces alone the session's kind is six_position"
        )

    def _condition(self, jacobian, x):
        """Return the condition number of the nine parameters at x, each by its natural size."""
        K = np.abs(x[3:6])
        return condition_number(jacobian[:, :9], np.concatenate([np.ones(3), K, self.gravity / K]))

    def lost(self, solution, recording):
        """Return why a fit is none, or None if it is one.

        Gravity's norm is also met where K tends to zero and K b to a vector as long as gravity.
        What lies on no ellipsoid is drawn there, and there the poses determine nothing; or to axes
        that no accelerometer has.
        """
        found, largest = solution.fit, self.settings.largest_condition
        condition = self._condition(found.jacobian, found.x)
        slant = np.max(np.abs(found.x[:3]))
        if not condition <= largest:
            leads = f"where they determine nothing, {too_large(condition, largest)}"
        elif slant > SLANT or np.min(found.x[3:6]) <= 0:
            leads = f"axes {slant:.2g} rad from square, at most {SLANT:g} is plausible"
        else:
            return None
        return (
            f"specific force at {len(found.jacobian)} poses lies on no ellipsoid of an "
            f"accelerometer: the fit leads to {leads}; was a pose clipped or wrapped around, did "
            f"scale or offset change midway?"
        )

    def fit(self, recording, effects=(), start=None, prior=None):
        """Return the Solution for a recording; the start is as good without another."""
        return super().fit(recording, effects, None, prior)

    def rows(self, recording):
        """Return the poses where each residual starts and ends, (N, 2), and its kind, (N,)."""
        poses = np.arange(len(recording.poses))
        return np.column_stack([poses, poses]), np.zeros(len(poses), dtype=int)

    def model_at(self, x, recording, effects):
        """Return the AccelerometerModel of a recording, effects seen with parameters x."""
        return accelerometer.accelerometer_model(recording, self.gravity, x, effects)

    def covariance_at(self, x, model, recording, noise):
        """Return the covariance of a model's residuals, by a noise model."""
        return model.covariance(x, recording.poses.mean_covariance(noise)[:3])

    def directions(self, solution, recording):
        """Return gravity's direction at the poses, shape (n, 3)."""
        force = self.model(solution, recording).force(solution.fit.x)
        return force / np.linalg.norm(force, axis=1, keepdims=True)

    def designs(self, solution, recording):
        """Return the derivatives of the effects wherever these act, (n, 3, p) each."""
        return [self.model(solution, recording).design]


@dataclass(frozen=True)
class GyroscopePoses(SensorPoses):
    """The gyroscope at the poses: no rate at rest, and rotations carry gravity to the next pose.

    Gravity is that of the accelerometer's calibration. A bias that is held is given with its
    variance, rad/s as logged, shape (3,) each.
    """

    noise: NoiseModel
    accelerometer: SensorCalibration
    unit: RawUnit
    settings: CalibrateSettings
    bias: tuple[np.ndarray, np.ndarray] | None = None
    sensor = "gyroscope"
    axes = ANGULAR_RATE
    names = gyroscope.NAMES
    kinds: ClassVar = {"pose_rate": ("rad/s", 3), "rotation": ("rad", 2)}

    def untestable(self, recording):
        """Return why the data determine no calibration, or None."""
        if not len(recording.poses):
            return NO_POSE
        silent = partial(recording.poses.unknown_noise, self.noise, ANGULAR_RATE)
        if reason := direction_unknown(self.accelerometer) or silent():
            return reason
        reason = self._undetermined(self._start_derivative(recording))
        return reason and reason + recording.lost.reason

    def undetermined(self, recording, keeps):
        """Return for each mask of poses whether these alone determine no calibration."""
        # the design, but for what the parameters of a part differ by
        jacobian, first = self._start_derivative(recording), recording.rotations.first
        parts = (jacobian[keep[first] & keep[first + 1]] for keep in keeps)
        return [self._undetermined(part) is not None for part in parts]

    def _start_derivative(self, recording):
        """Return the derivative of the rotations' errors at the start of a fit, (m, 2, 12)."""
        if not len(recording.rotations):
            return np.zeros((0, 2, 12))
        model = self.model_at(None, recording, ())
        return model.rotation_errors(model.start())[1]

    def _undetermined(self, jacobian):
        """Return why rotations of this derivative do not determine T and K, or None if they do."""
        count, needed, largest = len(jacobian), 5, self.settings.largest_condition
        if count < needed:
            return (
                f"{plural(count, 'rotation')} between poses found, at least {needed} needed for "
                "the 9 parameters of misalignment and scale factor"
            )
        condition = condition_number(jacobian.reshape(-1, 12)[:, :9], np.ones(9))
        if condition <= largest:
            return None
        return (
            f"the axes of {count} rotations do not determine misalignment and scale "
            f"factor: {too_large(condition, largest)}; turn about each axis, both ways, "
            "by 90 degrees and more"
        )

    def lost(self, solution, recording):
        """Return why a fit is none, or None if it is one: where it ends nothing is determined."""
        found, count = solution.fit, len(recording.rotations)
        sizes = np.append(np.ones(6), np.abs(found.x[6:9]))
        # the rows of the rotations are the last
        condition = condition_number(found.jacobian[len(found.jacobian) - 2 * count :, :9], sizes)
        if condition > self.settings.largest_condition:
            return (
                f"no misalignment and scale factor carries gravity through {count} rotations: the "
                "fit leads to where they determine nothing, "
                f"{too_large(condition, self.settings.largest_condition)}; was the angular rate "
                "clipped or wrapped around, did scale or axes change midway?"
            )
        # as they contradict each other: what the rates at rest do says nothing of a turn
        own = found.white[len(found.white) - 2 * count :]
        std = np.sqrt(np.diag(found.covariance)[:9] * max(1.0, own @ own / (2 * count - 9)))
        axes, scale = std[:6].max(), np.max(std[6:] / sizes[6:])
        if axes > AXES or scale > SCALE:
            return (
                f"{count} rotations show misalignment to {axes:.2g} rad and scale factor to "
                f"{100 * scale:.2g} %, a data sheet to {AXES:g} rad and {100 * SCALE:g} %: they "
                "are too few, or contradict each other; was the angular rate clipped?"
            )
        return None

    def rows(self, recording):
        """Return the poses where each residual starts and ends, (N, 2), and its kind, (N,)."""
        poses, first = np.arange(len(recording.poses)), recording.rotations.first
        ends = np.concatenate([np.repeat(poses, 3), np.repeat(first, 2)])
        kind = np.repeat([0, 1], [3 * len(poses), 2 * len(first)])
        return np.column_stack([ends, ends + kind]), kind

    def model_at(self, x, recording, effects):
        """Return the GyroscopeModel of a recording, effects seen with parameters x."""
        force = calibrated_force(self.accelerometer, recording, self.noise)
        return gyroscope.gyroscope_model(recording, force, x, effects)

    def covariance_at(self, x, model, recording, noise):
        """Return the covariance of a model's residuals, by a noise model."""
        directions = calibrated_force(self.accelerometer, recording, noise).direction_covariance
        return model.covariance(x, recording.poses, directions, noise)

    def designs(self, solution, recording):
        """Return the derivatives of the effects at the poses and along the rotations."""
        model = self.model(solution, recording)
        return [model.rate_design, model.rotation_design.reshape(-1, *model.rate_design.shape[1:])]


def _of_free(model, x, free, values):
    """Return the residuals with other values of the free parameters, and their derivative."""
    full = x.copy()
    full[free] = values
    r, jacobian = model.residuals(full)
    return r, jacobian[:, free]


def residuals(model, x):
    """Return residuals and their derivative at x, the parameters of further effects zero."""
    return model.residuals(np.append(x, np.zeros(len(model.start()) - len(x))))


def in_raw_units(unit, base, x, covariance, *, method, effects=(), known=(), reduced_chi2=None):
    """Return the SensorCalibration that parameters in SI as logged stand for, in raw units.

    ``K_raw = K s`` and ``b_raw = b / s + offset`` for ``SI = s (raw - offset)``. x, shape (p,), and
    its covariance hold the parameters named in `base`, three scale factors and three biases last,
    then those of the effects, whose names begin with the effect's: ``g_sensitivity.G00``. Effects
    that are known from elsewhere, FittedEffect each, go before them.
    """
    count = len(base)
    factor = np.ones(len(x))
    factor[count - 6 : count - 3] = unit.scale
    factor[count - 3 : count] = 1 / unit.scale
    raw = x * factor
    T = np.eye(3)
    for name, value in zip(base[:-6], x[: count - 6], strict=True):
        T[int(name[1]), int(name[2])] = value
    names = [f"{effect.name}.{p}" for effect in effects for p in effect.parameters]
    # in the order of the effects' parameters
    values, fitted = zip(x[count:], np.sqrt(np.diag(covariance))[count:], strict=True), []
    for effect in effects:
        own = {p: tuple(map(float, next(values))) for p in effect.parameters}
        both = ({p: pair[k] for p, pair in own.items()} for k in (0, 1))
        fitted.append(FittedEffect(effect, *both))
    return SensorCalibration(
        raw_unit=unit,
        T=T,
        K=raw[count - 6 : count - 3],
        b=raw[count - 3 : count] + unit.offset,
        names=(*base, *names),
        covariance=covariance * np.outer(factor, factor),
        effects=(*known, *fitted),
        method=method,
        reduced_chi2=reduced_chi2,
    )


def as_logged(calibration, base):
    """Return the base parameters of a calibration, SI as logged: inverse of `in_raw_units`."""
    unit = calibration.raw_unit
    T = [calibration.T[int(name[1]), int(name[2])] for name in base[:-6]]
    return np.concatenate([T, calibration.K / unit.scale, unit.to_si(calibration.b)])


def fitted_calibration(sensor, solution, covariance=None):
    """Return the calibration of a solution; its variances grow with what it leaves unexplained."""
    found = solution.fit
    covariance = found.scaled_covariance if covariance is None else covariance
    if len(covariance) < len(found.x):
        # of a bias that was held
        covariance = block_diag(covariance, np.diag(sensor.bias[1]))
    return in_raw_units(
        sensor.unit,
        sensor.names,
        found.x,
        covariance,
        method="multi_position",
        effects=solution.effects,
        reduced_chi2=found.reduced_chi2,
    )


def direction_unknown(force):
    """Return why an accelerometer's calibration gives no direction of gravity, None if it does.

    One as its data sheet has it may be degrees off: what a gyroscope fits to that is no better than
    its own data sheet. One that is nominal for no reason is taken as known.
    """
    if force.method != "nominal" or force.not_testable is None:
        return None
    return f"direction of gravity not known: {force.not_testable}"
