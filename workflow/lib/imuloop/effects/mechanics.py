"""An accelerometer's mechanics: it creeps after a turn, and rectifies vibration."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.effects.filters import fast_part, first_order_lag, moving_mean

# s; shorter, and it is over when the turn is; longer, and all poses of a session share it
CREEPS = (3.0, 10.0, 30.0)


def creep(channels, tau):
    """Return ``y_lag - y`` of a whole log, SI, shape (n, 3)."""
    return first_order_lag(channels.t, channels.output, tau) - channels.output


@dataclass(frozen=True)
class Reorientation(Effect):
    """``e_i = k_i (y_i,lag - y_i)``: the share k_i of the load creeps, with time constant τ, s.

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
        return on_each_axis(channels.evaluate_memory(creep, self.tau))


# s; what is faster than 10 Hz is a vibration, a turn by hand is ten times slower
PERIOD = 0.1
# s; many periods of a vibration, well within a pose
WINDOW = 1.0


def vibration(channels):
    """Return the mean square of each axis' vibration of a whole log, SI², shape (n, 3).

    Of two windows, the `WINDOW` before and the one after, the quieter: at either end of a pose one
    of them lies in the pose, so that what shakes the turn beside it does not count.
    """
    t, square = channels.t, np.array(channels.output)
    last = np.searchsorted(t, t + WINDOW, side="right") - 1
    # an axis at a time: a log of days is large
    for axis in range(3):
        before = moving_mean(t, fast_part(t, square[:, [axis]], PERIOD) ** 2, WINDOW)[:, 0]
        # sums of large squares may leave less than nothing of small ones
        square[:, axis] = np.maximum(np.minimum(before, before[last]), 0.0)
    return square


class VibrationRectification(Effect):
    """``e_i = v_i σ_i²``: vibration of mean square σ_i² on the same axis shifts its bias.

    v = K2 where a nonlinearity is quadratic and as fast; slow changes, as of a turn, are the
    `quadratic` effect. The sensor's own noise is in σ² too: what is always there is a bias.
    Leaves: means that depend on the variance within the pose, or steps of bias in a static record
    while a motor runs. Imitated by: what changes with the vibration, as a support that tilts.
    """

    name = "vibration_rectification"
    sensors = ("accelerometer",)
    parameters = per_axis({"v": "m/s^2 per (m/s^2)^2"})
    equation = "e_i = v_i σ_i²"
    reference = "Analog Devices, Vibration Rectification in MEMS Accelerometers"
    # ten times what MEMS sensors show, up to 2 mg per g² of mean square
    limit = 2e-3
    timed = True

    def design(self, channels):
        """Return the mean square of the vibration about each point, SI², shape (n, 3, 3)."""
        return on_each_axis(channels.evaluate_memory(vibration))
