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


def _logged(channels):
    return channels.temperature is not None and bool(np.isfinite(channels.temperature).any())


def temperature(channels):
    """Return the temperature, degC, gaps filled on a line or held; ImuloopError without one."""
    if not _logged(channels):
        raise ImuloopError("an effect of temperature needs a temperature, and none was logged")
    return filled(channels.t, np.asarray(channels.temperature, dtype=float))


def whole_degrees(channels):
    """Return a reference near the middle of the data, degC: their mean, rounded."""
    return float(np.round(temperature(channels).mean()))


def span(channels):
    """Return the largest temperature less the smallest, K; zero where none was logged."""
    return float(np.ptp(temperature(channels))) if _logged(channels) else 0.0
