"""Parameters in SI as logged and a calibration in the raw units of a log: both ways."""

import numpy as np

from imuloop.core.effect import FittedEffect
from imuloop.core.sensor_calibration import SensorCalibration
from imuloop.model.effects import SensorEffect
from imuloop.model.state import BASE, ENTRIES, NAMES, State


def in_raw_units(sensor, unit, x, covariance, effects=(), prior=None, **how):
    """Return the SensorCalibration that parameters in SI as logged stand for, in raw units.

    ``K_raw = K s`` and ``b_raw = b / s + offset`` for ``SI = s (raw - offset)``.

    Parameters
    ----------
    sensor, unit : str, RawUnit
        Name of the sensor, and the unit of its log.
    x, covariance : ndarray, shape (p,), (p, p)
        T, K and b, then the parameters of the effects.
    effects : sequence of Effect, optional
        Those of the sensor.
    prior : Prior, optional
        What was known before the data.
    **how
        Other fields of the calibration.
    """
    names, T = NAMES[sensor], np.eye(3)
    elements, K, b, own = np.split(x, np.cumsum([len(names) - 6, 3, 3]))
    T[ENTRIES[sensor]] = elements
    std = iter(np.sqrt(np.diag(covariance))[len(names) :].tolist())
    names += tuple(f"{effect.name}.{p}" for effect in effects for p in effect.parameters)
    factor, values, fitted = si_factor(names, unit), iter(own.tolist()), []
    for effect in effects:
        each = ({p: next(numbers) for p in effect.parameters} for numbers in (values, std))
        fitted.append(FittedEffect(effect, *each))
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
    """Return source, mean and standard deviations by name of a sensor's Prior, in raw units."""
    names, at = NAMES[sensor], BASE[sensor]
    factor = si_factor(names, unit)
    offset = np.array([unit.offset if name[0] == "b" else 0.0 for name in names])
    each = {"mean": prior.mean[at] / factor + offset, "std": prior.std[at] / factor}
    return {"source": prior.sources[sensor]} | {
        key: dict(zip(names, values.tolist(), strict=True)) for key, values in each.items()
    }


def as_logged(sensor, calibration):
    """Return T, K and b of a SensorCalibration, (p,), SI as logged: inverse of `in_raw_units`."""
    unit = calibration.raw_unit
    T = calibration.T[ENTRIES[sensor]]
    return np.concatenate([T, calibration.K / unit.scale, unit.to_si(calibration.b)])


def state_of(calibration, effects=None):
    """Return the State of a Calibration, SI as logged, and its covariance.

    No parameter of one sensor has a covariance with one of the other; zero is what was not
    estimated. With all its effects, or with some SensorEffect of them.
    """
    sensors = {name: getattr(calibration, name) for name in NAMES}
    fitted = {SensorEffect(e.effect, s): e for s, own in sensors.items() for e in own.effects}
    base = np.concatenate([as_logged(sensor, own) for sensor, own in sensors.items()])
    every = State(np.concatenate([base, *(e.vector for e in fitted.values())]), tuple(fitted))
    place = {name: k for k, name in enumerate(every.names)}
    covariance = np.zeros((len(place),) * 2)
    # effects that come from another record than the parameters have standard errors alone
    for effect, own in fitted.items():
        for name, size in own.std.items():
            covariance[(place[f"{effect.sensor}.{effect.name}.{name}"],) * 2] = size**2
    for sensor, own in sensors.items():
        if own.names:
            at = [place[f"{sensor}.{name}"] for name in own.names]
            factor = si_factor(own.names, own.raw_unit)
            covariance[np.ix_(at, at)] = own.covariance * np.outer(factor, factor)
    if effects is None:
        return every, covariance
    at = [place[name] for name in State(base, tuple(effects)).names]
    return State(every.x[at], tuple(effects)), covariance[np.ix_(at, at)]


def si_factor(names, unit):
    """Return how many SI units, as logged, one of each parameter of a SensorCalibration is, (p,).

    Takes the names of its parameters and the RawUnit.
    """
    of = {"K": 1 / unit.scale, "b": unit.scale}
    return np.array([1.0 if "." in name else of.get(name[0], 1.0) for name in names])
