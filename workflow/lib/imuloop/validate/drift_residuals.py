"""Residuals of a new log under an old calibration, and which of its changes the log determines."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.pose_fits import as_logged, in_raw_units
from imuloop.core.units import DEGREE

# condition number, each parameter in units of what the log shows of it, beyond which a set of
# parameters is called undetermined, as in the calibration
LARGEST_CONDITION = 100.0
# a parameter that the new log shows so many times worse than the old one is not tested
WORST = 10.0
BASE = {"accelerometer": accelerometer.NAMES, "gyroscope": gyroscope.NAMES}
SCALES, BIASES = ("K0", "K1", "K2"), ("b0", "b1", "b2")


@dataclass(frozen=True)
class OldParameters:
    """A sensor's calibration as its fit had it: p parameters, SI as logged.

    Misalignments, scale factors, biases, then the effects that were fitted with them; a covariance,
    (p, p), zero for what was not estimated; the SI unit of each parameter's change, 1 for a scale
    factor, whose change is relative; those Effect, and every other FittedEffect.
    """

    names: tuple
    x: np.ndarray
    covariance: np.ndarray
    units: tuple
    effects: list
    known: list

    @classmethod
    def of(cls, calibration, name):
        """Return those of a sensor by its name; the inverse of `in_raw_units`."""
        sensor, base = getattr(calibration, name), BASE[name]
        estimated = {each.partition(".")[0] for each in sensor.names}
        fitted = [effect for effect in sensor.effects if effect.name in estimated]
        known = [effect for effect in sensor.effects if effect.name not in estimated]
        bias = "m/s^2" if name == "accelerometer" else "rad/s"
        units = {each: {"T": "rad", "K": "1", "b": bias}[each[0]] for each in base}
        for each in fitted:
            units |= {f"{each.name}.{p}": u for p, u in each.effect.units(name).items()}
        names = tuple(units)
        x = np.concatenate([as_logged(sensor, base), *(each.vector for each in fitted)])
        covariance = np.zeros((len(x), len(x)))
        place, factor = [names.index(each) for each in sensor.names], si_factor(sensor)
        covariance[np.ix_(place, place)] = sensor.covariance * np.outer(factor, factor)
        effects = [each.effect for each in fitted]
        return cls(names, x, covariance, tuple(units.values()), effects, known)


def si_factor(sensor):
    """Return the SI units, as logged, of each parameter that a sensor's calibration estimated."""
    factors = dict.fromkeys(SCALES, 1 / sensor.raw_unit.scale)
    factors |= dict.fromkeys(BIASES, sensor.raw_unit.scale)
    return np.array([factors.get(name, 1.0) for name in sensor.names])


@dataclass(frozen=True)
class DriftResiduals:
    """Residuals of a new log as a function of a sensor's parameters.

    `estimated` are the names of what the old calibration estimated; the function takes parameters,
    and gives residuals, (n,), and their derivative, (n, p), whose noise has a covariance, (n, n).
    `parts` are unit and place of each kind of residual; `excess` is the reduced chi square that the
    old calibration already had, at least 1; `data` is what the log holds, in words.
    """

    sensor: str
    old: OldParameters
    estimated: tuple
    function: Callable
    noise: np.ndarray
    parts: dict
    excess: float
    data: str

    def groups(self):
        """Return indices of the parameters that are tested together: b, K, T, each effect."""
        groups = {}
        for k, name in enumerate(self.old.names):
            if name in self.estimated:
                groups.setdefault(name.partition(".")[0].rstrip("012"), []).append(k)
        return sorted(groups.values(), key=lambda g: "bKT".find(self.old.names[g[0]][0]) % 4)

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


def accelerometer_residuals(calibration, recording, noise, gravity):
    """Return the DriftResiduals ``|f| - g`` at the poses, or why there are none.

    Takes the old Calibration, the Recording of the new log, the NoiseModel, and gravity, m/s^2.
    """
    sensor, poses = calibration.accelerometer, recording.poses
    if not sensor.names:
        return "the calibration estimated nothing of it"
    old = OldParameters.of(calibration, "accelerometer")
    model = accelerometer.accelerometer_model(recording, gravity, old.x, old.effects, old.known)
    return DriftResiduals(
        "accelerometer",
        old,
        sensor.names,
        model.residuals,
        model.covariance(old.x, poses.mean_covariance(noise)[:3]),
        {"gravity_norm": ("m/s^2", slice(None))},
        max(1.0, sensor.reduced_chi2 or 1.0),
        f"{len(poses)} rest(s) in {_attitudes(poses.f)} attitude(s)",
    )


def gyroscope_residuals(calibration, recording, noise, force, change):
    """Return the DriftResiduals of the rate at rest and of gravity after each turn, or why not.

    Takes those of the accelerometer too, and how its parameters have changed, with the covariance,
    or None. Turns are left out where misalignment and scale factor of a sensor were not estimated:
    there is no direction of gravity.
    """
    sensor, poses, axes = calibration.gyroscope, recording.poses, calibration.accelerometer
    if not sensor.names:
        return "the calibration estimated nothing of it"
    old = OldParameters.of(calibration, "gyroscope")
    if change is not None:
        axes = in_raw_units(
            axes.raw_unit,
            accelerometer.NAMES,
            force.old.x + change[0],
            change[1],
            method=axes.method,
            effects=force.old.effects,
            known=force.old.known,
        )
    at = calibrated_force(axes, recording, noise)
    if isinstance(force, str) or "K0" not in sensor.names:
        nothing = recording.rotations.select(np.zeros(len(recording.rotations), dtype=bool))
        recording = replace(recording, rotations=nothing)
    model = gyroscope.gyroscope_model(recording, at, old.x, old.effects, old.known)
    n, turns = 3 * len(poses), len(recording.rotations)
    expected = model.covariance(old.x, poses, at.direction_covariance, noise)
    return DriftResiduals(
        "gyroscope",
        old,
        sensor.names,
        model.residuals,
        expected,
        {"pose_rate": ("rad/s", slice(None, n)), "rotation": ("rad", slice(n, None))},
        max(1.0, sensor.reduced_chi2 or 1.0),
        f"{len(poses)} rest(s) and {turns} turn(s) between them",
    )


def _attitudes(f):
    """Return the number of attitudes that differ by more than 20 degrees from those before."""
    found = []
    for u in f / np.linalg.norm(f, axis=1, keepdims=True):
        if all(u @ v < np.cos(20 * DEGREE) for v in found):
            found.append(u)
    return len(found)


def testable(residuals):
    """Return which changes of the p parameters a log determines.

    The bias first, then scale factors, misalignments and each effect, as long as what is taken in
    stays determined. What is left out is taken as the calibration has it, with its errors. Gives
    changes of the parameters, a column each, (p, q), their names and SI units, the names of the
    parameters that are not determined, and the reason.
    """
    old, groups = residuals.old, residuals.groups()
    r, jacobian = residuals.function(old.x)
    shown = solve_triangular(cholesky(residuals.noise, lower=True), jacobian, lower=True)
    std = np.sqrt(np.diag(old.covariance))
    taken, missed = [], []
    for group in groups:
        tried = [*taken, *group]
        # beyond the bias a check is asked for: one residual more than parameters
        enough = len(r) >= len(tried) + bool(taken)
        if enough and _determined(shown[:, tried], std[tried], len(group) if taken else 0):
            taken = tried
        else:
            missed += group
    untested = tuple(old.names[k] for k in missed)
    why = f"not determined by {residuals.data}" if missed else None
    if taken:
        names, units = zip(*((old.names[k], old.units[k]) for k in taken), strict=True)
        return np.eye(len(old.x))[:, taken], names, units, untested, why
    # not even the bias: the directions of it that the log does show
    biases = groups[0]
    _, size, directions = np.linalg.svd(shown[:, biases])
    directions = directions[: np.sum(size > size[0] / LARGEST_CONDITION)]
    largest = np.argmax(np.abs(directions), axis=1)[:, None]
    directions = directions * np.sign(np.take_along_axis(directions, largest, axis=1))
    basis = np.zeros((len(old.x), len(directions)))
    basis[biases] = directions.T
    names = tuple("b along ({}, {}, {})".format(*(np.round(d, 2) + 0.0)) for d in directions)
    units = (old.units[biases[0]],) * len(names)
    return basis, names, units, untested, f"{why}, but for its bias along gravity"


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
