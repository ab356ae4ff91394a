"""The biases of a new log: those of a calibration, replaced; all else in it stays."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.model import Calibration
from imuloop.core.samples import SENSORS
from imuloop.validate.drift import fit_change
from imuloop.validate.drift_residuals import (
    BIASES,
    accelerometer_residuals,
    gyroscope_residuals,
    si_factor,
    testable,
)


@dataclass(frozen=True)
class BiasUpdate:
    """A calibration with new biases, and by sensor why one kept its own."""

    calibration: Calibration
    kept: dict[str, str]


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
        The old calibration; rests of the new log, one run; noise of the device.
    log : str
        Name of the new log, for the calibration.
    gravity : float, optional
        Where the log was recorded, m/s^2; that of the calibration by default.

    Returns
    -------
    BiasUpdate

    Raises
    ------
    ImuloopError
        If the log determines the bias of neither sensor.
    """
    nothing = recording.rotations.select(np.zeros(len(recording.rotations), dtype=bool))
    rests = replace(recording.of_new_runs(), rotations=nothing)
    gravity, kept, updated = gravity or calibration.gravity, {}, {}
    for name, axes in SENSORS.items():
        if name == "accelerometer":
            force = found = accelerometer_residuals(calibration, rests, noise, gravity)
        else:
            # specific force as the new bias has it
            found = gyroscope_residuals(calibration, rests, noise, force, None)
        why = found if isinstance(found, str) else recording.poses.unknown_noise(noise, axes)
        if not why and not set(BIASES) <= set(testable(found)[1]):
            why = f"the bias is not determined by {found.data}"
            if name == "accelerometer":
                why += "; it takes three or more in directions of their own"
        if why:
            kept[name] = why
            continue
        new = _with_bias(getattr(calibration, name), found)
        calibration, updated[name] = replace(calibration, **{name: new}), log
    if not updated:
        why = "; ".join(f"{name}: {each}" for name, each in kept.items())
        raise ImuloopError(f"no bias can be updated: {why}")
    return BiasUpdate(replace(calibration, updated=calibration.updated | updated), kept)


def _with_bias(sensor, residuals):
    """Return a SensorCalibration with the bias that DriftResiduals show."""
    old, factor = residuals.old, si_factor(sensor)
    place = [old.names.index(name) for name in sensor.names]
    biases = [old.names.index(name) for name in BIASES]
    prior = old.covariance.copy()
    prior[biases], prior[:, biases] = 0.0, 0.0
    change, own, expected, _ = fit_change(residuals, np.eye(len(old.x))[:, biases], prior)
    _, jacobian = residuals.function(old.x)
    across = -own @ jacobian[:, biases].T @ np.linalg.solve(expected, jacobian @ prior)
    new = prior
    new[biases], new[:, biases] = across, across.T
    new[np.ix_(biases, biases)] = own
    # of all other parameters as it was, to the last bit
    covariance = sensor.covariance.copy()
    its = np.isin(sensor.names, BIASES)
    of_bias = its | its[:, None]
    raw = new[np.ix_(place, place)] / np.outer(factor, factor)
    covariance[of_bias] = raw[of_bias]
    return replace(sensor, b=sensor.b + change / sensor.raw_unit.scale, covariance=covariance)
