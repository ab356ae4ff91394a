"""Has a device drifted? The parameters of a calibration tested on a new log."""

from dataclasses import asdict, dataclass

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.special import chdtrc, ndtr

from imuloop.core.errors import ImuloopError
from imuloop.core.p_values import holm
from imuloop.core.samples import SENSORS
from imuloop.effects.turn_on_bias import turn_on_std
from imuloop.estimate.least_squares import chi_square
from imuloop.validate.drift_residuals import BIASES, DriftResiduals, testable

# level at which a misfit of the new log widens the errors
MISFIT = 0.01
# degrees of freedom below which nothing is left to judge a misfit by
LEAST_DOF = 0.5
SCALES = ("K0", "K1", "K2")


@dataclass(frozen=True)
class Change:
    """The change of one parameter: new less old, in SI, relative for a scale factor.

    Its name is that of the calibration's covariance, or ``b along (x, y, z)``, on the sensor axes,
    where the log shows one direction of the bias alone. `measured_std` is its standard error by the
    old calibration and the new log; `std` also has the scatter of a bias from one switching on to
    the next. The p-value is that of as much without a drift, and that for the largest of all
    parameters tested, after Holm.
    """

    name: str
    unit: str
    change: float
    measured_std: float
    std: float
    sigmas: float
    p_value: float
    p_holm: float
    drifted: bool

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
    predict. What of the bias was allowed for, SI.
    """

    drifted: bool | None
    changes: tuple = ()
    untested: tuple = ()
    why: str | None = None
    chi2: float | None = None
    dof: int = 0
    p_holm: float | None = None
    residuals: dict | None = None
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

    With the old parameters x, r are the residuals of both sensors in the new log: ``|f| - g`` at
    rest; angular rate at rest and the direction of gravity after each turn. Their covariance
    without a drift is ``S = Σ + J C Jᵀ``, of the noise and of the calibration's own errors C. The
    change of those parameters that the log determines is the δ of least
    ``(r + J δ)ᵀ S⁻¹ (r + J δ)``. If it determines all of them, δ is the difference to a new
    calibration, and its covariance the sum of both. The scatter of a bias from one switching on to
    the next adds to that covariance. Two families of tests share the level: each
    parameter by itself, and one χ² test per sensor of all together; each family after Holm.

    Parameters
    ----------
    calibration, recording, noise : Calibration, Recording, NoiseModel
        The old calibration; rests, and turns between them, of the new log; noise of the device.
    gravity : float, optional
        Where the log was recorded, m/s^2; that of the calibration by default.
    level : float
        Probability of a false alarm.
    turn_on : (float, float), optional
        Standard deviation of the bias from one switching on to the next, m/s^2 and rad/s. The
        default is the standard deviation in the calibration's `turn_on_bias`, or `TURN_ON` if it
        has none.

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
    recording, gravity = recording.of_new_power_cycles(), gravity or calibration.gravity
    if turn_on:
        allowed = {name: (float(std),) * 3 for name, std in zip(SENSORS, turn_on, strict=True)}
    else:
        allowed = {name: turn_on_std(getattr(calibration, name), name) for name in SENSORS}
    try:
        residuals = DriftResiduals.of(calibration, recording, noise, gravity)
        if not residuals.tested:
            why = "; ".join(f"{name}: {why}" for name, why in residuals.untestable.items())
            raise ImuloopError(f"nothing can be tested: {why}")
        sensors = _test(residuals, allowed, level / 2)
    except LinAlgError as error:
        raise ImuloopError(
            "nothing can be tested: the calibration is so far from the log, or its errors are so "
            "large, that rounding leaves nothing of the noise"
        ) from error
    rotations = 0 if recording.rotations is None else len(recording.rotations)
    return Drift(calibration.device, level, len(recording.poses), rotations, sensors)


def _test(residuals, turn_on, level):
    """Return the SensorDrift of each sensor.

    Takes what of the bias is allowed for, by sensor, and the level of each family of tests.
    """
    old, tested = residuals.old, residuals.tested
    r, jacobian = residuals.at(old.x)
    tests = [testable(residuals, name, jacobian) for name in tested]
    basis = np.hstack([own[0] for own in tests])
    scatter = np.zeros(len(old.x))
    for name in SENSORS:
        scatter[residuals.places(name, BIASES)] = np.square(turn_on[name])
    # the log alone determines the change of a bias, so the scatter adds to its error. In S it would
    # hide the noise, as the derivative is not quite the same at the old and at the new parameters
    hidden = np.eye(len(basis)) - basis @ basis.T
    change, covariance, expected = fit_change(
        residuals, basis, residuals.covariance + hidden * scatter @ hidden
    )
    measured = np.sqrt(np.diag(covariance))
    covariance = covariance + basis.T * scatter @ basis
    std = np.sqrt(np.diag(covariance))
    p_values = 2 * ndtr(-np.abs(change / std))
    # the change of a scale factor is relative
    scaled = [name in SCALES for own in tests for name in own[1]]
    factor = np.where(scaled, basis.T @ old.x, 1.0)
    sizes = (each / factor for each in (change, measured, std))
    numbers = *sizes, change / std, p_values, holm(p_values)
    numbers = np.column_stack(numbers).tolist()
    ends = np.cumsum([own[0].shape[1] for own in tests])
    parts = [slice(end - own[0].shape[1], end) for own, end in zip(tests, ends, strict=True)]
    joint = [float(change[at] @ np.linalg.solve(covariance[at, at], change[at])) for at in parts]
    chances = [float(chdtrc(at.stop - at.start, x)) for x, at in zip(joint, parts, strict=True)]
    found = {
        name: SensorDrift(None, untested=residuals.estimated[name], why=why)
        for name, why in residuals.untestable.items()
    }
    together = zip(tested, tests, parts, joint, holm(chances).tolist(), strict=True)
    for name, (_, names, units, untested, why), at, square, p_holm in together:
        rows = zip(names, units, numbers[at], strict=True)
        changes = [Change(name, unit, *own, own[-1] < level) for name, unit, own in rows]
        found[name] = SensorDrift(
            p_holm < level or any(each.drifted for each in changes),
            tuple(sorted(changes, key=lambda each: each.p_value)),
            untested,
            why,
            square,
            len(changes),
            p_holm,
            residuals.summary(name, r, np.diag(expected)),
            turn_on[name],
        )
    return {name: found[name] for name in SENSORS}


def fit_change(residuals, basis, prior):
    """Return the change δ of the parameters along a basis, (p, q), that a new log shows.

    With its covariance, and the covariance S of the residuals before it. `prior`, (p, p), is the
    covariance of the old parameters.
    """
    _, jacobian = residuals.at(residuals.old.x)
    known, owners = jacobian @ prior @ jacobian.T, residuals.owners
    excess = np.ones(len(owners))
    *_, left = _solve(residuals, basis, residuals.noise + known)
    groups = [owners == name for name in residuals.tested]
    for at, (square, dof) in zip(groups, chi_square(*left, groups)[0], strict=True):
        # the new log fits worse than its noise whatever the parameters: so do they
        if dof > LEAST_DOF and chdtrc(dof, square) < MISFIT:
            excess[at] = square / dof
    size = np.sqrt(excess)
    expected = residuals.noise * np.outer(size, size) + known
    change, covariance, _ = _solve(residuals, basis, expected)
    if not np.all(np.diag(covariance) > 0):
        raise LinAlgError("rounding leaves a covariance indefinite")
    return change, covariance, expected


def _solve(residuals, basis, expected):
    """Return the δ of least ``(r + J δ)ᵀ S⁻¹ (r + J δ)``, its covariance, and r, S and J there."""
    change, root = np.zeros(basis.shape[1]), cholesky(expected, lower=True)
    # nearly linear: the second step is for changes that are large
    for _ in range(3):
        r, jacobian = residuals.at(residuals.old.x + basis @ change)
        design = solve_triangular(root, jacobian @ basis, lower=True)
        change = change - np.linalg.lstsq(design, solve_triangular(root, r, lower=True))[0]
    r, jacobian = residuals.at(residuals.old.x + basis @ change)
    return change, np.linalg.inv(design.T @ design), (r, expected, jacobian @ basis)
