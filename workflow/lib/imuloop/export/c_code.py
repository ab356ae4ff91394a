"""The effects of a sensor as C: what the function of a header subtracts."""

from imuloop.effects.axes import AXES
from imuloop.effects.discovered import Discovered
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
    # what a formula is given
    letters = {"accelerometer": set("fT"), "gyroscope": set("fwT")}[sensor["name"]]
    found = []
    for fitted in sensor["effects"]:
        if fitted.name in CARRIED:
            found.append((fitted, _effect(fitted)))
        elif fitted.name == Discovered.name:
            if not fitted.effect.timed and fitted.effect.letters <= letters:
                found.append((fitted, _formula(fitted)))
    return found


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


def _formula(fitted):
    """Return axis and expression of each term of a formula of outputs and temperature."""
    found = []
    for (axis, factors), name in zip(fitted.effect.terms, fitted.effect.parameters, strict=True):
        texts = []
        for letter, power, absolute in factors:
            own = (letter[0] == "f") == (fitted.effect.sensor == "accelerometer")
            channel = "o" if own else "f"
            text = _warmer(fitted) if letter == "T" else f"{channel}[{AXES.index(letter[1])}]"
            texts += [f"({text} < 0 ? -{text} : {text})" if absolute else text] * power
        product = _held(fitted, name, " * ".join(texts))
        found.append((axis, f"{number(fitted.values[name])} * {product}"))
    return found


def _held(fitted, name, expression):
    """Return what a parameter multiplies, held to the range in which that was seen."""
    if name not in fitted.ranges:
        return expression
    low, high = map(number, fitted.ranges[name])
    return f"imu_calibration_held({expression}, {low}, {high})"


def _warmer(fitted):
    return f"(temperature - {number(fitted.effect.reference_temperature)})"
