"""A sensor's clock that runs faster or slower than that of a reference."""

from dataclasses import dataclass

from imuloop.core.effect import Effect
from imuloop.effects.derivatives import LATEST, REACH, drifting_change, unheld


@dataclass(frozen=True)
class ClockDrift(Effect):
    """``e = y(t) - y(t - d (t - t_m))``: what the sensor shows gains d seconds a second.

    t_m is the middle of the log: what is late there is `time_offset`. Leaves beside a reference: an
    offset in time that grows; 50 ppm are 9 ms after three minutes.
    """

    middle: float = 0.0  # t_m, s

    name = "clock_drift"
    sensors = ("gyroscope",)
    parameters = {"d": "1"}
    equation = "e = y(t) - y(t - d (t - t_m))"
    reference = "Furgale et al., IROS 2013, temporal calibration"
    records = ("reference",)
    unobservable = "only a reference has another clock"
    # crystals are good to some 100 ppm, RC oscillators to 1 %
    limit = 0.02
    reach = REACH + LATEST
    # late at one end and early at the other, neither alone lowers the error of all parts
    hidden_by = ("time_offset",)

    held = unheld

    @classmethod
    def shapes(cls, channels):
        """Return the shape of a log: its middle."""
        return (cls(float(channels.t[0] + channels.t[-1]) / 2),)

    def design(self, channels, values=(0.0,)):
        """Return the rate of change times the time, m/s^2 or rad/s, shape (n, 3, 1)."""
        change = channels.remembered(drifting_change, -float(values[0]), self.middle)
        return (change * (channels.t - self.middle)[:, None])[:, :, None]

    design_at = design
