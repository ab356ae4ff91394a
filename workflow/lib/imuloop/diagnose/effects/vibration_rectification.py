"""Vibration that an accelerometer turns into a bias."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.memory import moving_variance
from imuloop.diagnose.effects.axes import on_each_axis, per_axis

# s; many periods of what motors and hands do (above some 5 Hz), well within a pose
WINDOW = 1.0


def vibration(channels):
    """Return the variance of each axis' output about now of a whole log, SI², shape (n, 3).

    The quieter of the `WINDOW` before and the one after: at either end of a pose one of the two
    lies in the pose, so that the turn beside it does not count as vibration.
    """
    t = channels.t
    before = moving_variance(t, channels.output, WINDOW)
    after = before[np.searchsorted(t, t + WINDOW, side="right") - 1]
    return np.minimum(before, after)


@dataclass(frozen=True)
class VibrationRectification(Effect):
    """``e_i = v_i σ_i²``: vibration of variance σ_i² on the same axis shifts its bias.

    The mean of a nonlinearity over a vibration; v = K2 where it is quadratic and as fast.
    The sensor's own noise is in σ² too: what is always there is a bias.
    Leaves: means that depend on the variance within the pose, or steps of bias in a static record
    while a motor runs. Imitated by: what changes with the vibration, as a support that tilts.
    """

    name = "vibration_rectification"
    sensors = ("accelerometer",)
    parameters: ClassVar = per_axis({"v": "m/s^2 per (m/s^2)^2"})
    equation = "e_i = v_i σ_i²"
    reference = "Analog Devices, Vibration Rectification in MEMS Accelerometers"

    def design(self, channels):
        """Return the variance about each point, SI², shape (n, 3, 3)."""
        return on_each_axis(channels.remembered(vibration))
