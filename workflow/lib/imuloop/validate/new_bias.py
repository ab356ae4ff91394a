"""Update of the biases of a calibration by a new log; all other parameters are kept."""

from dataclasses import replace

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import SENSORS
from imuloop.model.raw_units import si_factor
from imuloop.validate.new_log import BIASES, NewLog


def update_biases(calibration, recording, noise, source, *, gravity=None):
    """Return a calibration whose biases are replaced by those that the rests of a new log show.

    Let r be the residuals at rest: ``|f| - g`` of the accelerometer, or the angular rate less the
    effects. J_b is their derivative with respect to the bias b, and J_p their derivative with
    respect to all other parameters p, which are kept. The new bias minimises ``rᵀ S⁻¹ r`` with
    ``S = Σ + J_p C_p J_pᵀ``, where Σ is the covariance of the noise of the new log and C_p the
    covariance of p. The covariance of the new bias is ``C_b = (J_bᵀ S⁻¹ J_b)⁻¹``, and the
    covariance between new bias and p is ``-C_b J_bᵀ S⁻¹ J_p C_p``. The old bias has no weight. An
    effect on the bias, such as `bias_temperature`, is kept as it is.

    Parameters
    ----------
    calibration, recording, noise : Calibration, Recording, NoiseModel
        The old calibration; rests of the new log, one power cycle; noise of the device.
    source : str
        Name of the new log, which the calibration keeps as the source of its biases.
    gravity : float, optional
        Gravity where the log was recorded, m/s^2; by default the gravity of the calibration.

    Returns
    -------
    Calibration
        The calibration with new biases.
    dict of str to str
        For each sensor whose bias is kept, the reason.

    Raises
    ------
    ImuloopError
        If the log determines the bias of neither sensor.
    """
    log = NewLog(calibration, recording, noise, gravity, turns=False)
    kept = dict(log.untestable)
    for name in log.factors.sensors:
        if not set(BIASES) <= set(log.testable(name).names):
            kept[name] = f"the bias is not determined by {log.describe_data(name)}"
            if name == "accelerometer":
                kept[name] += "; it takes three or more in different directions"
    updated = [name for name in SENSORS if name not in kept]
    if not updated:
        why = "; ".join(f"{name}: {kept[name]}" for name in SENSORS)
        raise ImuloopError(f"no bias can be updated: {why}")
    change, covariance = _new_biases(log, updated)
    sensors = {name: _with_bias(log, name, change, covariance) for name in updated}
    names = calibration.updated | dict.fromkeys(updated, source)
    return replace(calibration, **sensors, updated=names), kept


def _new_biases(log, updated):
    """Return the change of the p parameters by new biases, (p,), and their new covariance, (p, p).

    `log` is the NewLog. Only the biases of the sensors `updated`, a list of names, change; the
    change of all other parameters is zero.
    """
    (old, covariance), jacobian = log.prior, log.unchanged.jacobian
    biases = [place for name in updated for place in log.places(name, BIASES)]
    basis, others = np.eye(len(old.x))[:, biases], np.ones(len(old.x))
    # the old bias has no weight: the errors of all other parameters remain
    others[biases] = 0.0
    prior = covariance * np.outer(others, others)
    change, bias_covariance, expected = log.fit_change(basis, prior)
    # covariance of the new biases with the other parameters, -C_b J_bᵀ S⁻¹ J_p C_p
    weighted = np.linalg.solve(expected, jacobian @ prior)
    across = basis @ -bias_covariance @ (jacobian @ basis).T @ weighted
    return basis @ change, prior + across + across.T + basis @ bias_covariance @ basis.T


def _with_bias(log, name, change, covariance):
    """Return the SensorCalibration of the sensor `name` with its new bias and covariance.

    `log` is the NewLog. `change` is the change of its p parameters in nominal SI, (p,), and
    `covariance` their new covariance, (p, p).
    """
    sensor = getattr(log.calibration, name)
    # the covariance of a calibration is in raw units
    place, factor = log.places(name, sensor.names), si_factor(sensor.names, sensor.raw_unit)
    # the covariance of all other parameters is kept to the last bit
    is_bias, new = np.isin(sensor.names, BIASES), covariance[np.ix_(place, place)]
    new = np.where(is_bias | is_bias[:, None], new / np.outer(factor, factor), sensor.covariance)
    bias_change = change[log.places(name, BIASES)] / sensor.raw_unit.scale
    return replace(sensor, b=sensor.b + bias_change, covariance=new)
