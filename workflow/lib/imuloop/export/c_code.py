"""C expressions of the effects of a sensor, which the function in the exported header subtracts."""

from imuloop.effects.axes import AXES
from imuloop.effects.products import OUTPUTS, Product
from imuloop.export.text import number
from imuloop.export.values import BIAS

# for effects with a matrix, the C expression by which element (i, j) is multiplied
MATRICES = {
    "g_sensitivity": "f[{1}]",
    "rate_sensitivity": "w[{1}]",
    "lever_arm": "imu_calibration_arm(w, dw, {0}, {1})",
}
CARRIED = (BIAS, "scale_temperature", Product.name, *MATRICES)


def needs_rate(sensor):
    """Return whether the C function of a sensor needs the angular rate and its derivative.

    The result is always false for a gyroscope; for an accelerometer it is true if one of its
    effects depends on the angular rate. `sensor` is the dict of a sensor's values that
    `values.sensor_values` returns.
    """
    of_rate = {"lever_arm", "rate_sensitivity"}
    return sensor["name"] == "accelerometer" and any(
        fitted.name in of_rate or (fitted.name == Product.name and "w" in fitted.effect.formula)
        for fitted in sensor["effects"]
    )


def subtracted(sensor):
    """Return the effects that C can compute from one sample, with their C expressions, a list.

    Each entry is a tuple of a FittedEffect and a list of terms. A term is a tuple of the index of
    an axis and the C expression to subtract from the output of this axis. Effects that are not in
    `CARRIED` are left out. `sensor` is the dict of a sensor's values that `values.sensor_values`
    returns.
    """
    return [(fitted, _effect(fitted)) for fitted in sensor["effects"] if fitted.name in CARRIED]


def _effect(fitted):
    """Return the terms of a FittedEffect, a list of (axis, C expression), one per parameter.

    `fitted` is the FittedEffect. The axis is an index, and the expression is to be subtracted from
    the output of this axis.
    """
    terms = []
    if fitted.name == Product.name:
        return [_product(fitted)]
    for k, name in enumerate(fitted.effect.parameters):
        row, column = divmod(k, 3)
        axis = row if fitted.name in MATRICES else column
        if fitted.name in MATRICES:
            factors = [_clamped(fitted, name, MATRICES[fitted.name].format(row, column))]
        elif fitted.name == BIAS:
            # parameters of order k have k equal factors: the temperature is clamped before it is
            # raised to the power k
            factors = [_clamped(fitted, f"c1{AXES[axis]}", _warmer(fitted))] * (row + 1)
        else:
            factors = [_clamped(fitted, name, f"{_warmer(fitted)} * o[{axis}]")]
        terms.append((axis, " * ".join([number(fitted.values[name]), *factors])))
    return terms


def _product(fitted):
    """Return the index of the axis of a Product and its C expression.

    `fitted` is the FittedEffect of a Product: a coefficient times powers of outputs and of the
    temperature.
    """
    (name,), texts = fitted.effect.parameters, []
    for factor in fitted.effect.factors:
        letter = "o" if factor[0] == OUTPUTS[fitted.effect.sensor] else factor[0]
        of_output = factor != "θ" and f"{letter}[{AXES.index(factor[2])}]"
        texts.append(of_output or _warmer(fitted))
    product = _clamped(fitted, name, " * ".join(texts))
    return AXES.index(fitted.effect.axis), f"{number(fitted.values[name])} * {product}"


def _clamped(fitted, name, expression):
    """Return a C expression that limits `expression` to its range in the data of the fit.

    `expression` is the C expression by which the parameter `name` of `fitted`, a FittedEffect, is
    multiplied. If the range is not known, `expression` is returned unchanged.
    """
    if name not in fitted.ranges:
        return expression
    low, high = map(number, fitted.ranges[name])
    return f"imu_calibration_held({expression}, {low}, {high})"


def _warmer(fitted):
    """Return a C expression of the temperature less the reference temperature of an effect, K.

    `fitted` is the FittedEffect, which has the reference temperature.
    """
    return f"(temperature - {number(fitted.effect.reference_temperature)})"
