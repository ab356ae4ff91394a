"""Has a device drifted? The parameters of a calibration tested on a new log."""

from dataclasses import asdict, dataclass

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import chdtrc, ndtr

from imuloop.core.errors import ImuloopError
from imuloop.core.p_values import holm
from imuloop.core.samples import SENSORS
from imuloop.effects.turn_on_bias import turn_on_std
from imuloop.validate.new_log import BIASES, NewLog

SCALES = ("K0", "K1", "K2")
# numbers of each tested change, which are fields of `Change`
COLUMNS = ("change", "measured_std", "std", "sigmas", "p_value", "p_holm")


@dataclass(frozen=True)
class Change:
    """The change of one parameter, new value minus old value.

    Attributes
    ----------
    name : str
        Name of the parameter, as in the covariance of the calibration. It is ``b along (x, y, z)``,
        a direction on the sensor axes, if the log shows the bias along this direction only.
    unit : str
        SI unit of `change`, `measured_std` and `std`, which are relative for a scale factor.
    change, sigmas : float
        The change, and its ratio to `std`.
    measured_std : float
        Standard error of the change by the errors of the old calibration and of the new log.
    std : float
        Standard error that also includes the scatter of a bias between power cycles.
    p_value, p_holm : float
        Probability of such a change without a drift, for this parameter by itself, and adjusted by
        Holm's method for all parameters that are tested.
    drifted : bool
        Whether `p_holm` is below the level.
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
        """Whether the parameter is a bias."""
        return self.name in BIASES or self.name.startswith("b along")


@dataclass(frozen=True)
class SensorDrift:
    """The test of one sensor.

    Attributes
    ----------
    drifted : bool or None
        Whether the sensor has drifted; None if nothing could be tested.
    changes : tuple of Change
        The changes that were tested, the smallest p-value first.
    untested, why : tuple of str, str or None
        The parameters that were not tested, and the reason.
    chi2, dof, p_holm : float, int, float
        The joint χ² test of all changes: χ², its degrees of freedom, and the p-value, adjusted by
        Holm's method for both sensors.
    residuals : dict
        For each kind of residual, its root mean square with the old calibration, and the value that
        noise and the errors of the calibration predict, SI.
    turn_on : tuple of float
        Standard deviations of the three biases between power cycles that were allowed for, SI.
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
        """Whether biases have drifted and no other parameter has."""
        changed = [c for s in self.sensors.values() for c in s.changes if c.drifted]
        return bool(changed) and all(change.is_bias for change in changed)

    def to_dict(self):
        """Return the content of the JSON file, a dict."""
        result = {"drifted": self.drifted, "bias_only": self.bias_only}
        return {"format": 1, **result, **asdict(self)}


def check_drift(calibration, recording, noise, *, gravity=None, level=0.05, turn_on=None):
    """Test whether the parameters of a calibration still hold in a new log.

    r are the residuals of both sensors in the new log with the old parameters: ``|f| - g`` at rest,
    the angular rate at rest, and the direction of gravity after each turn. J is their Jacobian.
    Without a drift their covariance is ``S = Σ + J C Jᵀ``, where Σ is the covariance of the noise
    and C the covariance of the old parameters. The change δ of the parameters that the log
    determines minimises ``(r + J δ)ᵀ S⁻¹ (r + J δ)``. If the log determines all parameters, δ is a
    new calibration less the old one, and the covariance of δ is the sum of the covariances of both.
    The scatter of a bias between power cycles adds to this covariance. Two families of tests share
    the level: each parameter by itself, and a χ² test of all parameters of a sensor together. The
    p-values of each family are adjusted by Holm's method.

    δ is the change of each parameter while all others may change too. A fit with the old
    calibration as prior would spread the change of one parameter over others that are correlated
    with it.

    Parameters
    ----------
    calibration, recording, noise : Calibration, Recording, NoiseModel
        The old calibration; rests, and turns between them, of the new log; noise of the device.
    gravity : float, optional
        Gravity where the log was recorded, m/s^2; by default the gravity of the calibration.
    level : float
        Probability of a false alarm.
    turn_on : (float, float), optional
        Standard deviation of the bias between power cycles, m/s^2 and rad/s. By default it follows
        from the effect `turn_on_bias` of the calibration or, without this effect, is that of data
        sheets, `TURN_ON`.

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
    allowed = {name: turn_on_std(getattr(calibration, name), name) for name in SENSORS}
    if turn_on:
        allowed = {name: (float(std),) * 3 for name, std in zip(SENSORS, turn_on, strict=True)}
    try:
        log = NewLog(calibration, recording, noise, gravity)
        if not log.factors.sensors:
            why = "; ".join(f"{name}: {why}" for name, why in log.untestable.items())
            raise ImuloopError(f"nothing can be tested: {why}")
        sensors = _test(log, allowed, level / 2)
    except LinAlgError as error:
        raise ImuloopError(
            "nothing can be tested: the calibration is so far from the log, or its errors are so "
            "large, that rounding leaves nothing of the noise"
        ) from error
    return Drift(
        device=calibration.device,
        level=level,
        poses=len(recording.poses),
        rotations=len(recording.rotations),
        sensors=sensors,
    )


def _test(log, turn_on, level):
    """Return the SensorDrift of each sensor of a NewLog, a dict by name.

    `turn_on` holds, by sensor, the standard deviations of the three biases between power cycles,
    SI. `level` is the level of each family of tests: each parameter, and all of a sensor together.
    """
    # each column of the basis is a change that the log determines, as a change of all parameters
    tests = {name: log.testable(name) for name in log.factors.sensors}
    basis = np.hstack([test.basis for test in tests.values()])
    change, measured, covariance, expected = _fit_changes(log, basis, turn_on)
    std = np.sqrt(np.diag(covariance))
    p_values = 2 * ndtr(-np.abs(change / std))
    # the change of a scale factor is relative
    old, _ = log.prior
    is_scale = [name in SCALES for test in tests.values() for name in test.names]
    unit = np.where(is_scale, basis.T @ old.x, 1.0)
    numbers = (change / unit, np.sqrt(np.diag(measured)) / unit, std / unit, change / std)
    rows = np.column_stack([*numbers, p_values, holm(p_values)]).tolist()
    # the joint test of each sensor: its part of the changes, χ², and the p-value
    counts = [len(test.names) for test in tests.values()]
    parts = [slice(end - n, end) for n, end in zip(counts, np.cumsum(counts), strict=True)]
    chi2 = [float(change[i] @ np.linalg.solve(covariance[i, i], change[i])) for i in parts]
    joint_p_values = holm([chdtrc(n, x) for n, x in zip(counts, chi2, strict=True)])
    result = {}
    for name, why in log.untestable.items():
        untested = getattr(log.calibration, name).names
        result[name] = SensorDrift(None, untested=untested, why=why)
    by_sensor = zip(tests.items(), parts, chi2, joint_p_values.tolist(), strict=True)
    for (name, test), part, square, p_holm in by_sensor:
        changes = []
        for key, unit, row in zip(test.names, test.units, rows[part], strict=True):
            values = dict(zip(COLUMNS, row, strict=True))
            changes.append(Change(key, unit, **values, drifted=values["p_holm"] < level))
        result[name] = SensorDrift(
            drifted=p_holm < level or any(change.drifted for change in changes),
            changes=tuple(sorted(changes, key=lambda change: change.p_value)),
            untested=test.untested,
            why=test.why,
            chi2=square,
            dof=len(changes),
            p_holm=p_holm,
            residuals=log.sizes(name, expected),
            turn_on=turn_on[name],
        )
    return {name: result[name] for name in SENSORS}


def _fit_changes(log, basis, turn_on):
    """Return the changes of the parameters of a NewLog along a basis, (p, q), and their errors.

    The scatter of a bias between power cycles adds to the error of a change that is fitted. In the
    covariance S of the residuals it would hide the noise, as their derivative is not quite the same
    at the old and at the new parameters. So S has the scatter only in the directions of the
    parameters that are not fitted.

    Returns
    -------
    ndarray, shape (q,)
        The changes.
    ndarray, shape (q, q), and ndarray, shape (q, q)
        Their covariance by the errors of the old calibration and of the new log, and the same with
        the scatter of biases, whose standard deviations `turn_on` holds by sensor, SI, (3,) each.
    ndarray, shape (n, n)
        Covariance S of the n residuals that the old parameters leave.
    """
    old, covariance = log.prior
    variance = np.zeros(len(old.x))
    for name in SENSORS:
        variance[log.places(name, BIASES)] = np.square(turn_on[name])
    scatter, not_fitted = np.diag(variance), np.eye(len(basis)) - basis @ basis.T
    prior = covariance + not_fitted @ scatter @ not_fitted
    change, measured, expected = log.fit_change(basis, prior)
    return change, measured, measured + basis.T @ scatter @ basis, expected
