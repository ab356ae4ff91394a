"""The effects of a sensor as C: what the function of a header subtracts."""

from imuloop.effects.axes import AXES
from imuloop.export.text import number
from imuloop.export.values import BIAS

# what element (i, j) of an effect's matrix multiplies
MATRICES = {
    "g_sensitivity": "f[{1}]",
    "rate_sensitivity": "w[{1}]",
    "lever_arm": "imu_calibration_arm(w, dw, {0}, {1})",
}
CARRIED = (BIAS, "scale_temperature", *MATRICES)


def needs_rate(sensor):
    """Return whether the function of a sensor takes the angular rate and its change."""
    return any(fitted.name in ("lever_arm", "rate_sensitivity") for fitted in sensor["effects"])


def subtracted(sensor):
    """Return (fitted effect, [(axis, expression)]) of what C can compute without a past."""
    return [(fitted, _effect(fitted)) for fitted in sensor["effects"] if fitted.name in CARRIED]


def _effect(fitted):
    """Return axis and expression of each parameter times what it multiplies."""
    found = []
    for k, name in enumerate(fitted.effect.parameters):
        row, column = divmod(k, 3)
        if fitted.name in MATRICES:
            axis = row
            factors = [_held(fitted, name, MATRICES[fitted.name].format(row, column))]
        elif fitted.name == BIAS:
            # the temperature is held, then raised to its power
            axis = column
            factors = [_held(fitted, f"c1{AXES[axis]}", _warmer(fitted))] * (row + 1)
        else:
            axis = column
            factors = [_held(fitted, name, f"{_warmer(fitted)} * o[{axis}]")]
        found.append((axis, " * ".join([number(fitted.values[name]), *factors])))
    return found


def _held(fitted, name, expression):
    """Return what a parameter multiplies, held to the range in which that was seen."""
    if name not in fitted.ranges:
        return expression
    low, high = map(number, fitted.ranges[name])
    return f"imu_calibration_held({expression}, {low}, {high})"


def _warmer(fitted):
    return f"(temperature - {number(fitted.effect.reference_temperature)})"
