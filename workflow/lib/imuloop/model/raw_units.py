"""Conversion between parameters in nominal SI and a calibration in the raw units of a log.

Nominal SI values are raw values less the data sheet's offset, times its scale.
"""

import numpy as np

from imuloop.model.effect import FittedEffect
from imuloop.model.effects import SensorEffect
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.model.state import BASE, ENTRIES, NAMES, State


def in_raw_units(sensor, unit, x, covariance, effects=(), prior=None, **fields):
    """Return the SensorCalibration, in raw units, of parameters that were fitted in nominal SI.

    The scale factors K become ``K_raw = K s`` and the biases b ``b_raw = b / s + offset``, where s
    is `unit.scale`, offset is `unit.offset`, and nominal SI values are ``s (raw - offset)``. The
    misalignment T does not depend on the unit.

    Parameters
    ----------
    sensor : str
        Name of the sensor.
    unit : RawUnit
        The raw unit of the sensor in the log.
    x : ndarray, shape (p,)
        The p parameters, nominal SI: the off-diagonal elements of T, then K, b and the parameters
        of the effects.
    covariance : ndarray, shape (p, p)
        Covariance of the parameters x.
    effects : sequence of Effect, optional
        The effects of the sensor.
    prior : Prior, optional
        Prior of the fit.
    **fields
        Other fields of the SensorCalibration.
    """
    names, T, fitted = NAMES[sensor], np.eye(3), []
    # K and b are the last six parameters without effects
    elements, K, b, of_effects = np.split(x, np.cumsum([len(names) - 6, 3, 3]))
    T[ENTRIES[sensor]] = elements
    errors = np.sqrt(np.diag(covariance))[len(names) :]
    for effect in effects:
        n = len(effect.parameters)
        values, std = (
            dict(zip(effect.parameters, numbers[:n].tolist(), strict=True))
            for numbers in (of_effects, errors)
        )
        of_effects, errors = of_effects[n:], errors[n:]
        fitted.append(FittedEffect(effect, values=values, std=std))
        names += tuple(f"{effect.name}.{p}" for p in effect.parameters)
    factor = si_factor(names, unit)
    return SensorCalibration(
        raw_unit=unit,
        T=T,
        K=K * unit.scale,
        b=unit.from_si(b),
        names=names,
        covariance=covariance / np.outer(factor, factor),
        effects=tuple(fitted),
        prior=prior and prior_content(sensor, prior, unit),
        **fields,
    )


def prior_content(sensor, prior, unit):
    """Return the prior of a sensor in the raw units of its log, a dict for the JSON file.

    The dict has the ``source`` of the prior, and ``mean`` and ``std``, which are dicts by name of
    the parameter. `sensor` is the name of the sensor, `prior` the Prior of the device in nominal
    SI, and `unit` the RawUnit of the log.
    """
    names, places = NAMES[sensor], BASE[sensor]
    factor = si_factor(names, unit)
    offset = np.array([unit.offset if name[0] == "b" else 0.0 for name in names])
    columns = {"mean": prior.mean[places] / factor + offset, "std": prior.std[places] / factor}
    return {"source": prior.sources[sensor]} | {
        key: dict(zip(names, values.tolist(), strict=True)) for key, values in columns.items()
    }


def in_nominal_si(sensor, calibration):
    """Return the parameters T, K and b of a sensor, converted to nominal SI, (p,).

    They are the off-diagonal elements of the misalignment T, then the scale factors K and the
    biases b; p is 9 for the accelerometer and 12 for the gyroscope. `sensor` is the name of the
    sensor, and `calibration` its SensorCalibration in raw units.
    """
    unit = calibration.raw_unit
    T = calibration.T[ENTRIES[sensor]]
    return np.concatenate([T, calibration.K / unit.scale, unit.to_si(calibration.b)])


def state_of(calibration, effects=None):
    """Return the State of a Calibration, p parameters in nominal SI, and their covariance.

    In the covariance, elements for two parameters of different sensors are zero. The variance of a
    parameter that was not estimated is zero, too. `calibration` is the Calibration. `effects` is a
    sequence of SensorEffect, the effects of the calibration that the State includes; by default it
    includes all.

    Returns
    -------
    State
        The parameters of both sensors and of the effects.
    ndarray, shape (p, p)
        Covariance of all these parameters.
    """
    sensors = {name: getattr(calibration, name) for name in NAMES}
    fitted = {SensorEffect(e.effect, s): e for s in sensors for e in sensors[s].effects}
    effects = tuple(fitted if effects is None else effects)
    by_sensor = [in_nominal_si(name, sensor) for name, sensor in sensors.items()]
    state = State(np.concatenate([*by_sensor, *(fitted[e].vector for e in effects)]), effects)
    index = {name: k for k, name in enumerate(state.names)}
    covariance = np.zeros((len(index),) * 2)
    # effects from another record than the other parameters have standard errors only
    for effect in effects:
        for name, std in fitted[effect].std.items():
            k = index[f"{effect.sensor}.{effect.name}.{name}"]
            covariance[k, k] = std**2
    for sensor, calibrated in sensors.items():
        # rows of the sensor's covariance that are parameters of the state, and their indices there
        names = [f"{sensor}.{name}" for name in calibrated.names]
        rows = [row for row, name in enumerate(names) if name in index]
        if rows:
            places = [index[names[row]] for row in rows]
            factor = si_factor(calibrated.names, calibrated.raw_unit)
            block = calibrated.covariance * np.outer(factor, factor)
            covariance[np.ix_(places, places)] = block[np.ix_(rows, rows)]
    return state, covariance


def si_factor(names, unit):
    """Return the factors that convert errors of p parameters from raw units to nominal SI, (p,).

    `names` are the names of the parameters, such as ``K0``, and `unit` is the RawUnit with the
    scale s. The factor is 1/s for scale factors K, s for biases b, and 1 for the misalignment T and
    for parameters of effects. The offset of the unit is not used, because a constant that is added
    to a parameter does not change its error.
    """
    factors = {"K": 1 / unit.scale, "b": unit.scale}
    return np.array([1.0 if "." in name else factors.get(name[0], 1.0) for name in names])
