"""A calibration axis by axis: offset, scale factor, polynomial of the temperature, its range."""

import numpy as np
from numpy.polynomial import Polynomial

from imuloop.core.units import DEGREE
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


def scale_left_out(scale):
    """Return a line on the gyroscope's scale factor for an autopilot that takes none, if any."""
    error = np.abs(scale - 1).max()
    return [f"Not carried of the gyroscope: scale factor K, up to {error:.2g} from 1"] * bool(error)


def effects_of(sensor, name):
    """Return the fitted effects of a sensor that have a name."""
    return [fitted for fitted in sensor.effects if fitted.name == name]


def bias_reference(sensor):
    """Return θ0 of the bias of a sensor that follows the temperature, degC; None without."""
    found = effects_of(sensor, BIAS)
    return found[0].effect.reference_temperature if found else None


def bias_polynomial(sensor, reference):
    """Return the bias that follows the temperature, about another temperature, degC.

    ``e_i = Σ_k c_ki (θ - reference)^k``, k = 0 … 3: the effect `bias_temperature`, exactly.

    Returns
    -------
    ndarray, shape (4, 3)
        c, SI of the output ``K (raw - b)`` per K^k; zeros where there is no such effect.
    """
    total = np.zeros((TERMS, 3))
    for fitted in effects_of(sensor, BIAS):
        warmer = Polynomial([reference - fitted.effect.reference_temperature, 1.0])
        orders = range(1, fitted.effect.order + 1)
        for axis, letter in enumerate(AXES):
            c = Polynomial([0.0, *(fitted.values[f"c{k}{letter}"] for k in orders)])(warmer).coef
            total[: len(c), axis] += c
    return total


def left_out(device, name, carried=(), aligned=False):
    """Return a line for each part of a sensor's calibration that a format does not carry.

    Parameters
    ----------
    device : Exported
        The device.
    name : {'accelerometer', 'gyroscope'}
        The sensor.
    carried : tuple of str
        Effects that the format carries.
    aligned : bool
        Whether it carries the misalignment.
    """
    lines = device.effects(name, carried)
    angle = np.abs(device.sensor(name).T - np.eye(3)).max() / DEGREE
    if angle and not aligned:
        lines.insert(0, f"misalignment T, largest element {angle:.2g} deg")
    return [f"Not carried of the {name}: {line}" for line in lines]


def common(spans):
    """Return the lowest and highest value that all these ranges have, None where there is none."""
    low, high = max(low for low, _ in spans), min(high for _, high in spans)
    return (low, high) if low <= high else None


def input_range(fitted, names):
    """Return the lowest and highest derivative by parameters that was seen, SI, None if unknown."""
    known = [fitted.seen[name] for name in names if name in fitted.seen]
    return common(known) if known else None


def temperature_range(fitted):
    """Return between which temperatures `bias_temperature` was seen, degC; None if unknown."""
    seen = input_range(fitted, [f"c1{axis}" for axis in AXES])
    return seen and tuple(fitted.effect.reference_temperature + end for end in seen)


def common_temperatures(device, *sensors):
    """Return between which temperatures the biases of sensors were all seen to follow them, degC.

    Of an effect without a range those of the logs; None where no sensor has the effect, a range is
    not known, or they have none in common.
    """
    found = [fitted for name in sensors for fitted in effects_of(device.sensor(name), BIAS)]
    spans = [temperature_range(fitted) or device.temperature_range for fitted in found]
    return common(spans) if spans and None not in spans else None


def range_lines(sensor, name, held):
    """Return a line on the range in which an effect of a sensor was seen; none where it has none.

    Parameters
    ----------
    sensor : SensorCalibration
        Of an accelerometer or gyroscope.
    name : {'bias_temperature', 'g_sensitivity'}
        The effect.
    held : str
        What the format does about the range.
    """
    lines = []
    for fitted in effects_of(sensor, name):
        if name == BIAS:
            span = temperature_range(fitted)
            words = span and "from {:g} to {:g} degC".format(*span)
        else:
            forces = [input_range(fitted, [f"G{i}{j}" for i in range(3)]) for j in range(3)]
            each = zip(AXES, forces, strict=True)
            known = [f"f_{axis} from {f[0]:g} to {f[1]:g}" for axis, f in each if f]
            words = known and f"with {', '.join(known)} m/s^2"
        if words:
            lines.append(f"{name} was seen {words}; {held}")
    return lines
