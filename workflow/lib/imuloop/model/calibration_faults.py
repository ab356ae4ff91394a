"""Faults of a calibration, each described by one line of text."""

import json
import math
from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_yaml
from imuloop.core.units import raw_unit
from imuloop.model.effect import Effect
from imuloop.model.state import NAMES

SCHEMA = Path(__file__).parents[1] / "schemas" / "calibration.schema.yaml"
# largest file of a calibration: one with 200 parameters per sensor is smaller
MOST_BYTES = 4_000_000
# longest text of the validator that is shown, as it may hold a whole list
_SHOWN = 160

_QUANTITIES = {"accelerometer": "acceleration", "gyroscope": "angular_rate"}
# largest ratio of a scale factor to the nominal one, or its inverse, and largest condition of T
_FURTHEST = 100.0
# largest parameter or standard error, SI; its square does not overflow
_LARGEST = 1e9
# largest variance, in the unit of the parameter; its square does not overflow
_LARGEST_VARIANCE = 1e60
# largest relative error of a scale factor, and largest bias, SI, of a correct log. Data sheets
# allow 10 %, 0.3 g and 75 °/s at most; above, the scale is wrong or rows were not read
_SCALE_ERROR = 0.2
_BIAS = {"accelerometer": (5.0, "m/s²"), "gyroscope": (1.5, "rad/s")}
# largest asymmetry of a covariance by rounding, in units of the standard errors
_ROUNDING = 1e-6


@cache
def _validator():
    """Return the validator of the JSON schema of a calibration."""
    # loaded late and parsed once, as it takes longer than the rest of reading a calibration
    from jsonschema import Draft202012Validator

    return Draft202012Validator(read_yaml(SCHEMA))


def content_fault(content):
    """Return the first fault of the JSON content of a calibration, a line of text, or None.

    `content` is the dict that was read from the file. A fault is a violation of the schema, or a
    number that is not finite; the result is None if there is no fault.
    """
    if error := next(_validator().iter_errors(content), None):
        key, text = ".".join(map(str, error.absolute_path)), error.message
        if len(text) > _SHOWN:
            text = f"{text[: _SHOWN // 2]} … {text[-_SHOWN // 2 :]}"
        return f"{key}: {text}" if key else text
    try:
        # a number that is too large for a double becomes infinite
        json.dumps(json.loads(json.dumps(content), parse_int=float), allow_nan=False)
    except ValueError:
        return "a number is not finite"
    return None


def sensor_fault(calibration, sensor):
    """Return the first reason why the calibration of a sensor is impossible; None if there is none.

    Parameters
    ----------
    calibration : SensorCalibration
        The calibration to check.
    sensor : str
        Name of the sensor.

    Returns
    -------
    str or None
        The reason, one line of text.
    """
    checks = _base_faults, _effect_faults, _covariance_faults
    return next((fault for check in checks for fault in check(calibration, sensor)), None)


def implausible_values(calibration, sensor):
    """Return a text that names the scale factors and biases larger than in any data sheet, or None.

    A calibration with such values is not refused, but the log that it comes from must be faulty,
    for instance in another unit than declared. The result is None if there are no such values.
    `calibration` is the SensorCalibration, and `sensor` is the name of the sensor.
    """
    unit, values = calibration.raw_unit, []
    largest, si = _BIAS[sensor]
    for axis, K, bias in zip("xyz", calibration.K, unit.to_si(calibration.b), strict=True):
        if abs(K / unit.scale - 1) > _SCALE_ERROR:
            values.append(f"K of {axis} is {K / unit.scale:.3g} times nominal")
        if abs(bias) > largest:
            values.append(f"the bias of {axis} is {bias:.3g} {si}")
    quantity = _QUANTITIES[sensor]
    where = f"nominal.{quantity}" if unit.name == "count" else f"units.{quantity}"
    return f"{', '.join(values)}, of no sensor: see {where} and the log" if values else None


def _base_faults(calibration, sensor):
    """Yield the faults of a sensor's raw unit, misalignment, scale factors and biases, texts.

    A fault is a value that no sensor can have, or that contradicts the declared unit. `calibration`
    is the SensorCalibration, and `sensor` is the name of the sensor.
    """
    T, K, b, unit = calibration.T, calibration.K, calibration.b, calibration.raw_unit
    try:
        expected = raw_unit(_QUANTITIES[sensor], unit.name, asdict(unit))
    except ImuloopError as error:
        # only the first fault is asked for, so nothing follows this one
        yield str(error)
    # the scale may differ by rounding; for counts, which may have any, it is that of the
    # calibration
    is_close = unit.scale > 0 and math.isclose(expected.scale, unit.scale, rel_tol=1e-9)
    same = (expected.name, expected.offset) == (unit.name, unit.offset)
    if not (is_close and same):
        yield f"raw_unit {unit.name} has not the scale {unit.scale} and the offset {unit.offset}"
    # these comparisons are false for not-a-number, which is refused
    if not np.all(np.abs(b - unit.offset) * unit.scale <= _LARGEST):
        yield f"b is {b.tolist()}: no sensor has such a bias"
    ratio = K / unit.scale
    for i in np.flatnonzero(~((1 / _FURTHEST <= ratio) & (ratio <= _FURTHEST))):
        limits = f"{1 / _FURTHEST:g} to {_FURTHEST:g} times"
        yield f"K{i} is {ratio[i]:.4g} times the scale of the unit, not {limits}"
    if not np.all(np.abs(np.diag(T) - 1) <= _ROUNDING):
        yield "the diagonal of T is not 1"
    if sensor == "accelerometer" and np.tril(T, -1).any():
        yield "T is not upper triangular: the accelerometer's axes define the body's"
    if not (np.isfinite(T).all() and np.linalg.cond(T) <= _FURTHEST):
        yield "T is singular or nearly so: two of its axes are one"


def _effect_faults(calibration, sensor):
    """Yield the faults of a sensor's effects, texts, such as an effect that occurs twice.

    `calibration` is the SensorCalibration, and `sensor` is the name of the sensor.
    """
    names = [effect.name for effect in calibration.effects]
    for effect in calibration.effects:
        if sensor not in effect.effect.sensors:
            yield f"{effect.name} is not an effect of the {sensor}"
        if type(effect.effect).design is Effect.design:
            yield f"{effect.name} is not an effect that can be removed from samples"
        if names.count(effect.name) > 1:
            yield f"the effect {effect.name} is there twice"
        for key, value in (*effect.values.items(), *effect.std.items()):
            if not abs(value) <= _LARGEST:
                yield f"the effect {effect.name} has {key} {value:.4g}, or its std: no sensor has"


def _covariance_faults(calibration, sensor):
    """Yield the faults of the covariance of a sensor's parameters, texts, such as a wrong shape.

    `calibration` is the SensorCalibration, and `sensor` is the name of the sensor.
    """
    names, matrix = calibration.names, calibration.covariance
    if matrix is None:
        matrix = np.zeros((0, 0))
    possible = {f"{effect.name}.{key}" for effect in calibration.effects for key in effect.values}
    if unknown := set(names) - possible - set(NAMES[sensor]):
        yield f"covariance: '{min(unknown)}' is not a parameter"
    if matrix.shape != (len(names), len(names)):
        yield f"covariance: {len(names)} names, but a matrix of the shape {matrix.shape}"
    variance = np.diag(matrix)
    if not np.all((variance >= 0) & (variance <= _LARGEST_VARIANCE)):
        yield "covariance: a variance is below zero, or of no sensor"
    # the matrix in units of the standard errors; a fixed parameter has none
    std = np.sqrt(np.where(variance == 0, 1.0, variance))
    with np.errstate(over="ignore"):
        share = matrix / std / std[:, None]
    symmetric = np.all(np.abs(share - share.T) <= _ROUNDING) and not share[variance == 0].any()
    if not symmetric or np.any(np.linalg.eigvalsh(share) < -_ROUNDING):
        yield "covariance: the matrix is not symmetric and positive semi-definite"
