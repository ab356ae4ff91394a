"""A sensor whose samples are stamped too late or too early."""

from imuloop.core.effect import Effect
from imuloop.effects.derivatives import LATEST, REACH, own_change, unheld


class TimeOffset(Effect):
    """``e = y(t) - y(t - Δt)``: the sensor shows what was Δt ago (negative) or will be.

    The other sensor's stamps are the clock: two sensors show what one is late by after the other,
    and a difference of their low-pass filters is the same. Leaves: velocity at the end of a move,
    ``Δt g`` for each radian turned about the horizontal, 15 mm/s per ms for a quarter turn. From
    rest to rest attitudes have all arrived: the angle turned is the same. Beside a reference, its
    clock is the clock, of both sensors.
    """

    name = "time_offset"
    parameters = {"dt": "s"}
    equation = "e = y(t) - y(t - Δt)"
    reference = "Furgale et al., IROS 2013, temporal calibration"
    records = ("motion", "reference")
    unobservable = "a shift in time changes nothing at rest, nor the angle from rest to rest"
    limit = LATEST
    reach = REACH + LATEST

    held = unheld

    def design(self, channels, values=(0.0,)):
        """Return the rate of change since what the sensor shows was there, shape (n, 3, 1)."""
        return channels.remembered(own_change, -float(values[0]))[:, :, None]

    design_at = design
