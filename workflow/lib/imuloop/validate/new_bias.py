"""A calibration with the biases of a new log; all else in it stays."""

from dataclasses import replace

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import SENSORS
from imuloop.model.raw_units import si_factor
from imuloop.validate.new_log import BIASES, NewLog


def update_biases(calibration, recording, noise, source, *, gravity=None):
    """Replace the biases of a calibration by those that the rests of a new log show.

    With p the other parameters, as they are, and r the residuals at rest, ``|f| - g`` or the
    angular rate without effects, the bias is the b of least ``rᵀ S⁻¹ r``, where
    ``S = Σ + J_p C_p J_pᵀ`` holds the noise of the new log and what the errors of p leave. With
    ``G = -C_b J_bᵀ S⁻¹`` its covariance is ``C_b = (J_bᵀ S⁻¹ J_b)⁻¹``, that with p ``G J_p C_p``.
    The old bias has no weight, and that of an effect, as `bias_temperature`, stays in its effect.

    Parameters
    ----------
    calibration, recording, noise : Calibration, Recording, NoiseModel
        The old calibration; rests of the new log, one power cycle; noise of the device.
    source : str
        Name of the new log, for the calibration.
    gravity : float, optional
        Where the log was recorded, m/s^2; that of the calibration by default.

    Returns
    -------
    Calibration, dict of str to str
        That with the new biases, and by sensor why one kept its own.

    Raises
    ------
    ImuloopError
        If the log determines the bias of neither sensor.
    """
    log = NewLog(calibration, recording, noise, gravity, turns=False)
    kept = dict(log.untestable)
    for name in log.factors.sensors:
        if not set(BIASES) <= set(log.testable(name).names):
            kept[name] = f"the bias is not determined by {log.data(name)}"
            if name == "accelerometer":
                kept[name] += "; it takes three or more in directions of their own"
    updated = [name for name in SENSORS if name not in kept]
    if not updated:
        why = "; ".join(f"{name}: {kept[name]}" for name in SENSORS)
        raise ImuloopError(f"no bias can be updated: {why}")
    change, covariance = _new_biases(log, updated)
    sensors = {name: _with_bias(log, name, change, covariance) for name in updated}
    names = calibration.updated | dict.fromkeys(updated, source)
    return replace(calibration, **sensors, updated=names), kept


def _new_biases(log, updated):
    """Return the change of all parameters, none but biases of some sensors, and covariance."""
    (old, covariance), jacobian = log.prior, log.unchanged.jacobian
    biases = [place for name in updated for place in log.places(name, BIASES)]
    basis, rest = np.eye(len(old.x))[:, biases], np.ones(len(old.x))
    rest[biases] = 0.0
    prior = covariance * np.outer(rest, rest)
    change, own, expected = log.fit_change(basis, prior)
    across = -own @ (jacobian @ basis).T @ np.linalg.solve(expected, jacobian @ prior)
    across = basis @ across
    return basis @ change, prior + across + across.T + basis @ own @ basis.T


def _with_bias(log, name, change, covariance):
    """Return the SensorCalibration of a name with the change of its bias, and its covariance."""
    sensor = getattr(log.calibration, name)
    place, factor = log.places(name, sensor.names), si_factor(sensor.names, sensor.raw_unit)
    # of all other parameters as it was, to the last bit
    its, new = np.isin(sensor.names, BIASES), covariance[np.ix_(place, place)]
    new = np.where(its | its[:, None], new / np.outer(factor, factor), sensor.covariance)
    moved = change[log.places(name, BIASES)] / sensor.raw_unit.scale
    return replace(sensor, b=sensor.b + moved, covariance=new)
