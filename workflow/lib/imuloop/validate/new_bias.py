"""A calibration with the biases of a new log; all else in it stays."""

from dataclasses import replace

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import SENSORS
from imuloop.model.raw_units import si_factor
from imuloop.validate.drift import fit_change
from imuloop.validate.drift_residuals import BIASES, DriftResiduals, testable


def update_biases(calibration, recording, noise, log, *, gravity=None):
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
    log : str
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
    nothing = recording.rotations.select(np.zeros(len(recording.rotations), dtype=bool))
    rests = replace(recording.of_new_power_cycles(), rotations=nothing)
    residuals = DriftResiduals.of(calibration, rests, noise, gravity or calibration.gravity)
    _, jacobian = residuals.at(residuals.old.x)
    kept = dict(residuals.untestable)
    for name in residuals.tested:
        if not set(BIASES) <= set(testable(residuals, name, jacobian)[1]):
            kept[name] = f"the bias is not determined by {residuals.data(name)}"
            if name == "accelerometer":
                kept[name] += "; it takes three or more in directions of their own"
    updated = [name for name in SENSORS if name not in kept]
    if not updated:
        why = "; ".join(f"{name}: {kept[name]}" for name in SENSORS)
        raise ImuloopError(f"no bias can be updated: {why}")
    change, covariance = _new_biases(residuals, updated)
    sensors = {
        name: _with_bias(getattr(calibration, name), residuals, name, change, covariance)
        for name in updated
    }
    logs = calibration.updated | dict.fromkeys(updated, log)
    return replace(calibration, **sensors, updated=logs), kept


def _new_biases(residuals, updated):
    """Return the change of all parameters, none but biases of some sensors, and covariance."""
    old = residuals.old
    biases = np.concatenate([residuals.places(name, BIASES) for name in updated])
    prior, change = residuals.covariance.copy(), np.zeros(len(old.x))
    prior[biases], prior[:, biases] = 0.0, 0.0
    found, own, expected = fit_change(residuals, np.eye(len(old.x))[:, biases], prior)
    _, jacobian = residuals.at(old.x)
    across = -own @ jacobian[:, biases].T @ np.linalg.solve(expected, jacobian @ prior)
    change[biases] = found
    prior[biases], prior[:, biases] = across, across.T
    prior[np.ix_(biases, biases)] = own
    return change, prior


def _with_bias(sensor, residuals, name, change, covariance):
    """Return a SensorCalibration with the change of its bias, and its covariance."""
    place, factor = residuals.places(name, sensor.names), si_factor(sensor.names, sensor.raw_unit)
    # of all other parameters as it was, to the last bit
    new, its = sensor.covariance.copy(), np.isin(sensor.names, BIASES)
    of_bias = its | its[:, None]
    new[of_bias] = (covariance[np.ix_(place, place)] / np.outer(factor, factor))[of_bias]
    moved = change[residuals.places(name, BIASES)] / sensor.raw_unit.scale
    return replace(sensor, b=sensor.b + moved, covariance=new)
