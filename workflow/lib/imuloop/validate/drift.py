"""Has a device drifted? The parameters of a calibration tested on a new log."""

from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.stats import chi2, norm

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import SENSORS
from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.validate.drift_residuals import (
    BASE,
    BIASES,
    SCALES,
    accelerometer_residuals,
    gyroscope_residuals,
    testable,
)

# level at which a misfit of the new log widens the errors
MISFIT = 0.01
# Allan deviation of flicker noise of unit coefficient
_FLICKER = np.sqrt(2 * np.log(2) / np.pi)


@dataclass(frozen=True)
class Change:
    """What became of one parameter: new less old, in SI, relative for a scale factor.

    Its name is that of the calibration's covariance, or ``b along (x, y, z)``, on the sensor axes,
    where the log shows one direction of the bias alone. Its standard error is that of the old
    calibration, of the new log, and of what a bias may do from one switching on to the next. The
    p-value is that of as much without a drift, and that for the largest of all parameters tested,
    after Holm.
    """

    name: str
    unit: str
    change: float
    std: float
    sigmas: float
    p_value: float
    p_holm: float = 1.0
    drifted: bool = False

    @property
    def is_bias(self):
        """Whether it is of a bias."""
        return self.name in BIASES or self.name.startswith("b along")


@dataclass(frozen=True)
class SensorDrift:
    """The test of one sensor; `drifted` is None where nothing could be tested.

    What was tested, the strongest first, and which parameters were not, and why. The joint test of
    all changes, with its p-value among those of both sensors. The root mean square of each kind of
    residual with the old calibration, with the floor that noise and the calibration's errors
    predict; the reduced chi square after all changes. What of the bias was allowed for, SI.
    """

    sensor: str
    drifted: bool | None
    changes: tuple = ()
    untested: tuple = ()
    why: str | None = None
    chi2: float | None = None
    dof: int = 0
    p_value: float | None = None
    p_holm: float | None = None
    residuals: dict | None = None
    misfit: float | None = None
    turn_on: tuple = ()


@dataclass(frozen=True)
class Drift:
    """The test of a calibration on a new log.

    `level` is the probability that a device that did not drift is said to have; `poses` and
    `rotations` are the rests, and turns between them, that the log holds.
    """

    device: str
    level: float
    poses: int
    rotations: int
    sensors: dict[str, SensorDrift]

    @property
    def drifted(self):
        """Whether anything has drifted."""
        return any(sensor.drifted for sensor in self.sensors.values())

    @property
    def bias_only(self):
        """Whether what has drifted are biases alone."""
        changed = [c for s in self.sensors.values() for c in s.changes if c.drifted]
        return bool(changed) and all(change.is_bias for change in changed)

    def to_dict(self):
        """Return what a JSON file holds."""
        return {
            "format": 1,
            "drifted": self.drifted,
            "bias_only": self.bias_only,
            **asdict(self),
        }


def check_drift(calibration, recording, noise, *, gravity=None, level=0.05, turn_on=None):
    """Test whether the parameters of a calibration still hold in a new log.

    With the old parameters x, r are the residuals of the new log: ``|f| - g`` at rest; angular
    rate at rest and the direction of gravity after each turn. Their covariance without a drift is
    ``S = Σ + J C Jᵀ``, of the noise and of the calibration's own errors C. The change of those
    parameters that the log determines is the δ of least ``(r + J δ)ᵀ S⁻¹ (r + J δ)``. If it
    determines all of them, δ is the difference to a new calibration, and its covariance the sum
    of both. Two families of tests share the level: each parameter by itself, and one χ² test per
    sensor of all together; each family after Holm.

    Parameters
    ----------
    calibration, recording, noise : Calibration, Recording, NoiseModel
        The old calibration; rests, and turns between them, of the new log; noise of the device.
    gravity : float, optional
        Where the log was recorded, m/s^2; that of the calibration by default.
    level : float
        Probability of a false alarm.
    turn_on : (float, float), optional
        Standard deviation of the bias from one switching on to the next, m/s^2 and rad/s; by
        default what the calibration's `turn_on_bias` says, or else the bias instability of the
        noise model, where it has one.

    Returns
    -------
    Drift

    Raises
    ------
    ImuloopError
        If nothing can be tested.

    References
    ----------
    S. Holm, Scandinavian Journal of Statistics 6 (1979) 65.
    """
    if not len(recording.poses):
        raise ImuloopError("the log holds no rest: nothing can be tested")
    recording, gravity = recording.of_new_runs(), gravity or calibration.gravity
    allowed = {}
    for (name, axes), given in zip(SENSORS.items(), turn_on or (None, None), strict=True):
        allowed[name] = _turn_on(getattr(calibration, name), noise, axes, given)
    found, change = {}, None
    force = accelerometer_residuals(calibration, recording, noise, gravity)
    for name in SENSORS:
        try:
            residuals = force
            if name == "gyroscope":
                residuals = gyroscope_residuals(calibration, recording, noise, force, change)
            unknown = recording.poses.unknown_noise(noise, SENSORS[name])
            if isinstance(residuals, str):
                found[name], change = SensorDrift(name, None, why=residuals), None
            elif unknown:
                untested = residuals.estimated
                found[name], change = SensorDrift(name, None, untested=untested, why=unknown), None
            else:
                found[name], change = _test(residuals, allowed[name], level)
        except LinAlgError as error:
            raise ImuloopError(
                f"nothing can be tested: the calibration of the {name} is so far from the log, or "
                "its errors are so large, that rounding leaves nothing of the noise"
            ) from error
    sensors = _judged(found, level)
    if all(sensor.drifted is None for sensor in sensors.values()):
        why = "; ".join(f"{name}: {sensor.why}" for name, sensor in sensors.items())
        raise ImuloopError(f"nothing can be tested: {why}")
    rotations = 0 if recording.rotations is None else len(recording.rotations)
    return Drift(calibration.device, level, len(recording.poses), rotations, sensors)


def _turn_on(sensor, noise, axes, given):
    """Return the standard deviation of the three biases from one switching on to the next, SI.

    What was given, what the calibration's own runs show, or what the noise allows for.
    """
    if given is not None:
        return (float(given),) * 3
    for each in sensor.effects:
        if isinstance(each.effect, TurnOnBias):
            return tuple(each.effect.run_to_run(each.values)[0].tolist())
    return tuple(float(_FLICKER * (noise.axes[axis].B.value or 0.0)) for axis in axes)


def _test(residuals, turn_on, level):
    """Return the test of one sensor, and change and covariance of all parameters if it drifted."""
    old, prior = residuals.old, residuals.old.covariance.copy()
    biases = [old.names.index(name) for name in BIASES]
    prior[biases, biases] += np.square(turn_on)
    basis, names, units, untested, why = testable(residuals)
    r, _ = residuals.function(old.x)
    change, covariance, expected, left = fit_change(residuals, basis, prior)
    dof = len(r) - len(change)
    std = np.sqrt(np.diag(covariance))
    # the change of a scale factor is relative
    factor = [1 / old.x[old.names.index(n)] if n in SCALES else 1.0 for n in names]
    rows = zip(names, units, change.tolist(), std.tolist(), factor, strict=True)
    changes = [
        Change(name, unit, c * f, s * f, c / s, float(2 * norm.sf(abs(c / s))))
        for name, unit, c, s, f in rows
    ]
    joint = float(change @ np.linalg.solve(covariance, change))
    result = SensorDrift(
        residuals.sensor,
        False,
        tuple(changes),
        untested,
        why,
        joint,
        len(change),
        float(chi2.sf(joint, len(change))),
        residuals=residuals.summary(r, np.diag(expected)),
        misfit=left / dof if dof > 0 else None,
        turn_on=turn_on,
    )
    # chance among the joint test and the single ones, as `_judged` has it for one sensor
    p = min(result.p_value, min(c.p_value for c in changes) * len(changes))
    if p < level / 2 and set(BASE[residuals.sensor]) <= set(names):
        return result, (basis @ change, basis @ covariance @ basis.T)
    return result, None


def fit_change(residuals, basis, prior):
    """Return the change δ of the parameters along a basis, (p, q), that a new log shows.

    With its covariance, the covariance S of the residuals before it, and the least
    ``(r + J δ)ᵀ S⁻¹ (r + J δ)``. `prior`, (p, p), is the covariance of the old parameters.
    """
    r, jacobian = residuals.function(residuals.old.x)
    excess, dof = residuals.excess, len(r) - basis.shape[1]
    for attempt in range(2):
        expected = excess * residuals.noise + jacobian @ prior @ jacobian.T
        change, covariance, left = _solve(residuals, basis, cholesky(expected, lower=True))
        if attempt or dof < 1 or chi2.sf(left, dof) >= MISFIT:
            break
        # the new log fits worse than its noise whatever the parameters: so do they
        excess *= left / dof
    if not np.all(np.diag(covariance) > 0):
        raise LinAlgError("rounding leaves a covariance indefinite")
    return change, covariance, expected, left


def _solve(residuals, basis, root):
    """Return the δ of least ``(r + J δ)ᵀ S⁻¹ (r + J δ)``, its covariance, the least value."""
    change = np.zeros(basis.shape[1])
    # nearly linear: the second step is for changes that are large
    for _ in range(3):
        r, jacobian = residuals.function(residuals.old.x + basis @ change)
        design = solve_triangular(root, jacobian @ basis, lower=True)
        change = change - np.linalg.lstsq(design, solve_triangular(root, r, lower=True))[0]
    r, _ = residuals.function(residuals.old.x + basis @ change)
    left = solve_triangular(root, r, lower=True)
    return change, np.linalg.inv(design.T @ design), float(left @ left)


def holm(p_values):
    """Return p-values that hold for a whole family, shape (m,), after Holm."""
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    return np.minimum(adjusted, 1.0)


def _judged(sensors, level):
    """Return the tests of both sensors with what they say of each other's chance."""
    tested = [name for name, s in sensors.items() if s.changes]
    single = iter(holm([c.p_value for name in tested for c in sensors[name].changes]).tolist())
    joint = dict(zip(tested, holm([sensors[n].p_value for n in tested]).tolist(), strict=True))
    for name in tested:
        changes = [
            replace(change, p_holm=p, drifted=p < level / 2)
            for change, p in zip(sensors[name].changes, single, strict=False)
        ]
        sensors[name] = replace(
            sensors[name],
            changes=tuple(sorted(changes, key=lambda c: c.p_value)),
            p_holm=joint[name],
            drifted=joint[name] < level / 2 or any(c.drifted for c in changes),
        )
    return sensors
