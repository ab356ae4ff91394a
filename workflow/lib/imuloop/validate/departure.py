"""What a new log says of an old calibration: residuals and their covariance."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.pose_fits import in_raw_units
from imuloop.core.effect import effect_design
from imuloop.core.units import DEGREE

# condition number, each parameter in units of what the log shows of it, beyond which a set of
# parameters is called undetermined, as in the calibration
LARGEST_CONDITION = 100.0
# a parameter that the new log shows so many times worse than the old one is not tested
WORST = 10.0
BASE = {"accelerometer": accelerometer.NAMES, "gyroscope": gyroscope.NAMES}


@dataclass(frozen=True)
class Problem:
    """Residuals of a new log as a function of a sensor's parameters.

    Attributes
    ----------
    sensor : str
        Its name.
    names : tuple of str
        Parameters: misalignments, scale factors, biases, effects; p of them.
    x : ndarray, shape (p,)
        The old calibration's, in SI as logged.
    covariance : ndarray, shape (p, p)
        Theirs; zero for what it did not estimate.
    estimated : tuple of str
        What it did.
    units : dict of str to str
        SI unit of each effect's parameter.
    residuals : callable
        Takes parameters; gives residuals, shape (n,), and their derivative, (n, p).
    noise : ndarray, shape (n, n)
        Covariance of the residuals that the noise predicts.
    parts : dict of str to (str, slice)
        Name of each kind of residual to its unit and place.
    excess : float
        Reduced chi square that the old calibration already had, at least 1.
    data : str
        What the log holds, in words.
    """

    sensor: str
    names: tuple
    x: np.ndarray
    covariance: np.ndarray
    estimated: tuple
    units: dict
    residuals: Callable
    noise: np.ndarray
    parts: dict
    excess: float
    data: str

    def groups(self):
        """Return indices of the parameters that are told apart together: b, K, T, each effect."""
        groups = {}
        for k, name in enumerate(self.names):
            if name in self.estimated:
                groups.setdefault(name.partition(".")[0].rstrip("012"), []).append(k)
        return sorted(groups.values(), key=lambda g: "bKT".find(self.names[g[0]][0]) % 4)

    def unit(self, name):
        """Return the SI unit of a parameter's change."""
        if name in self.units:
            return self.units[name]
        if name.startswith("b"):
            return "m/s^2" if self.sensor == "accelerometer" else "rad/s"
        return "rad" if name.startswith("T") else "1"

    def scale(self, name):
        """Return the factor from a parameter, SI as logged, to its unit: K is relative."""
        return 1 / self.x[self.names.index(name)] if name in ("K0", "K1", "K2") else 1.0

    def summary(self, r, expected):
        """Return the size of the residuals and the size expected, for each kind."""
        return {
            name: {
                "unit": unit,
                "n": len(r[part]),
                "rms": float(np.sqrt(np.mean(r[part] ** 2))),
                "floor": float(np.sqrt(np.mean(expected[part]))),
            }
            for name, (unit, part) in self.parts.items()
            if len(r[part])
        }


def as_logged(sensor, base):
    """Return a calibration's parameters in SI as logged; the inverse of `in_raw_units`.

    Parameters
    ----------
    sensor : SensorCalibration
        Of one sensor.
    base : tuple of str
        Names of its base parameters.

    Returns
    -------
    names, x, covariance, fitted, known
        As of `Problem`; effects that were fitted with the base parameters, and others.
    """
    unit, estimated = sensor.raw_unit, {name.partition(".")[0] for name in sensor.names}
    fitted = [effect for effect in sensor.effects if effect.name in estimated]
    known = [effect for effect in sensor.effects if effect.name not in estimated]
    names = (*base, *(f"{e.name}.{p}" for e in fitted for p in e.effect.parameters))
    T = [sensor.T[int(name[1]), int(name[2])] for name in base[:-6]]
    values = [e.values[p] for e in fitted for p in e.effect.parameters]
    x = np.array([*T, *(sensor.K / unit.scale), *unit.to_si(sensor.b), *values])
    factor = np.ones(len(x))
    factor[len(base) - 6 : len(base) - 3] = 1 / unit.scale
    factor[len(base) - 3 : len(base)] = unit.scale
    covariance = np.zeros((len(x), len(x)))
    place = [names.index(name) for name in sensor.names]
    covariance[np.ix_(place, place)] = sensor.covariance
    return names, x, covariance * np.outer(factor, factor), fitted, known


def _units(sensor, fitted):
    return {
        f"{each.name}.{name}": unit
        for each in fitted
        for name, unit in each.effect.units(sensor).items()
    }


def accelerometer_problem(calibration, recording, noise, gravity):
    """Return the accelerometer's residuals ``|f| - g`` at the poses.

    Parameters
    ----------
    calibration : Calibration
        Old calibration.
    recording : Recording
        Of the new log.
    noise : NoiseModel
        Noise of the device.
    gravity : float
        m/s^2.

    Returns
    -------
    Problem or str
        Or why there is none.
    """
    sensor = calibration.accelerometer
    if not sensor.names:
        return "the calibration estimated nothing of it"
    names, x, covariance, fitted, known = as_logged(sensor, accelerometer.NAMES)
    effects = [each.effect for each in fitted]
    model = accelerometer.accelerometer_model(recording, gravity, x, effects, known)
    means = recording.poses.mean_covariance(noise)[:3]
    return Problem(
        "accelerometer",
        names,
        x,
        covariance,
        sensor.names,
        _units("accelerometer", fitted),
        model.residuals,
        model.covariance(x, means),
        {"gravity_norm": ("m/s^2", slice(None))},
        max(1.0, sensor.reduced_chi2 or 1.0),
        f"{len(recording.poses)} rest(s) in {_attitudes(recording.poses.f)} attitude(s)",
    )


def gyroscope_problem(calibration, recording, noise, force, change):
    """Return the gyroscope's residuals: the rate at rest, and gravity after each turn.

    Parameters
    ----------
    calibration, recording, noise
        As of `accelerometer_problem`.
    force : Problem or str
        The accelerometer's; without one there is no direction of gravity, and no turn.
    change : (ndarray, ndarray), or None
        How its parameters have changed, with the covariance, where they have.

    Returns
    -------
    Problem or str
        Or why there is none. Turns are left out where misalignment and scale factor of a sensor
        were not estimated.
    """
    sensor, poses = calibration.gyroscope, recording.poses
    if not sensor.names:
        return "the calibration estimated nothing of it"
    names, x, covariance, fitted, known = as_logged(sensor, gyroscope.NAMES)
    effects = [each.effect for each in fitted]
    axes = calibration.accelerometer
    if change is not None:
        axes = _changed(axes, force, change)
    at, means = calibrated_force(axes, recording, noise), poses.mean_covariance(noise)[3:]
    n, turns = 3 * len(poses), len(recording.rotations)
    if turns and not isinstance(force, str) and "K0" in sensor.names:
        model = gyroscope.gyroscope_model(recording, at, x, effects, known)
        residuals = model.residuals
        expected = gyroscope.residual_covariance(model, x, poses, at.direction_covariance, noise)
    else:
        turns, expected = 0, np.zeros((n, n))
        for axis in range(3):
            expected[axis::3, axis::3] = means[axis]
        channels = recording.pose_channels("gyroscope", lambda y: x[6:9] * (y - x[9:12]), at.poses)
        model = gyroscope.GyroscopeModel(
            rate=poses.w,
            rate_design=effect_design(effects, channels),
            rotations=recording.rotations,
            rotation_design=None,
            directions=None,
            rate_known=sum((e.output(channels) for e in known), start=np.zeros((len(poses), 3))),
        )

        def residuals(x):
            r, jacobian = model.pose_rates(x)
            return r.ravel(), jacobian.reshape(n, -1)

    return Problem(
        "gyroscope",
        names,
        x,
        covariance,
        sensor.names,
        _units("gyroscope", fitted),
        residuals,
        expected,
        {"pose_rate": ("rad/s", slice(None, n)), "rotation": ("rad", slice(n, None))},
        max(1.0, sensor.reduced_chi2 or 1.0),
        f"{len(poses)} rest(s) and {turns} turn(s) between them",
    )


def _changed(sensor, force, change):
    """Return the accelerometer with its parameters changed, and their covariance."""
    _, _, _, fitted, known = as_logged(sensor, accelerometer.NAMES)
    return in_raw_units(
        sensor.raw_unit,
        accelerometer.NAMES,
        force.x + change[0],
        change[1],
        method=sensor.method,
        effects=[each.effect for each in fitted],
        known=known,
    )


def _attitudes(f):
    """Return the number of attitudes that differ by more than 20 degrees from those before."""
    found = []
    for u in f / np.linalg.norm(f, axis=1, keepdims=True):
        if all(u @ v < np.cos(20 * DEGREE) for v in found):
            found.append(u)
    return len(found)


def testable(problem):
    """Return which changes of parameters a log determines.

    The bias first, then scale factors, misalignments and each effect, as long as what is taken in
    stays determined. What is left out is taken as the calibration has it, with its errors.

    Parameters
    ----------
    problem : Problem
        Residuals of the log.

    Returns
    -------
    basis : ndarray, shape (p, q)
        Changes of the parameters, a column each.
    names : tuple of str
        Their names.
    untested : tuple of str
        Parameters that are not determined.
    why : str or None
        The reason.
    """
    r, jacobian = problem.residuals(problem.x)
    shown = solve_triangular(cholesky(problem.noise, lower=True), jacobian, lower=True)
    old = np.sqrt(np.diag(problem.covariance))
    chosen, missed = [], []
    for group in problem.groups():
        tried = [*chosen, *group]
        # beyond the bias a check is asked for: one residual more than parameters
        enough = len(r) >= len(tried) + bool(chosen)
        if enough and _determined(shown[:, tried], old[tried], len(group) if chosen else 0):
            chosen = tried
        else:
            missed += group
    untested = tuple(problem.names[k] for k in missed)
    why = f"not determined by {problem.data}" if missed else None
    if chosen:
        names = tuple(problem.names[k] for k in chosen)
        return np.eye(len(problem.x))[:, chosen], names, untested, why
    # not even the bias: the directions of it that the log does show
    biases = problem.groups()[0]
    _, size, directions = np.linalg.svd(shown[:, biases])
    directions = directions[: np.sum(size > size[0] / LARGEST_CONDITION)]
    largest = np.argmax(np.abs(directions), axis=1)[:, None]
    directions = directions * np.sign(np.take_along_axis(directions, largest, axis=1))
    basis = np.zeros((len(problem.x), len(directions)))
    basis[biases] = directions.T
    names = tuple("b along ({}, {}, {})".format(*(np.round(d, 2) + 0.0)) for d in directions)
    return basis, names, untested, f"{why}, but for its bias along gravity"


def _determined(shown, old, new):
    """Return whether data determine parameters, the last `new` hardly worse than before."""
    size = np.linalg.norm(shown, axis=0)
    if not np.all(size > 0):
        return False
    _, values, directions = np.linalg.svd(shown / size, full_matrices=False)
    if values[-1] * LARGEST_CONDITION < values[0]:
        return False
    std = np.linalg.norm(directions.T / values, axis=1) / size
    return bool(np.all((std <= WORST * old)[len(old) - new :]))
