"""Faults of a calibration, each one line of text."""

import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from imuloop.core.effect import Effect
from imuloop.core.errors import ImuloopError
from imuloop.core.units import raw_unit

SCHEMA = Path(__file__).parents[1] / "schemas" / "calibration.schema.yaml"
# that of a calibration with 200 parameters per sensor is smaller
MOST_BYTES = 4_000_000
# longest text of the validator that is shown, which may hold a whole list
_SHOWN = 160

_QUANTITIES = {"accelerometer": "acceleration", "gyroscope": "angular_rate"}
# names of the base parameters that a fit can estimate, and of those of the accelerometer alone
_SCALES = {f"{letter}{i}" for letter in "Kb" for i in range(3)}
_ANGLES = {f"T{i}{j}" for i in range(3) for j in range(3) if i != j}
_UPPER = {name for name in _ANGLES if name[1] < name[2]}
# a scale factor further from its unit's by such a factor, or axes so nearly parallel, has no sensor
_FURTHEST = 100.0
# a parameter or a standard error of so much, SI, is of no sensor, and its square still a number
_LARGEST = 1e9
# a variance of so much, in the parameter's unit, is of no sensor, and its square still a number
_LARGEST_VARIANCE = 1e60
# data sheets allow a scale factor off by 10 %, a bias of 0.3 g and of 75 °/s at most; beyond
# these limits, SI, the log is at fault: a wrong scale, or rows that were not read
_SCALE_ERROR, _BIAS = 0.2, {"accelerometer": 5.0, "gyroscope": 1.5}
# what rounding may leave of symmetry, in units of the standard errors
_ROUNDING = 1e-6


@cache
def _validator():
    # loaded late and parsed once: it takes longer than all else of reading a calibration
    from jsonschema import Draft202012Validator

    return Draft202012Validator(yaml.safe_load(SCHEMA.read_text(encoding="utf-8")))


def content_fault(content):
    """Return how a calibration's JSON, a dict, violates its schema; None if it does not."""
    if error := next(_validator().iter_errors(content), None):
        key, text = ".".join(map(str, error.absolute_path)), error.message
        if len(text) > _SHOWN:
            text = f"{text[: _SHOWN // 2]} … {text[-_SHOWN // 2 :]}"
        return f"{key}: {text}" if key else text
    try:
        # a number of more digits than a double holds becomes infinite
        json.dumps(json.loads(json.dumps(content), parse_int=float), allow_nan=False)
    except ValueError:
        return "a number is not finite"
    return None


def sensor_fault(calibration, sensor):
    """Return why no sensor can have a SensorCalibration, in one line; None if one can."""
    faults = _base_faults, _effect_faults, _covariance_faults
    return next((fault for each in faults for fault in each(calibration, sensor)), None)


def implausible(calibration, sensor):
    """Return why a SensorCalibration, though valid, must come from a faulty log; else None.

    Its K or b is further from the nominal one than any data sheet allows.
    """
    unit, found = calibration.raw_unit, []
    for i, axis in enumerate("xyz"):
        scale, bias = calibration.K[i] / unit.scale, (calibration.b[i] - unit.offset) * unit.scale
        if abs(scale - 1) > _SCALE_ERROR:
            found.append(f"K of {axis} is {scale:.3g} times nominal")
        if abs(bias) > _BIAS[sensor]:
            si = {"accelerometer": "m/s²", "gyroscope": "rad/s"}[sensor]
            found.append(f"the bias of {axis} is {bias:.3g} {si}")
    quantity = _QUANTITIES[sensor]
    where = f"nominal.{quantity}" if unit.name == "count" else f"units.{quantity}"
    return f"{', '.join(found)}, of no sensor: see {where} and the log" if found else None


def _base_faults(calibration, sensor):
    T, K, b, unit = calibration.T, calibration.K, calibration.b, calibration.raw_unit
    try:
        known = raw_unit(
            _QUANTITIES[sensor], unit.name, {"scale": unit.scale, "offset": unit.offset}
        )
    except ImuloopError as error:
        yield str(error)
    same = (known.name, known.offset) == (unit.name, unit.offset)
    if not (same and math.isclose(known.scale, unit.scale, rel_tol=1e-9) and unit.scale > 0):
        yield f"raw_unit {unit.name} has not the scale {unit.scale} and the offset {unit.offset}"
    # written so that what is not a number is refused
    if not np.all(np.abs(b - unit.offset) * unit.scale <= _LARGEST):
        yield f"b is {b.tolist()}: no sensor has such a bias"
    ratio = K / unit.scale
    for i in np.flatnonzero(~((1 / _FURTHEST <= ratio) & (ratio <= _FURTHEST))):
        yield (
            f"K{i} is {ratio[i]:.4g} times what the unit promises, not {1 / _FURTHEST:g} to "
            f"{_FURTHEST:g} times"
        )
    if not np.all(np.abs(np.diag(T) - 1) <= _ROUNDING):
        yield "the diagonal of T is not 1"
    if sensor == "accelerometer" and np.tril(T, -1).any():
        yield "T is not upper triangular: the accelerometer's axes define the body's"
    if not (np.isfinite(T).all() and np.linalg.cond(T) <= _FURTHEST):
        yield "T is singular or nearly so: two of its axes are one"


def _effect_faults(calibration, sensor):
    names = [effect.name for effect in calibration.effects]
    for effect in calibration.effects:
        if sensor not in effect.effect.sensors:
            yield f"{effect.name} is no effect of the {sensor}"
        if type(effect.effect).design is Effect.design:
            yield f"{effect.name} is no effect that can be taken out of samples"
        if names.count(effect.name) > 1:
            yield f"the effect {effect.name} is there twice"
        for key, value in (*effect.values.items(), *effect.std.items()):
            if not abs(value) <= _LARGEST:
                yield f"the effect {effect.name} has {key} {value:.4g}, or its std: no sensor has"


def _covariance_faults(calibration, sensor):
    names = calibration.names
    matrix = np.zeros((0, 0)) if calibration.covariance is None else calibration.covariance
    known = {f"{effect.name}.{key}" for effect in calibration.effects for key in effect.values}
    known |= _SCALES | (_UPPER if sensor == "accelerometer" else _ANGLES)
    if unknown := set(names) - known:
        yield f"covariance: '{min(unknown)}' is no parameter"
    if matrix.shape != (len(names), len(names)):
        yield f"covariance: {len(names)} names, but a matrix of the shape {matrix.shape}"
    variance = np.diag(matrix)
    if not np.all((variance >= 0) & (variance <= _LARGEST_VARIANCE)):
        yield "covariance: a variance is below zero, or of no sensor"
    # in units of the standard errors; what was fixed has none
    std = np.sqrt(np.where(variance == 0, 1.0, variance))
    with np.errstate(over="ignore"):
        share = matrix / std / std[:, None]
    symmetric = np.all(np.abs(share - share.T) <= _ROUNDING) and not share[variance == 0].any()
    if not symmetric or np.any(np.linalg.eigvalsh(share) < -_ROUNDING):
        yield "covariance: the matrix is not symmetric and positive semi-definite"
