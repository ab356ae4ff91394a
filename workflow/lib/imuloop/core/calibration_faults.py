"""What is wrong with a calibration, whatever its file holds: one line, or nothing."""

import math
from pathlib import Path

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.errors import ImuloopError
from imuloop.core.units import raw_unit

SCHEMA = Path(__file__).parents[1] / "schemas" / "calibration.schema.yaml"
# that of a calibration with 200 parameters a sensor is smaller
MOST_BYTES = 4_000_000
# lists and objects in each other
_DEEPEST = 8
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
# what rounding may leave of symmetry, in units of the standard errors
_ROUNDING = 1e-6


def content_fault(content):
    """Return what of a calibration's JSON is not as its schema has it; None if all is.

    Parameters
    ----------
    content : dict
        Of the file.
    """
    # these take longer to import than a calibration to read
    import yaml
    from jsonschema import Draft202012Validator

    level = [content]
    for _ in range(_DEEPEST):
        level = [item for value in level for item in _items(value)]
    if level:
        return "nested too deep"
    schema = yaml.load(SCHEMA.read_text("utf-8"), getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    error = next(Draft202012Validator(schema).iter_errors(content), None)
    if error is None:
        return _infinite(content)
    key, text = ".".join(map(str, error.absolute_path)), error.message
    if len(text) > _SHOWN:
        text = f"{text[: _SHOWN // 2]} … {text[-_SHOWN // 2 :]}"
    return f"{key}: {text}" if key else text


def _items(value):
    return value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()


def _infinite(content, key=""):
    """Return which number of a content is not finite, None if all are."""
    if isinstance(content, (int, float)):
        try:
            return None if math.isfinite(content) else f"{key}: no finite number"
        except OverflowError:
            return f"{key}: a number of {len(str(content))} digits"
    named = content.items() if isinstance(content, dict) else enumerate(_items(content))
    faults = (_infinite(item, f"{key}.{name}".lstrip(".")) for name, item in named)
    return next((fault for fault in faults if fault), None)


def sensor_fault(calibration, sensor):
    """Return why a calibration can be none of a sensor, in a line; None if it can.

    Parameters
    ----------
    calibration : SensorCalibration
        Of the sensor.
    sensor : {'accelerometer', 'gyroscope'}
        Which of the two.
    """
    T, K, b = calibration.T, calibration.K, calibration.b
    for name, values, shape in (("T", T, (3, 3)), ("K", K, (3,)), ("b", b, (3,))):
        if values.shape != shape or not np.isfinite(values).all():
            return f"{name} is not {' × '.join(map(str, shape))} finite numbers"
    return (
        _unit_fault(calibration.raw_unit, _QUANTITIES[sensor])
        or _size_fault(K, b, calibration.raw_unit)
        or _axes_fault(T, sensor)
        or _effects_fault(calibration.effects, sensor)
        or _covariance_fault(calibration, sensor)
    )


def _unit_fault(unit, quantity):
    """Return why a raw unit is none of a quantity, None if it is."""
    try:
        known = raw_unit(quantity, unit.name, {"scale": unit.scale, "offset": unit.offset})
    except ImuloopError as error:
        return str(error)
    if known.name != unit.name:
        return f"raw_unit {unit.name} is that of increments"
    if not (unit.scale > 0 and math.isclose(known.scale, unit.scale, rel_tol=1e-9)):
        return f"raw_unit {unit.name} has the scale {known.scale}, not {unit.scale}"
    if known.offset != unit.offset:
        return f"raw_unit {unit.name} has the offset {known.offset}, not {unit.offset}"
    return None


def _size_fault(K, b, unit):
    """Return which scale factor or bias is of no sensor, None if all can be."""
    for i, value in enumerate((b - unit.offset).tolist()):
        if abs(value * unit.scale) > _LARGEST:
            return f"b{i} is {b[i]:.4g}: no sensor has such a bias"
    for i, (value, off) in enumerate(zip(K.tolist(), (K / unit.scale).tolist(), strict=True)):
        if not 1 / _FURTHEST <= off <= _FURTHEST:
            return (
                f"K{i} is {value:.4g}, {off:.4g} times what the unit promises, not "
                f"{1 / _FURTHEST:g} to {_FURTHEST:g} times"
            )
    return None


def _axes_fault(T, sensor):
    """Return why a misalignment can be none, None if it can."""
    for i in range(3):
        if abs(T[i, i] - 1) > _ROUNDING:
            return f"T{i}{i} is {T[i, i]:.6g}, not 1"
    if sensor == "accelerometer" and np.tril(T, -1).any():
        return "T is not upper triangular: the accelerometer's axes define the body's"
    if np.abs(T).max() > _FURTHEST or not np.linalg.cond(T) <= _FURTHEST:
        return "T is singular or nearly so: two of its axes are one"
    return None


def _effects_fault(effects, sensor):
    """Return which effect a sensor cannot have, None if it can have all."""
    names = [effect.name for effect in effects]
    for effect in effects:
        if sensor not in effect.effect.sensors:
            return f"{effect.name} is no effect of the {sensor}"
        if type(effect.effect).design is Effect.design:
            return f"{effect.name} is no effect that can be taken out of samples"
        if names.count(effect.name) > 1:
            return f"the effect {effect.name} is there twice"
        for key, value in (*effect.values.items(), *effect.std.items()):
            if not abs(value) <= _LARGEST:
                return f"the effect {effect.name} has {key} {value:.4g}, or its std: no sensor has"
    return None


def _covariance_fault(calibration, sensor):
    """Return why a covariance can be none of the parameters, None if it can."""
    names, matrix = calibration.names, calibration.covariance
    matrix = np.zeros((0, 0)) if matrix is None else matrix
    known = {f"{effect.name}.{key}" for effect in calibration.effects for key in effect.values}
    known |= _SCALES | (_UPPER if sensor == "accelerometer" else _ANGLES)
    if unknown := set(names) - known:
        return f"covariance: '{min(unknown)}' is no parameter"
    if len(set(names)) < len(names):
        return "covariance: a name is there twice"
    if matrix.shape != (len(names), len(names)):
        return f"covariance: {len(names)} names, but a matrix of the shape {matrix.shape}"
    variance = np.diag(matrix)
    if not (np.isfinite(matrix).all() and (variance >= 0).all()):
        return "covariance: a variance is below zero, or no finite number"
    if not names:
        return None
    # in units of the standard errors; what was held has none
    held = variance == 0
    std = np.sqrt(np.where(held, 1.0, variance))
    scale = calibration.raw_unit.scale
    units = {"K": 1 / scale, "b": scale}
    for name, size in zip(names, std.tolist(), strict=True):
        if size * units.get(name[0] if name in _SCALES else "", 1.0) > _LARGEST:
            return f"covariance: the standard error {size:.4g} of {name} is of no sensor"
    with np.errstate(over="ignore"):
        share = matrix / std / std[:, None]
    if not np.abs(share - share.T).max() <= _ROUNDING:
        return "covariance: the matrix is not symmetric"
    if share[held].any() or np.abs(share).max() > 1 + _ROUNDING:
        return "covariance: the matrix has correlations above 1"
    if np.linalg.eigvalsh(share)[0] < -_ROUNDING:
        return "covariance: the matrix is not positive semi-definite"
    return None
