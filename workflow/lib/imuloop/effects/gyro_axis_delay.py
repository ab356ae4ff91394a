"""Axes of a gyroscope that are not sampled at one time."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.derivatives import REACH, own_slope


class GyroAxisDelay(Effect):
    """``e_i = -Δt_i dy_i/dt``: axis i shows what was Δt_i ago; z is the clock of the others.

    Three axes that are late together are a `time_offset`. Leaves: errors of rotations about axes
    that change, and velocity at the end of a move.
    """

    name = "gyro_axis_delay"
    sensors = ("gyroscope",)
    parameters = {"dtx": "s", "dty": "s"}
    equation = "e_i = -Δt_i dy_i/dt, Δt_z = 0"
    reference = "Savage, Strapdown Analytics, sensor lag and pseudo-coning"
    records = ("motion",)
    unobservable = "at rest nothing changes; what turns leave of it shows in the motion between"
    limit = 0.1
    reach = REACH

    def design(self, channels):
        """Return the derivative with respect to both delays, shape (n, 3, 2)."""
        return -channels.remembered(own_slope)[:, :, None] * np.eye(3)[:, :2]
