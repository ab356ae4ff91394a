"""A calibration axis by axis: offset, scale factor and polynomial of the temperature."""

import numpy as np

from imuloop.core.units import DEGREE

# the effect that such a polynomial carries
BIAS = "bias_temperature"
# orders of the polynomial, with the constant
TERMS = 4


def scale_and_offset(sensor):
    """Return the calibration of SI values as logged, axis by axis.

    ``K (raw - b) = scale (z - offset)``, z the SI value that `raw` stands for by its nominal unit.

    Parameters
    ----------
    sensor : SensorCalibration
        Of an accelerometer or gyroscope.

    Returns
    -------
    scale : ndarray, shape (3,)
        Dimensionless, near 1.
    offset : ndarray, shape (3,)
        m/s^2 or rad/s.
    """
    return sensor.K / sensor.raw_unit.scale, sensor.raw_unit.to_si(sensor.b)


def scale_left_out(scale):
    """Return a line on the gyroscope's scale factor for an autopilot that takes none, if any."""
    error = np.abs(scale - 1).max()
    return [f"Not carried of the gyroscope: scale factor K, up to {error:.2g} from 1"] * bool(error)


def bias_reference(sensor):
    """Return θ0 of the bias of a sensor that follows the temperature, degC; None without."""
    found = [e.effect.reference_temperature for e in sensor.effects if e.name == BIAS]
    return found[0] if found else None


def bias_polynomial(sensor, reference):
    """Return the bias that follows the temperature, about another temperature.

    ``e_i = Σ_k c_ki (θ - reference)^k``, k = 0 … 3: the effect `bias_temperature`, exactly.

    Parameters
    ----------
    sensor : SensorCalibration
        Of an accelerometer or gyroscope.
    reference : float
        degC.

    Returns
    -------
    ndarray, shape (4, 3)
        c, SI of the output ``K (raw - b)`` per K^k; zeros where there is no such effect.
    """
    # takes longer to load than most exports to make
    from numpy.polynomial import Polynomial

    total = np.zeros((TERMS, 3))
    for fitted in (e for e in sensor.effects if e.name == BIAS):
        warmer = Polynomial([reference - fitted.effect.reference_temperature, 1.0])
        orders = range(1, fitted.effect.order + 1)
        for axis, letter in enumerate("xyz"):
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
    lines = [line for line in device.effects(name) if line.split(":")[0] not in carried]
    angle = np.abs(device.sensor(name).T - np.eye(3)).max() / DEGREE
    if angle and not aligned:
        lines.insert(0, f"misalignment T, largest element {angle:.2g} deg")
    return [f"Not carried of the {name}: {line}" for line in lines]
