"""Estimates of each parameter by all devices of a type, with standard errors."""

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
    """Estimates of one parameter by n devices; nan for a device that did not determine it.

    For a noise coefficient, which is positive, they are natural logarithms, so that its spread is
    relative.
    """

    name: str  # ``accelerometer.K0``, ``gx.N``
    unit: str  # SI
    logarithmic: bool
    values: np.ndarray  # (n,)
    std: np.ndarray

    @property
    def known(self):
        """Whether each device determined the parameter, (n,) of bool."""
        return np.isfinite(self.values) & np.isfinite(self.std) & (self.std > 0)


def of_calibrations(calibrations):
    """Return the Estimates of misalignment, scale factor error and bias, of n Calibrations.

    They are in nominal SI; a scale factor is relative to the nominal one, minus 1.
    """
    names, values, std = parameters(), [], []
    for calibration in calibrations:
        state, covariance = state_of(calibration, ())
        prior = [name in getattr(calibration, sensor).unimproved for sensor, name, _ in names]
        values.append(state.x - [name[0] == "K" for _, name, _ in names])
        std.append(np.where(prior, 0.0, np.sqrt(np.diag(covariance))))
    values, std = (np.where(np.array(std) > 0, each, np.nan) for each in (values, std))
    return [
        Estimates(f"{sensor}.{name}", unit, False, values[:, i], std[:, i])
        for i, (sensor, name, unit) in enumerate(names)
    ]


def of_noise(noises):
    """Return the Estimates of the noise coefficients N, B and K of n NoiseModels."""
    found = []
    for sensor, channels in SENSORS.items():
        for term, unit in TERMS[sensor].items():
            for channel in channels:
                each = [logarithm(getattr(noise.axes[channel], term)) for noise in noises]
                found.append(Estimates(f"{channel}.{term}", unit, True, *np.transpose(each)))
    return found


def logarithm(coefficient):
    """Return the logarithm of a Coefficient and its standard error; nan if it is not known."""
    value, interval = coefficient.value, coefficient.ci95
    if not value or not interval or interval[1] <= value:
        return np.nan, np.nan
    low, high = interval
    above = np.log(high / value)
    # an interval from zero has no lower end in logarithms
    return np.log(value), (above if low <= 0 else (above + np.log(value / low)) / 2) / _REACH
