"""A sensor's clock that runs faster or slower than that of a reference."""

from imuloop.core.effect import Effect
from imuloop.core.memory import secant
from imuloop.effects.derivatives import LATEST, REACH, unheld


class ClockDrift(Effect):
    """``e = y(t) - y(t - d (t - t_m))``: what the sensor shows gains d seconds a second.

    t_m is the middle of the log: what is late all along is `time_offset`. Leaves beside a
    reference: an offset in time that grows; 50 ppm are 9 ms after three minutes.
    """

    name = "clock_drift"
    sensors = ("gyroscope",)
    parameters = {"d": "1"}
    equation = "e = y(t) - y(t - d (t - t_m))"
    reference = "Furgale et al., IROS 2013, temporal calibration"
    records = ("reference",)
    # crystals are good to some 100 ppm, RC oscillators to 1 %
    limit = 0.02
    reach = REACH + LATEST

    held = unheld

    def design(self, channels, values=(0.0,)):
        """Return the rate of change times the time from the middle, s, shape (n, 3, 1)."""
        t = channels.t - (channels.t[0] + channels.t[-1]) / 2
        change = secant(channels.t, channels.output, -float(values[0]) * t)
        return (change * t[:, None])[:, :, None]

    design_at = design
