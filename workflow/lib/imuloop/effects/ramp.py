"""A bias that changes evenly with time within a static record."""

from dataclasses import dataclass
from typing import ClassVar

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis


@dataclass(frozen=True)
class Ramp(Effect):
    """``e_i = d_i t``: the bias changes evenly with time, from the start of each log.

    The same as `bias_drift` between poses. Imitated by: `bias_temperature` where the temperature
    only rises or falls, a long `warm_up`, and random walk, which the noise of the test allows for.
    """

    name = "ramp"
    sensors = ("accelerometer", "gyroscope")
    parameters: ClassVar = per_axis({"d": "output per s"})
    equation = "e_i = d_i t"
    reference = "IEEE Std 952-1997, annex C, rate ramp"
    records = ("static_record",)

    def design(self, channels):
        """Return the time on each axis, shape (n, 3, 3)."""
        return on_each_axis(channels.t)
