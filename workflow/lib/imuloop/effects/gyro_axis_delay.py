"""Axes of a gyroscope that are not sampled at one time."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.derivatives import LATEST, REACH, own_change


class GyroAxisDelay(Effect):
    """``e_i = y_i(t) - y_i(t + Δt_i)``: axis i shows what was Δt_i ago, z is the clock.

    Three axes that are late together are a `time_offset`. Leaves: errors of rotations about axes
    that change, and velocity at the end of a move.
    """

    name = "gyro_axis_delay"
    sensors = ("gyroscope",)
    parameters = {"dtx": "s", "dty": "s"}
    equation = "e_i = y_i(t) - y_i(t + Δt_i), Δt_z = 0"
    reference = "Savage, Strapdown Analytics, sensor lag and pseudo-coning"
    records = ("motion",)
    unobservable = "at rest nothing changes; what turns leave of it shows in the motion between"
    limit = LATEST
    reach = REACH + LATEST

    def design(self, channels):
        """Return the derivative with respect to both delays, shape (n, 3, 2)."""
        return self.design_at(channels, np.zeros(2))

    def design_at(self, channels, values):
        """Return the same with the mean change until each axis shows what is there."""
        found = np.zeros((len(channels.t), 3, 2))
        for axis, late in enumerate(values):
            found[:, axis, axis] = -channels.remembered(own_change, float(late))[:, axis]
        return found

    def held(self, design, low, high):
        """Return the derivative as it is: a time is the same however fast the output changes."""
        return design
