"""Delays of the output of a sensor, or of one of its axes."""

import numpy as np

from imuloop.effects.filters import secant, slope
from imuloop.model.effect import Effect

# largest delay, s
LATEST = 0.1


def own_change(channels, seconds):
    """Return the mean rate of change of the sensor's output over the next `seconds`, SI/s, (n, 3).

    `channels` are the Channels of a whole log of n samples. If `seconds` is negative, the mean is
    over the time ``-seconds`` before each sample.
    """
    return secant(channels.t, channels.output, seconds)


def other_slope(channels):
    """Return the rate of change of the other sensor's output, SI/s, (n, 3).

    The other sensor of a gyroscope is the accelerometer, and vice versa. `channels` are the
    Channels of a whole log of n samples.
    """
    return slope(channels.t, channels.other)


class TimeOffset(Effect):
    """``e = y(t) - y(t - Δt)``: the output y of the sensor is early by Δt, or late by -Δt.

    Early means that the output with the time stamp t is the quantity at t + Δt, by the clock of the
    other sensor. A difference between the delays of the low-pass filters of both sensors has the
    same effect.
    Leaves this trace: after a move, the integrated velocity is wrong by ``Δt g`` for each radian
    turned about the horizontal, 15 mm/s per ms for a quarter turn. The angle from rest to rest is
    right.
    """

    name = "time_offset"
    parameters = {"dt": "s"}
    reference = "Furgale et al., IROS 2013, temporal calibration"
    records = ("motion",)
    limit = LATEST
    rate_of_change = True

    def clamped(self, design, low, high):
        """Return the derivative `design` unchanged: a delay is valid for any rate of change.

        So the ends `low` and `high` of its range in the data of the fit are not used.
        """
        return design

    def design(self, channels, values=(0.0,)):
        """Return the matrix D with ``e = D Δt``, SI/s, (n, 3, 1).

        e is the error that the delay Δt, s, causes in the output; Δt is the only element of
        `values`. D is the mean rate of change of the output over the delay. For Δt = 0, D is the
        derivative of e with respect to Δt. The axes of D are: n points of `channels`, axis of the
        sensor, parameter.
        """
        return channels.evaluate_memory(own_change, -float(values[0]))[:, :, None]

    design_at = design


class GyroAxisDelay(TimeOffset):
    """``e_i = y_i(t) - y_i(t + Δt_i), Δt_z = 0``: the output y of axis i is late by Δt_i.

    Late means that the output with the time stamp t is the rate at t - Δt_i. The delays are
    relative to axis z. A delay that all three axes have in common is a `time_offset`.
    Leaves this trace: the angle is wrong after turns during which the axis of rotation changes, and
    after a move the integrated velocity is wrong.
    """

    name = "gyro_axis_delay"
    sensors = ("gyroscope",)
    parameters = {"dtx": "s", "dty": "s"}
    reference = "Savage, Strapdown Analytics, sensor lag and pseudo-coning"

    def design(self, channels, values=(0.0, 0.0)):
        """Return the matrix D with ``e = D p``, p = (Δt_x, Δt_y), SI/s, (n, 3, 2).

        e is the error that both delays p, s, cause in the output; p are the `values`. For axes x
        and y, D is minus the mean rate of change of the output of the axis over its delay; all
        other elements are zero. The axes of D are: n points of `channels`, axis of the sensor,
        delay.
        """
        design = np.zeros((len(channels.t), 3, 2))
        for axis, delay in enumerate(values):
            design[:, axis, axis] = -channels.evaluate_memory(own_change, float(delay))[:, axis]
        return design

    design_at = design
