"""Has a device drifted? The parameters of a calibration tested on a new log."""

from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.stats import chi2, norm

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.validate.departure import (
    BASE,
    accelerometer_problem,
    gyroscope_problem,
    testable,
)

# level at which a misfit of the new log widens the errors
MISFIT = 0.01
# Allan deviation of flicker noise of unit coefficient
_FLICKER = np.sqrt(2 * np.log(2) / np.pi)


@dataclass(frozen=True)
class Change:
    """What became of one parameter.

    Attributes
    ----------
    name : str
        As in the calibration's covariance; ``b along (x, y, z)``, on the sensor's axes, where the
        log shows one direction of the bias alone.
    unit : str
        SI; ``1`` for scale factors, whose change is relative.
    change, std : float
        New less old, and its standard error: that of the old calibration, of the new log, and of
        what a bias may do from one switching on to the next.
    sigmas, p_value : float
        ``change/std``, and the probability of as much without a drift.
    p_holm : float
        The same for the largest of all parameters tested, after Holm.
    drifted : bool
        Whether that is too little for chance.
    """

    name: str
    unit: str
    change: float
    std: float
    sigmas: float
    p_value: float
    p_holm: float = 1.0
    drifted: bool = False


@dataclass(frozen=True)
class SensorDrift:
    """The test of one sensor.

    Attributes
    ----------
    sensor : str
        Its name.
    drifted : bool or None
        None where nothing could be tested.
    changes : tuple of Change
        What was tested, the strongest first.
    untested : tuple of str, and why : str or None
        Parameters that were not, and the reason.
    chi2, dof, p_value, p_holm : float
        Joint test of all changes, and its p-value among those of both sensors.
    residuals : dict
        ``gravity_norm`` or ``pose_rate`` and ``rotation``: `unit`, `n`, root mean square `rms` with
        the old calibration, and the `floor` that noise and the calibration's errors predict.
    misfit : float or None
        Reduced chi square of the new log after all changes that were tested.
    turn_on : tuple of float
        Standard deviation of the bias from one switching on to the next that was allowed, SI.
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

    Attributes
    ----------
    device : str
        Name in the calibration.
    level : float
        Probability that a device that did not drift is said to have.
    poses, rotations : int
        Rests and turns between rests that the log holds.
    sensors : dict of str to SensorDrift
        By name.
    """

    device: str
    level: float
    poses: int
    rotations: int
    sensors: dict

    @property
    def drifted(self):
        """Whether anything has drifted."""
        return any(sensor.drifted for sensor in self.sensors.values())

    @property
    def bias_only(self):
        """Whether what has drifted are biases alone."""
        changed = [c.name for s in self.sensors.values() for c in s.changes if c.drifted]
        return bool(changed) and all(is_bias(name) for name in changed)

    def to_dict(self):
        """Return what a JSON file holds."""
        return {
            "format": 1,
            "drifted": self.drifted,
            "bias_only": self.bias_only,
            **asdict(self),
        }


def is_bias(name):
    """Return whether a change's name is that of a bias."""
    return name in ("b0", "b1", "b2") or name.startswith("b along")


def check_drift(calibration, recording, noise, *, gravity=None, level=0.05, turn_on=None):
    """Test whether the parameters of a calibration still hold in a new log.

    With the old parameters x, r are the residuals of the new log: ``|f| - g`` at rest; angular
    rate at rest and the direction of gravity after each turn. Their covariance without a drift is
    ``S = Σ + J C Jᵀ``, of the noise and of the calibration's own errors C. The change of those
    parameters that the log determines is the δ of least ``(r + J δ)ᵀ S⁻¹ (r + J δ)``. If it
    determines all of them, δ is the difference to a new calibration, and its covariance the sum
    of both. Two families of tests share the level: each parameter by itself, and one χ² test a
    sensor of all together; each family after Holm.

    Parameters
    ----------
    calibration : Calibration
        Old calibration.
    recording : Recording
        Rests, and turns between them, of the new log.
    noise : NoiseModel
        Noise of the device.
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
        The result.

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
    recording = recording.of_new_runs()
    poses = recording.poses
    force = accelerometer_problem(calibration, recording, noise, gravity or calibration.gravity)
    allowed = {
        sensor: _turn_on(
            getattr(calibration, sensor), noise, axes, None if turn_on is None else turn_on[k]
        )
        for k, (sensor, axes) in enumerate(
            (("accelerometer", ACCELERATION), ("gyroscope", ANGULAR_RATE))
        )
    }
    found = {}
    try:
        found["accelerometer"] = _test(
            force, allowed["accelerometer"], poses, noise, ACCELERATION, level
        )
        turn = gyroscope_problem(calibration, recording, noise, force, found["accelerometer"][1])
        found["gyroscope"] = _test(turn, allowed["gyroscope"], poses, noise, ANGULAR_RATE, level)
    except LinAlgError as error:
        name = "gyroscope" if found else "accelerometer"
        raise ImuloopError(
            f"nothing can be tested: the calibration of the {name} is so far from the log, or its "
            "errors are so large, that rounding leaves nothing of the noise"
        ) from error
    sensors = _judged({name: result for name, (result, _) in found.items()}, level)
    if all(sensor.drifted is None for sensor in sensors.values()):
        why = "; ".join(f"{name}: {sensor.why}" for name, sensor in sensors.items())
        raise ImuloopError(f"nothing can be tested: {why}")
    rotations = 0 if recording.rotations is None else len(recording.rotations)
    return Drift(calibration.device, level, len(poses), rotations, sensors)


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


def _test(problem, turn_on, poses, noise, axes, level):
    """Return the test of one sensor, and change and covariance of all parameters if it drifted."""
    if isinstance(problem, str):
        sensor = "accelerometer" if axes == ACCELERATION else "gyroscope"
        return SensorDrift(sensor, None, why=problem), None
    if reason := poses.unknown_noise(noise, axes):
        return SensorDrift(problem.sensor, None, untested=problem.estimated, why=reason), None
    prior = problem.covariance.copy()
    biases = [problem.names.index(name) for name in ("b0", "b1", "b2")]
    prior[biases, biases] += np.square(turn_on)
    basis, names, untested, why = testable(problem)
    r, jacobian = problem.residuals(problem.x)
    excess = problem.excess
    for attempt in range(2):
        expected = excess * problem.noise + jacobian @ prior @ jacobian.T
        root = cholesky(expected, lower=True)
        change, covariance, left = _solve(problem, basis, root)
        dof = len(r) - len(change)
        if attempt or dof < 1 or chi2.sf(left, dof) >= MISFIT:
            break
        # the new log fits worse than its noise whatever the parameters: so do they
        excess *= left / dof
    if not np.all(np.diag(covariance) > 0):
        raise LinAlgError("rounding leaves a covariance indefinite")
    std = np.sqrt(np.diag(covariance))
    scale = np.array([problem.scale(name) for name in names])
    joint = float(change @ np.linalg.solve(covariance, change))
    changes = [
        Change(name, problem.unit(name), c * f, s * f, c / s, float(2 * norm.sf(abs(c / s))))
        for name, c, s, f in zip(names, change.tolist(), std.tolist(), scale.tolist(), strict=True)
    ]
    result = SensorDrift(
        problem.sensor,
        False,
        tuple(changes),
        untested,
        why,
        joint,
        len(change),
        float(chi2.sf(joint, len(change))),
        residuals=problem.summary(r, np.diag(expected)),
        misfit=left / dof if dof > 0 else None,
        turn_on=turn_on,
    )
    # chance among the joint test and the single ones, as `_judged` has it for one sensor
    p = min(result.p_value, min(c.p_value for c in changes) * len(changes))
    if p < level / 2 and set(BASE[problem.sensor]) <= set(names):
        return result, (basis @ change, basis @ covariance @ basis.T)
    return result, None


def _solve(problem, basis, root):
    """Return the δ of least ``(r + J δ)ᵀ S⁻¹ (r + J δ)``, its covariance, the least value."""
    change = np.zeros(basis.shape[1])
    # nearly linear: the second step is for changes that are large
    for _ in range(3):
        r, jacobian = problem.residuals(problem.x + basis @ change)
        design = solve_triangular(root, jacobian @ basis, lower=True)
        change = change - np.linalg.lstsq(design, solve_triangular(root, r, lower=True))[0]
    r, _ = problem.residuals(problem.x + basis @ change)
    left = solve_triangular(root, r, lower=True)
    return change, np.linalg.inv(design.T @ design), float(left @ left)


def holm(p_values):
    """Return p-values that hold for a whole family, after Holm.

    Parameters
    ----------
    p_values : array_like, shape (m,)
        One a test.

    Returns
    -------
    ndarray, shape (m,)
        In the same order; at most 1.
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    return np.minimum(adjusted, 1.0)


def _judged(sensors, level):
    """Return the tests of both sensors with what they say of each other's chance."""
    tested = [name for name, s in sensors.items() if s.changes]
    single = iter(holm([c.p_value for name in tested for c in sensors[name].changes]))
    joint = dict(zip(tested, holm([sensors[name].p_value for name in tested]), strict=True))
    for name in tested:
        changes = []
        for each in sensors[name].changes:
            p = float(next(single))
            changes.append(replace(each, p_holm=p, drifted=p < level / 2))
        sensors[name] = replace(
            sensors[name],
            changes=tuple(sorted(changes, key=lambda c: c.p_value)),
            p_holm=float(joint[name]),
            drifted=bool(joint[name] < level / 2 or any(c.drifted for c in changes)),
        )
    return sensors
