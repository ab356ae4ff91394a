"""Creep of an accelerometer after it was turned."""

from dataclasses import dataclass

from imuloop.core.effect import Effect
from imuloop.core.memory import first_order_lag, in_pieces
from imuloop.effects.axes import on_each_axis, per_axis

# s; shorter, and it is over when the turn is; longer, and all poses of a session share it
CREEPS = (3.0, 10.0, 30.0)


@in_pieces
def creep(channels, tau):
    """Return ``y_lag - y`` of a whole log, SI, shape (n, 3)."""
    lagged = first_order_lag(channels.t, channels.output, tau, channels.past)
    return lagged - channels.output


@dataclass(frozen=True)
class Reorientation(Effect):
    """``e_i = k_i (y_i,lag - y_i)``: part k_i of the load is borne by what creeps, τ in s.

    ``τ dy_lag/dt = y - y_lag``, at rest at the start of the log. After a turn the output starts
    k_i times the change of load short, and relaxes with exp(-t/τ).
    Leaves: a trend within each pose, and a mean that depends on the pose before. Imitated by:
    nothing in the library; a support that gives way looks the same.
    """

    tau: float = 10.0

    name = "reorientation"
    sensors = ("accelerometer",)
    parameters = per_axis({"k": "1"})
    equation = "e_i = k_i (y_i,lag - y_i)"
    reference = "Zhou et al., Materials 10 (2017) 1077, viscoelastic die attach"
    timed = True
    records = ("poses",)

    @classmethod
    def shapes(cls, channels):
        """Return the time constants to try."""
        return tuple(cls(tau) for tau in CREEPS)

    def design(self, channels):
        """Return the load that still creeps on each axis, shape (n, 3, 3)."""
        return on_each_axis(channels.remembered(creep, self.tau))
