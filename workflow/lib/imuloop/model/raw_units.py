"""Conversion between parameters in nominal SI and a calibration in the raw units of a log."""

import numpy as np

from imuloop.model.effect import FittedEffect
from imuloop.model.effects import SensorEffect
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.model.state import BASE, ENTRIES, NAMES, State


def in_raw_units(sensor, unit, x, covariance, effects=(), prior=None, **how):
    """Return the SensorCalibration, in raw units, of parameters in nominal SI.

    ``K_raw = K s`` and ``b_raw = b / s + offset``, where s is `unit.scale`, offset `unit.offset`,
    and nominal SI is ``s (raw - offset)``.

    Parameters
    ----------
    sensor, unit : str, RawUnit
        Name of the sensor, and the unit of its log.
    x, covariance : ndarray, shape (p,), (p, p)
        T, K and b, then the parameters of the effects, and their covariance.
    effects : sequence of Effect, optional
        The effects of the sensor.
    prior : Prior, optional
        Prior of the fit.
    **how
        Other fields of the SensorCalibration.
    """
    names, T = NAMES[sensor], np.eye(3)
    elements, K, b, of_effects = np.split(x, np.cumsum([len(names) - 6, 3, 3]))
    T[ENTRIES[sensor]] = elements
    std = iter(np.sqrt(np.diag(covariance))[len(names) :].tolist())
    names += tuple(f"{effect.name}.{p}" for effect in effects for p in effect.parameters)
    factor, values, fitted = si_factor(names, unit), iter(of_effects.tolist()), []
    for effect in effects:
        by_name = ({p: next(numbers) for p in effect.parameters} for numbers in (values, std))
        fitted.append(FittedEffect(effect, *by_name))
    return SensorCalibration(
        raw_unit=unit,
        T=T,
        K=K * unit.scale,
        b=unit.from_si(b),
        names=names,
        covariance=covariance / np.outer(factor, factor),
        effects=tuple(fitted),
        prior=prior and prior_content(sensor, prior, unit),
        **how,
    )


def prior_content(sensor, prior, unit):
    """Return the Prior of a sensor in raw units, as the `prior` of a SensorCalibration holds it.

    It is a dict with its ``source``, and with dicts ``mean`` and ``std`` by name of the parameter.
    """
    names, places = NAMES[sensor], BASE[sensor]
    factor = si_factor(names, unit)
    offset = np.array([unit.offset if name[0] == "b" else 0.0 for name in names])
    columns = {"mean": prior.mean[places] / factor + offset, "std": prior.std[places] / factor}
    return {"source": prior.sources[sensor]} | {
        key: dict(zip(names, values.tolist(), strict=True)) for key, values in columns.items()
    }


def as_logged(sensor, calibration):
    """Return T, K and b of a SensorCalibration in nominal SI, (p,): inverse of `in_raw_units`."""
    unit = calibration.raw_unit
    T = calibration.T[ENTRIES[sensor]]
    return np.concatenate([T, calibration.K / unit.scale, unit.to_si(calibration.b)])


def state_of(calibration, effects=None):
    """Return the State of a Calibration in nominal SI, with p parameters, and its covariance.

    Parameters of different sensors have no covariance, and parameters that were not estimated have
    no variance. `effects` is a sequence of SensorEffect, some of those of the calibration; by
    default the state has all of them.

    Returns
    -------
    State
        The parameters of both sensors and of the effects.
    ndarray, shape (p, p)
        Their covariance.
    """
    sensors = {name: getattr(calibration, name) for name in NAMES}
    fitted = {SensorEffect(e.effect, s): e for s, made in sensors.items() for e in made.effects}
    base = np.concatenate([as_logged(sensor, made) for sensor, made in sensors.items()])
    state = State(np.concatenate([base, *(e.vector for e in fitted.values())]), tuple(fitted))
    index = {name: k for k, name in enumerate(state.names)}
    covariance = np.zeros((len(index),) * 2)
    # effects from another record than the other parameters have standard errors only
    for effect, estimate in fitted.items():
        for name, size in estimate.std.items():
            covariance[(index[f"{effect.sensor}.{effect.name}.{name}"],) * 2] = size**2
    for sensor, made in sensors.items():
        if made.names:
            places = [index[f"{sensor}.{name}"] for name in made.names]
            factor = si_factor(made.names, made.raw_unit)
            covariance[np.ix_(places, places)] = made.covariance * np.outer(factor, factor)
    if effects is None:
        return state, covariance
    places = [index[name] for name in State(base, tuple(effects)).names]
    return State(state.x[places], tuple(effects)), covariance[np.ix_(places, places)]


def si_factor(names, unit):
    """Return the factors, (p,), that convert parameters of a calibration from raw units to SI.

    With the scale s of the RawUnit `unit` they are 1/s for K, s for b (without its offset), and 1
    for T and for parameters of effects. `names` are the names of the p parameters.
    """
    factors = {"K": 1 / unit.scale, "b": unit.scale}
    return np.array([1.0 if "." in name else factors.get(name[0], 1.0) for name in names])
