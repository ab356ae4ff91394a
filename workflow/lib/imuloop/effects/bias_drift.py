"""A bias that runs away in time."""

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis


class BiasDrift(Effect):
    """``e_i = d_i t``: the bias changes evenly with time, from the start of each log.

    Leaves: an error of pose means that grows with time whatever the attitude. Imitated by:
    `bias_temperature` where the temperature only rises or falls, a long `warm_up`, and the noise's
    own random walk, which the floor holds. In a static record the same term is called `ramp`.
    """

    name = "bias_drift"
    parameters = per_axis({"d": "output per s"})
    equation = "e_i = d_i t"
    reference = "IEEE Std 952-1997, annex C, rate ramp"
    timed = True
    records = ("poses",)

    def design(self, channels):
        """Return the time on each axis, shape (n, 3, 3)."""
        return on_each_axis(channels.t)
