"""A sensor's clock that runs faster or slower than that of a reference."""

from imuloop.core.effect import Effect
from imuloop.effects.derivatives import LATEST, REACH, own_change, unheld


class ClockDrift(Effect):
    """``e = d (t - t_m) dy/dt``: the stamps gain d seconds a second, t_m the middle of the log.

    Leaves beside a reference: an offset in time that grows; 50 ppm are 9 ms after three minutes.
    """

    name = "clock_drift"
    sensors = ("gyroscope",)
    parameters = {"d": "1"}
    equation = "e = d (t - t_m) dy/dt"
    reference = "Furgale et al., IROS 2013, temporal calibration"
    records = ("reference",)
    # crystals are good to some 100 ppm, RC oscillators to 1 %
    limit = 0.02
    reach = REACH + LATEST

    held = unheld

    def design(self, channels):
        """Return the rate of change times the time from the middle, s, shape (n, 3, 1)."""
        t = channels.t - (channels.t[0] + channels.t[-1]) / 2
        return (channels.remembered(own_change, 0.0) * t[:, None])[:, :, None]
