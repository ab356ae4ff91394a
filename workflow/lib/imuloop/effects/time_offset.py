"""A sensor whose samples are stamped too late or too early."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.derivatives import LATEST, REACH, own_change


class TimeOffset(Effect):
    """``e = y(t) - y(t - Δt)``: the sensor shows what was Δt ago (negative) or will be.

    The other sensor's stamps are the clock: two sensors show what one is late by after the other,
    and a difference of their low-pass filters is the same. Leaves: velocity at the end of a move,
    ``Δt g`` for each radian turned about the horizontal, 15 mm/s per ms for a quarter turn. From
    rest to rest attitudes have all arrived: the angle turned is the same.
    """

    name = "time_offset"
    parameters = {"dt": "s"}
    equation = "e = y(t) - y(t - Δt)"
    reference = "Furgale et al., IROS 2013, temporal calibration"
    records = ("motion",)
    unobservable = "a shift in time changes nothing at rest, nor the angle from rest to rest"
    limit = LATEST
    reach = REACH + LATEST

    def design(self, channels):
        """Return the rate of change of the output, shape (n, 3, 1)."""
        return self.design_at(channels, np.zeros(1))

    def design_at(self, channels, values):
        """Return its mean since what the sensor shows was there, shape (n, 3, 1)."""
        return channels.remembered(own_change, -float(values[0]))[:, :, None]

    def held(self, design, low, high):
        """Return the derivative as it is: a time is the same however fast the output changes."""
        return design
