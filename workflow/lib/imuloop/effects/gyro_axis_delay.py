"""Axes of a gyroscope that are not sampled at one time."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.derivatives import LATEST, REACH, own_change, unheld


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

    held = unheld

    def design(self, channels, values=(0.0, 0.0)):
        """Return the derivative with respect to both delays, shape (n, 3, 2)."""
        found = np.zeros((len(channels.t), 3, 2))
        for axis, late in enumerate(values):
            found[:, axis, axis] = -channels.remembered(own_change, float(late))[:, axis]
        return found

    design_at = design
