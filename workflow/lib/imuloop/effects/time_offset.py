"""A sensor whose samples are stamped too late or too early."""

from imuloop.core.effect import Effect
from imuloop.effects.derivatives import REACH, own_slope


class TimeOffset(Effect):
    """``e = Δt dy/dt``: the sensor shows what was Δt ago (negative) or will be.

    The other sensor's stamps are the clock: two sensors show what one is late by after the other,
    and a difference of their low-pass filters is the same. Leaves: velocity at the end of a move,
    ``Δt g`` for each radian turned about the horizontal, 15 mm/s per ms for a quarter turn. From
    rest to rest attitudes have all arrived: the angle turned is the same.
    """

    name = "time_offset"
    parameters = {"dt": "s"}
    equation = "e = Δt dy/dt"
    reference = "Furgale et al., IROS 2013, temporal calibration"
    records = ("motion",)
    unobservable = "a shift in time changes nothing at rest, nor the angle from rest to rest"
    limit = 0.1
    reach = REACH

    def design(self, channels):
        """Return the rate of change of the output, shape (n, 3, 1)."""
        return channels.remembered(own_slope)[:, :, None]
