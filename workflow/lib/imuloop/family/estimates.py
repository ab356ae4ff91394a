"""Values of each parameter of all devices of a type, with standard errors."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.model.raw_units import state_of
from imuloop.model.state import parameters

# noise coefficients, white, flicker and walk, with their SI units
TERMS = {
    "accelerometer": {"N": "m/s^2/√Hz", "B": "m/s^2", "K": "m/s^3/√Hz"},
    "gyroscope": {"N": "rad/s/√Hz", "B": "rad/s", "K": "rad/s^2/√Hz"},
}
# half a 95 % interval in standard deviations
_REACH = 1.959964


@dataclass(frozen=True)
class Estimates:
    """The value of one parameter in each of n devices, with its standard error.

    Value and standard error are nan for a device whose data do not determine the parameter. The
    values are in nominal SI: raw readings with the offset and scale of the data sheet. For a noise
    coefficient they are natural logarithms, so that differences and the spread between devices are
    relative.
    """

    name: str  # ``accelerometer.K0``, ``gx.N``
    unit: str  # SI
    logarithmic: bool  # whether `values` are natural logarithms
    values: np.ndarray  # (n,)
    std: np.ndarray  # (n,): standard errors of the values

    @property
    def has_value(self):
        """Whether the data of each device determine the parameter, (n,) of bool for n devices."""
        return np.isfinite(self.values) & np.isfinite(self.std) & (self.std > 0)


def estimates_of_calibrations(calibrations):
    """Return the misalignments, scale factor errors and biases of n devices, a list of Estimates.

    There is one Estimates for each parameter. `calibrations` are the Calibrations of the devices.
    The values are in nominal SI. A scale factor error is the scale factor over the nominal one of
    the data sheet, minus 1.
    """
    # sensor, name and unit of each parameter without effects
    names, values, std = parameters(), [], []
    is_scale = np.array([name[0] == "K" for _, name, _ in names], dtype=float)
    for calibration in calibrations:
        state, covariance = state_of(calibration, ())
        # the log told nothing about these parameters: they are the prior's, and do not count
        is_prior = [name in getattr(calibration, sensor).unimproved for sensor, name, _ in names]
        values.append(state.x - is_scale)
        std.append(np.where(is_prior, 0.0, np.sqrt(np.diag(covariance))))
    values, std = (np.where(np.array(std) > 0, x, np.nan) for x in (values, std))
    columns = zip(names, values.T, std.T, strict=True)
    return [
        Estimates(f"{sensor}.{name}", unit, logarithmic=False, values=y, std=error)
        for (sensor, name, unit), y, error in columns
    ]


def estimates_of_noise(noises):
    """Return the white noise N, flicker B and random walk K of n devices, a list of Estimates.

    There is one Estimates for each coefficient and axis; its values are natural logarithms.
    `noises` are the NoiseModels of the devices.
    """
    estimates = []
    for sensor, channels in SENSORS.items():
        for term, unit in TERMS[sensor].items():
            for channel in channels:
                pairs = [logarithm(getattr(noise.axes[channel], term)) for noise in noises]
                values, std = np.transpose(pairs)
                name = f"{channel}.{term}"
                estimates.append(Estimates(name, unit, logarithmic=True, values=values, std=std))
    return estimates


def logarithm(coefficient):
    """Return the natural logarithm of a noise coefficient, and its standard error.

    `coefficient` is the Coefficient. The standard error follows from the 95 % interval of the
    coefficient. Logarithm and error are nan if the value or the interval is not known.
    """
    value, interval = coefficient.value, coefficient.ci95
    if not value or not interval or interval[1] <= value:
        return np.nan, np.nan
    low, high = interval
    above = np.log(high / value)
    # an interval from zero has no lower end in logarithms
    half_width = above if low <= 0 else (above + np.log(value / low)) / 2
    return np.log(value), half_width / _REACH
