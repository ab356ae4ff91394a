"""The temperature as effects take it: without gaps, and with a reference."""

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.memory import filled

# degC, at which data sheets give bias and scale factor
ROOM = 25.0
# K; one step of a thermometer of whole degrees, or the error of one on a chip, is as much
LEAST_SPAN = 1.0
# degC, between which a reference can lie
CELSIUS = (-273.15, 1000.0)


def temperature(channels):
    """Return the temperature at every point, degC, gaps filled on a line or held.

    Raises
    ------
    ImuloopError
        If none was logged.
    """
    values = channels.temperature
    if values is None or not np.isfinite(values).any():
        raise ImuloopError("an effect of temperature needs a temperature, and none was logged")
    return filled(channels.t, np.asarray(values, dtype=float))


def whole_degrees(channels):
    """Return a reference near the middle of the data, degC: their mean, rounded."""
    return float(np.round(temperature(channels).mean()))


def span(channels):
    """Return the largest temperature less the smallest, K; zero where none was logged."""
    if channels.temperature is None or not np.isfinite(channels.temperature).any():
        return 0.0
    return float(np.ptp(temperature(channels)))
