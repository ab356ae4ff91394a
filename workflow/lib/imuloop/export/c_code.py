"""The terms of effects in C: arrays of their numbers and the expression that uses them."""

import numpy as np

from imuloop.effects.axes import AXES
from imuloop.effects.discovered import Discovered
from imuloop.export.text import number

# of what is held to no range
LARGEST = np.finfo(float).max
HELD = "imu_calibration_held"
# of effects that are a matrix its name and what element j of a row multiplies
MATRICES = {
    "g_sensitivity": ("G", "f[{}]"),
    "rate_sensitivity": ("M", "w[{}]"),
    "lever_arm": ("r", "imu_calibration_arm(w, dw, i, {})"),
}
TERMS = ("bias_temperature", "scale_temperature", *MATRICES)


def carried(sensor):
    """Return what of a sensor's calibration its function applies."""
    return ["misalignment", *TERMS, *([Discovered.name] if formulas(sensor) else [])]


def needs_rate(sensor):
    """Return whether the function of a sensor takes the angular rate and its change."""
    return any(fitted.name in ("lever_arm", "rate_sensitivity") for fitted in sensor["effects"])


def terms(sensor, name):
    """Return (fitted effect, arrays by name, expression of axis i) of what the loop subtracts."""
    found = [fitted for fitted in sensor["effects"] if fitted.name in TERMS]
    return [(fitted, *_term(fitted, f"{name}_e{k}")) for k, fitted in enumerate(found)]


def formulas(sensor):
    """Return (fitted effect, its axes and expressions) of each formula that C can compute.

    It needs what the function of its sensor is given, and no past.
    """
    found = [fitted for fitted in sensor["effects"] if fitted.name == Discovered.name]
    given = {"accelerometer": set("fT"), "gyroscope": set("fwT")}[sensor["name"]]
    return [
        (fitted, _formula(fitted))
        for fitted in found
        if not fitted.effect.timed and fitted.effect.letters <= given
    ]


def _term(fitted, name):
    """Return arrays by their names, which begin with `name`, and the expression of axis i."""
    if fitted.name in MATRICES:
        return _matrix(fitted, name, *MATRICES[fitted.name])
    if fitted.name == "scale_temperature":
        arrays, product = _held(fitted, f"{name}_sT", "sT", f"{_warmer(fitted)} * output")
        return arrays, f"{name}_sT[i] * {product}"
    arrays, warmth = _held(fitted, f"{name}_c1", "c1", _warmer(fitted))
    orders = range(1, fitted.effect.order + 1)
    arrays |= {f"{name}_c{k}": _of_axes(fitted, f"c{k}") for k in orders[1:]}
    terms = (f"{name}_c{k}[i] * {' * '.join([warmth] * k)}" for k in orders)
    return arrays, f"({' + '.join(terms)})"


def _formula(fitted):
    """Return the axis and the expression of each term of a formula of outputs and temperature."""

    def factor(name, power, absolute):
        own = (name[0] == "f") == (fitted.effect.sensor == "accelerometer")
        text = f"{'o' if own else 'f'}[{AXES.index(name[1])}]" if name != "T" else _warmer(fitted)
        text = f"({text} < 0 ? -{text} : {text})" if absolute else text
        return " * ".join([text] * power)

    found = []
    for (axis, factors), name in zip(fitted.effect.terms, fitted.effect.parameters, strict=True):
        product = " * ".join(factor(*own) for own in factors)
        low, high = map(number, _ends(fitted, name))
        found.append((axis, f"{number(fitted.values[name])} * {HELD}({product}, {low}, {high})"))
    return found


def _matrix(fitted, name, kind, derivative):
    """Return matrices, rows that an effect lacks zero, and the sum of their products, j = 0 … 2."""
    lacking = 9 - len(fitted.effect.parameters)
    keys = [*fitted.effect.parameters, *[""] * lacking]
    low, high = np.transpose([_ends(fitted, key) for key in keys]).reshape(2, 3, 3)
    values = np.append(fitted.vector, np.zeros(lacking)).reshape(3, 3)
    arrays = {f"{name}_{kind}": values, f"{name}_low": low, f"{name}_high": high}
    terms = (
        f"{name}_{kind}[i][{j}] * "
        f"{HELD}({derivative.format(j)}, {name}_low[i][{j}], {name}_high[i][{j}])"
        for j in range(3)
    )
    return arrays, f"({' + '.join(terms)})"


def _held(fitted, name, kind, derivative):
    """Return arrays of the parameters of a kind and the ends of the derivative, and it held."""
    low, high = np.transpose([_ends(fitted, f"{kind}{axis}") for axis in AXES])
    arrays = {name: _of_axes(fitted, kind), f"{name}_low": low, f"{name}_high": high}
    return arrays, f"{HELD}({derivative}, {name}_low[i], {name}_high[i])"


def _of_axes(fitted, kind):
    return np.array([fitted.values[f"{kind}{axis}"] for axis in AXES])


def _ends(fitted, name):
    """Return to what the derivative by a parameter is held."""
    return fitted.ranges.get(name, (-LARGEST, LARGEST))


def _warmer(fitted):
    return f"(temperature - {number(fitted.effect.reference_temperature)})"
