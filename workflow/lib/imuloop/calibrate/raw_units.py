"""Parameters in SI as logged and in the raw units of a log: both ways."""

import numpy as np

from imuloop.core.effect import FittedEffect
from imuloop.core.sensor_calibration import SensorCalibration


def in_raw_units(
    unit, base, x, covariance, *, method, effects=(), known=(), reduced_chi2=None, prior=None
):
    """Return the SensorCalibration that parameters in SI as logged stand for, in raw units.

    ``K_raw = K s`` and ``b_raw = b / s + offset`` for ``SI = s (raw - offset)``. x, shape (p,), and
    its covariance hold the parameters named in `base`, three scale factors and three biases last,
    then those of the effects, whose names begin with the effect's: ``g_sensitivity.G00``. Effects
    that are known from elsewhere, FittedEffect each, go before them.
    """
    count, T = len(base), np.eye(3)
    for name, value in zip(base[:-6], x[: count - 6], strict=True):
        T[int(name[1]), int(name[2])] = value
    names = (*base, *(f"{effect.name}.{p}" for effect in effects for p in effect.parameters))
    factor = si_factor(names, unit)
    # in the order of the effects' parameters
    values, fitted = zip(x[count:], np.sqrt(np.diag(covariance))[count:], strict=True), []
    for effect in effects:
        own = {p: tuple(map(float, next(values))) for p in effect.parameters}
        both = ({p: pair[k] for p, pair in own.items()} for k in (0, 1))
        fitted.append(FittedEffect(effect, *both))
    return SensorCalibration(
        raw_unit=unit,
        T=T,
        K=x[count - 6 : count - 3] * unit.scale,
        b=unit.from_si(x[count - 3 : count]),
        names=names,
        covariance=covariance / np.outer(factor, factor),
        effects=(*known, *fitted),
        method=method,
        reduced_chi2=reduced_chi2,
        prior=None if prior is None else prior_content(prior, base, unit),
    )


def prior_content(prior, base, unit):
    """Return source, mean and standard deviations of a SensorPrior by name, in raw units."""
    factor = si_factor(base, unit)
    offset = np.array([unit.offset if name[0] == "b" else 0.0 for name in base])
    each = {"mean": prior.mean / factor + offset, "std": prior.std / factor}
    return {"source": prior.source} | {
        key: dict(zip(base, values.tolist(), strict=True)) for key, values in each.items()
    }


def as_logged(calibration, base):
    """Return the base parameters of a SensorCalibration, (p,), SI: inverse of `in_raw_units`.

    `base` are their names, those of T first, then three scale factors and three biases.
    """
    unit = calibration.raw_unit
    T = [calibration.T[int(name[1]), int(name[2])] for name in base[:-6]]
    return np.concatenate([T, calibration.K / unit.scale, unit.to_si(calibration.b)])


def si_factor(names, unit):
    """Return how many SI units, as logged, one of each parameter of a SensorCalibration is, (p,).

    Takes the names of its parameters and the RawUnit.
    """
    of = {"K": 1 / unit.scale, "b": unit.scale}
    return np.array([1.0 if "." in name else of.get(name[0], 1.0) for name in names])
