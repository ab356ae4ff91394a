"""Test whether a device has drifted: whether its calibration still holds in a new log."""

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
    """The change of one parameter, new value minus old value, and the test of it.

    Attributes
    ----------
    name : str
        Name of the parameter, such as ``K0``. It is ``b along (x, y, z)``, a direction on the axes
        of the sensor, if the log shows the bias along this direction only.
    unit : str
        SI unit of `change`, `measured_std` and `std`. The change of a scale factor is relative.
    change, sigmas : float
        The change, in `unit`, and its ratio to `std`.
    measured_std : float
        Standard error of the change by the errors of the old calibration and of the new log.
    std : float
        Standard error of the change that also includes the scatter of a bias between power cycles.
    p_value, p_holm : float
        Probability that a device without drift shows a change of at least this size in this
        parameter, and this probability adjusted by Holm's method for all tested parameters.
    drifted : bool
        Whether `p_holm` is below the level of the test, half the `level` of `check_drift`.
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
        """Whether the parameter is a bias, or the bias along a direction."""
        return self.name in BIASES or self.name.startswith("b along")


@dataclass(frozen=True)
class SensorDrift:
    """The drift test of one sensor.

    Attributes
    ----------
    drifted : bool or None
        Whether the sensor has drifted; None if no parameter could be tested.
    changes : tuple of Change
        The changes that were tested, the smallest p-value first.
    untested, why : tuple of str, str or None
        The parameters that were not tested, and the reason; None if all were tested.
    chi2, dof, p_holm : float, int, float
        The joint χ² test of all changes: χ², its degrees of freedom, and the p-value, adjusted by
        Holm's method for both sensors.
    residuals : dict
        For each kind of residual, the root mean square with the old calibration, and the root mean
        square that the noise and the errors of the calibration predict, SI (`NewLog.sizes`).
    turn_on : tuple of float
        Standard deviations of the three biases between power cycles, as the test assumes, SI.
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
    """The drift test of both sensors on a new log.

    `level` is the probability of a false alarm. `poses` and `rotations` are the numbers of rests in
    the log and of turns between them.
    """

    device: str
    level: float
    poses: int
    rotations: int
    sensors: dict[str, SensorDrift]

    @property
    def drifted(self):
        """Whether any sensor has drifted."""
        return any(sensor.drifted for sensor in self.sensors.values())

    @property
    def bias_only(self):
        """Whether a bias has drifted and no other parameter has."""
        changed = [c for s in self.sensors.values() for c in s.changes if c.drifted]
        return bool(changed) and all(change.is_bias for change in changed)

    def to_dict(self):
        """Return the test and its results as the content of a JSON file, a dict."""
        result = {"drifted": self.drifted, "bias_only": self.bias_only}
        return {"format": 1, **result, **asdict(self)}


def check_drift(calibration, recording, noise, *, gravity=None, level=0.05, turn_on=None):
    """Test whether the parameters of a calibration still hold in a new log.

    Let r be the residuals of both sensors in the new log with the old parameters: ``|f| - g`` at
    rest, the angular rate at rest, and the error of gravity's direction after each turn. J is their
    Jacobian. Without a drift their covariance is ``S = Σ + J C Jᵀ``, where Σ is the covariance of
    the noise and C the covariance of the old parameters. The change δ of the parameters that the
    log determines minimises ``(r + J δ)ᵀ S⁻¹ (r + J δ)``. If the log determines all parameters, δ
    is a new calibration less the old one, and the covariance of δ is the sum of both covariances.
    The scatter of a bias between power cycles adds to this covariance.

    Two families of tests are made, each at half the `level`. One tests each parameter by itself,
    the other tests all parameters of a sensor together by χ². The p-values of each family are
    adjusted by Holm's method.

    δ is the change of each parameter if all others may change too. A fit with the old calibration
    as prior would spread the change of one parameter over others that are correlated with it.

    Parameters
    ----------
    calibration, recording, noise : Calibration, Recording, NoiseModel
        The old calibration; rests of the new log and turns between them; noise of the device.
    gravity : float, optional
        Gravity where the log was recorded, m/s^2; by default the gravity of the calibration.
    level : float
        Probability of a false alarm.
    turn_on : (float, float), optional
        Standard deviation of the bias between power cycles, m/s^2 and rad/s. By default it is the
        estimate of the effect `turn_on_bias` of the calibration or, without this effect, the value
        of data sheets, `TURN_ON`.

    Returns
    -------
    Drift
        The tests of both sensors.

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
    """Return the SensorDrift, the result of the drift test, of each sensor, a dict by name.

    A sensor without residuals has a SensorDrift that says why it was not tested. `log` is the
    NewLog. `turn_on` has for each sensor the standard deviations of its three biases between power
    cycles, SI. `level` is the level of each of two families of tests: each parameter by itself, and
    all parameters of a sensor together.
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
    """Return the changes of parameters that a new log shows along q directions, and covariances.

    `log` is the NewLog. The directions are the columns of `basis`, (p, q), each a change of the p
    old parameters. `turn_on` has for each sensor the standard deviations of its three biases
    between power cycles, SI: their scatter.

    Along the q directions, this scatter is added to the covariance of the changes after the fit. It
    is not added to the covariance S of the residuals, by whose inverse they are weighted: there it
    would outweigh the noise, because the Jacobian is not quite the same at the old and at the new
    parameters. In all other directions, which are not fitted, the scatter is part of S.

    Returns
    -------
    ndarray, shape (q,)
        The changes.
    ndarray, shape (q, q)
        Their covariance by the errors of the old calibration and of the new log.
    ndarray, shape (q, q)
        Their covariance with the scatter of the biases, too.
    ndarray, shape (n, n)
        Covariance S of the n residuals with the old parameters.
    """
    old, covariance = log.prior
    variance = np.zeros(len(old.x))
    for name in SENSORS:
        variance[log.places(name, BIASES)] = np.square(turn_on[name])
    scatter, not_fitted = np.diag(variance), np.eye(len(basis)) - basis @ basis.T
    prior = covariance + not_fitted @ scatter @ not_fitted
    change, measured, expected = log.fit_change(basis, prior)
    return change, measured, measured + basis.T @ scatter @ basis, expected
