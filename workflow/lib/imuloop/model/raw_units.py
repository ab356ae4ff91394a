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
    names, T, fitted = NAMES[sensor], np.eye(3), []
    elements, K, b, _ = np.split(x, np.cumsum([len(names) - 6, 3, 3]))
    T[ENTRIES[sensor]] = elements
    std = np.sqrt(np.diag(covariance))
    for effect in effects:
        own = slice(len(names), len(names) + len(effect.parameters))
        pairs = (zip(effect.parameters, v[own].tolist(), strict=True) for v in (x, std))
        fitted.append(FittedEffect(effect, *map(dict, pairs)))
        names += tuple(f"{effect.name}.{p}" for p in effect.parameters)
    factor = si_factor(names, unit)
    prior = prior and prior_content(sensor, prior, unit)
    how |= {"covariance": covariance / np.outer(factor, factor), "prior": prior}
    K, b = K * unit.scale, unit.from_si(b)
    return SensorCalibration(unit, T, K, b, names=names, effects=tuple(fitted), **how)


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
    no variance. `effects` is a sequence of SensorEffect, some effects of the calibration; by
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
    effects = tuple(fitted if effects is None else effects)
    parts = [as_logged(sensor, made) for sensor, made in sensors.items()]
    state = State(np.concatenate([*parts, *(fitted[e].vector for e in effects)]), effects)
    # effects from another record than the other parameters have standard errors only
    std = {f"{e.sensor}.{e.name}.{name}": s for e in effects for name, s in fitted[e].std.items()}
    covariance = np.diag([std.get(name, 0.0) ** 2 for name in state.names])
    for sensor, made in sensors.items():
        names = [f"{sensor}.{name}" for name in made.names]
        places = [k for k, name in enumerate(state.names) if name in names]
        if places:
            rows = [names.index(state.names[k]) for k in places]
            factor = si_factor(made.names, made.raw_unit)
            block = made.covariance * np.outer(factor, factor)
            covariance[np.ix_(places, places)] = block[np.ix_(rows, rows)]
    return state, covariance


def si_factor(names, unit):
    """Return the factors, (p,), that convert parameters of a calibration from raw units to SI.

    With the scale s of the RawUnit `unit` they are 1/s for K, s for b (without its offset), and 1
    for T and for parameters of effects. `names` are the names of the p parameters.
    """
    factors = {"K": 1 / unit.scale, "b": unit.scale}
    return np.array([1.0 if "." in name else factors.get(name[0], 1.0) for name in names])
