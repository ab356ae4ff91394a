"""Vibration that an accelerometer turns into a bias."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.memory import fast_part, in_pieces, moving_mean
from imuloop.effects.axes import on_each_axis, per_axis

# s; what is faster than 10 Hz is a vibration, a turn by hand is ten times slower
PERIOD = 0.1
# s; many periods of a vibration, well within a pose
WINDOW = 1.0


@in_pieces
def vibration(channels):
    """Return the mean square of each axis' vibration of a whole log, SI², shape (n, 3).

    Of two windows, the `WINDOW` before and the one after, the quieter: at either end of a pose one
    of them lies in the pose, so that what shakes the turn beside it does not count.
    """
    t, found = channels.t, np.array(channels.output)
    last = np.searchsorted(t, t + WINDOW, side="right") - 1
    # an axis at a time: a log of days is large
    for axis in range(3):
        fast = fast_part(t, found[:, [axis]], PERIOD, channels.step)
        before = moving_mean(t, fast**2, WINDOW)[:, 0]
        # sums of large squares may leave less than nothing of small ones
        found[:, axis] = np.maximum(np.minimum(before, before[last]), 0.0)
    return found


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
    reach = WINDOW

    def design(self, channels):
        """Return the mean square of the vibration about each point, SI², shape (n, 3, 3)."""
        return on_each_axis(channels.remembered(vibration))
