"""Residuals of a new log under an old calibration, and which of its changes the log determines."""

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
SCALES, BIASES = ("K0", "K1", "K2"), ("b0", "b1", "b2")


@dataclass(frozen=True)
class OldParameters:
    """A sensor's calibration as its fit had it: n parameters, SI as logged.

    Attributes
    ----------
    names : tuple of str
        Misalignments, scale factors, biases, effects that were fitted with them.
    x, covariance : ndarray, shape (n,) and (n, n)
        Values; covariance zero for what was not estimated.
    units : tuple of str
        SI unit of each parameter's change; ``1`` for a scale factor, whose change is relative.
    effects : list of Effect
        Fitted with the base parameters.
    known : list of FittedEffect
        The others.
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
        unit, estimated = sensor.raw_unit, {each.partition(".")[0] for each in sensor.names}
        fitted = [effect for effect in sensor.effects if effect.name in estimated]
        known = [effect for effect in sensor.effects if effect.name not in estimated]
        bias = "m/s^2" if name == "accelerometer" else "rad/s"
        units = {each: {"T": "rad", "K": "1", "b": bias}[each[0]] for each in base}
        for each in fitted:
            units |= {f"{each.name}.{p}": u for p, u in each.effect.units(name).items()}
        names = tuple(units)
        T = [sensor.T[int(each[1]), int(each[2])] for each in base[:-6]]
        values = [value for each in fitted for value in each.vector]
        x = np.array([*T, *(sensor.K / unit.scale), *unit.to_si(sensor.b), *values])
        factor = np.array([{"K": 1 / unit.scale, "b": unit.scale}.get(n[0], 1.0) for n in base])
        factor = np.append(factor, np.ones(len(values)))
        covariance = np.zeros((len(x), len(x)))
        place = [names.index(each) for each in sensor.names]
        covariance[np.ix_(place, place)] = sensor.covariance
        covariance *= np.outer(factor, factor)
        effects = [each.effect for each in fitted]
        return cls(names, x, covariance, tuple(units.values()), effects, known)


@dataclass(frozen=True)
class DriftResiduals:
    """Residuals of a new log as a function of a sensor's parameters.

    Attributes
    ----------
    sensor : str
        Its name.
    old : OldParameters
        Of the old calibration, p of them.
    estimated : tuple of str
        What it estimated.
    function : callable
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
    DriftResiduals or str
        Or why there are none.
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
    """Return the gyroscope's residuals: the rate at rest, and gravity after each turn.

    Parameters
    ----------
    calibration, recording, noise
        As of `accelerometer_residuals`.
    force : DriftResiduals or str
        The accelerometer's; without them there is no direction of gravity, and no turn.
    change : (ndarray, ndarray), or None
        How its parameters have changed, with the covariance, where they have.

    Returns
    -------
    DriftResiduals or str
        Or why there are none. Turns are left out where misalignment and scale factor of a sensor
        were not estimated.
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
    n, turns = 3 * len(poses), len(recording.rotations)
    if turns and not isinstance(force, str) and "K0" in sensor.names:
        model = gyroscope.gyroscope_model(recording, at, old.x, old.effects, old.known)
        function = model.residuals
        expected = gyroscope.residual_covariance(
            model, old.x, poses, at.direction_covariance, noise
        )
    else:
        turns, expected = 0, np.zeros((n, n))
        for axis, covariance in enumerate(poses.mean_covariance(noise)[3:]):
            expected[axis::3, axis::3] = covariance
        K, b = old.x[6:9], old.x[9:12]
        channels = recording.pose_channels("gyroscope", lambda y: K * (y - b), at.poses)
        model = gyroscope.GyroscopeModel(
            rate=poses.w,
            rate_design=effect_design(old.effects, channels),
            rotations=recording.rotations,
            rotation_design=None,
            directions=None,
            rate_known=sum((e.output(channels) for e in old.known), start=np.zeros_like(poses.w)),
        )

        def function(x):
            r, jacobian = model.pose_rates(x)
            return r.ravel(), jacobian.reshape(n, -1)

    return DriftResiduals(
        "gyroscope",
        old,
        sensor.names,
        function,
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
    stays determined. What is left out is taken as the calibration has it, with its errors.

    Returns
    -------
    basis : ndarray, shape (p, q)
        Changes of the parameters, a column each.
    names, units : tuple of str
        Their names and SI units.
    untested : tuple of str
        Parameters that are not determined.
    why : str or None
        The reason.
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
