"""A calibration axis by axis: offset, scale factor, polynomial of the temperature, its range."""

import numpy as np
from numpy.polynomial import Polynomial

from imuloop.effects.axes import AXES

# the effect that such a polynomial carries
BIAS = "bias_temperature"
# orders of the polynomial, with the constant
TERMS = 4


def scale_and_offset(sensor):
    """Return the scale factor, near 1, and offset, SI, of SI values z as logged, (3,) each.

    ``K (raw - b) = scale (z - offset)``, z the SI value that `raw` stands for by its nominal unit.
    """
    return sensor.K / sensor.raw_unit.scale, sensor.raw_unit.to_si(sensor.b)


def bias_reference(device, name):
    """Return θ0 of the bias of a sensor that follows the temperature, degC; None without."""
    found = device.effects(name, BIAS)
    return found[0].effect.reference_temperature if found else None


def bias_polynomial(device, name, reference):
    """Return the bias that follows the temperature, about another temperature, degC, shape (4, 3).

    ``e_i = Σ_k c_ki (θ - reference)^k``, k = 0 … 3: the effect `bias_temperature`, exactly; SI of
    the output ``K (raw - b)`` per K^k, zeros where there is no such effect.
    """
    total = np.zeros((TERMS, 3))
    for fitted in device.effects(name, BIAS):
        warmer = Polynomial([reference - fitted.effect.reference_temperature, 1.0])
        orders = range(1, fitted.effect.order + 1)
        for axis, letter in enumerate(AXES):
            c = Polynomial([0.0, *(fitted.values[f"c{k}{letter}"] for k in orders)])(warmer).coef
            total[: len(c), axis] += c
    return total


def common(spans):
    """Return the lowest and highest value that all these ranges have, None where there is none."""
    low, high = max(low for low, _ in spans), min(high for _, high in spans)
    return (low, high) if low <= high else None


def seen_range(fitted, names, offset=0.0):
    """Return the lowest and highest derivative by parameters that was seen, None if unknown."""
    known = [fitted.ranges[name] for name in names if name in fitted.ranges]
    found = common(known) if known else None
    return found and (offset + found[0], offset + found[1])


def temperature_range(fitted):
    """Return between which temperatures `bias_temperature` was seen, degC; None if unknown."""
    return seen_range(fitted, [f"c1{axis}" for axis in AXES], fitted.effect.reference_temperature)


def common_temperatures(device, *sensors):
    """Return between which temperatures the biases of sensors were all seen to follow them, degC.

    Of an effect without a range those of the logs; None where no sensor has the effect, a range is
    not known, or they have none in common.
    """
    found = [fitted for name in sensors for fitted in device.effects(name, BIAS)]
    spans = [temperature_range(fitted) or device.temperature_range for fitted in found]
    return common(spans) if spans and None not in spans else None


def range_lines(device, sensor, name, held):
    """Return a line on the range in which `bias_temperature` or `g_sensitivity` was seen, if known.

    `held` is what the format does about it.
    """
    lines = []
    for fitted in device.effects(sensor, name):
        if name == BIAS:
            span = temperature_range(fitted)
            words = span and "from {:g} to {:g} degC".format(*span)
            if lag := fitted.effect.lag:
                late = f"the thermometer of the logs is {lag:.0f} s late, which is not made up here"
                lines.append(f"{name}: {late}: right at a steady temperature")
        else:
            forces = [seen_range(fitted, [f"G{i}{j}" for i in range(3)]) for j in range(3)]
            each = zip(AXES, forces, strict=True)
            known = [f"f_{axis} from {f[0]:g} to {f[1]:g}" for axis, f in each if f]
            words = known and f"with {', '.join(known)} m/s^2"
        if words:
            lines.append(f"{name} was seen {words}; {held}")
    return lines
