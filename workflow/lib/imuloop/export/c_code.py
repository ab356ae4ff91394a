"""The effects of a sensor as C expressions, which the function of a header subtracts."""

from imuloop.effects.axes import AXES
from imuloop.effects.products import OUTPUTS, Product
from imuloop.export.text import number
from imuloop.export.values import BIAS

# what element (i, j) of an effect's matrix multiplies
MATRICES = {
    "g_sensitivity": "f[{1}]",
    "rate_sensitivity": "w[{1}]",
    "lever_arm": "imu_calibration_arm(w, dw, {0}, {1})",
}
CARRIED = (BIAS, "scale_temperature", Product.name, *MATRICES)


def needs_rate(sensor):
    """Return whether the function of a sensor takes the angular rate and its change."""
    of_rate = {"lever_arm", "rate_sensitivity"}
    return sensor["name"] == "accelerometer" and any(
        fitted.name in of_rate or (fitted.name == Product.name and "w" in fitted.effect.formula)
        for fitted in sensor["effects"]
    )


def subtracted(sensor):
    """Return (fitted effect, [(axis, expression)]) of what C can compute without a past."""
    return [(fitted, _effect(fitted)) for fitted in sensor["effects"] if fitted.name in CARRIED]


def _effect(fitted):
    """Return axis and expression of each parameter times its factor."""
    found = []
    if fitted.name == Product.name:
        return [_product(fitted)]
    for k, name in enumerate(fitted.effect.parameters):
        row, column = divmod(k, 3)
        axis = row if fitted.name in MATRICES else column
        if fitted.name in MATRICES:
            factors = [_held(fitted, name, MATRICES[fitted.name].format(row, column))]
        elif fitted.name == BIAS:
            # the temperature is held, then raised to its power
            factors = [_held(fitted, f"c1{AXES[axis]}", _warmer(fitted))] * (row + 1)
        else:
            factors = [_held(fitted, name, f"{_warmer(fitted)} * o[{axis}]")]
        found.append((axis, " * ".join([number(fitted.values[name]), *factors])))
    return found


def _product(fitted):
    """Return axis and expression of a product of outputs and temperature."""
    (name,), texts = fitted.effect.parameters, []
    for factor in fitted.effect.factors:
        letter = "o" if factor[0] == OUTPUTS[fitted.effect.sensor] else factor[0]
        of_output = factor != "θ" and f"{letter}[{AXES.index(factor[2])}]"
        texts.append(of_output or _warmer(fitted))
    product = _held(fitted, name, " * ".join(texts))
    return AXES.index(fitted.effect.axis), f"{number(fitted.values[name])} * {product}"


def _held(fitted, name, expression):
    """Return the factor of a parameter, held to the range in which it was seen."""
    if name not in fitted.ranges:
        return expression
    low, high = map(number, fitted.ranges[name])
    return f"imu_calibration_held({expression}, {low}, {high})"


def _warmer(fitted):
    return f"(temperature - {number(fitted.effect.reference_temperature)})"
