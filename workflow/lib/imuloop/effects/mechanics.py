"""Mechanical effects of an accelerometer: creep after a turn, and rectification of vibration."""

from dataclasses import dataclass

import numpy as np

from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.effects.filters import fast_part, first_order_lag, moving_mean
from imuloop.model.effect import Effect

# time constants to try, s: a shorter creep ends with the turn, a longer one is common to all poses
CREEPS = (3.0, 10.0, 30.0)


def creep(channels, tau):
    """Return ``y_lag - y`` at the n samples of a log, SI, (n, 3), for a creep of the output.

    y is the output of the sensor in the Channels `channels`, and y_lag is the response of a
    first-order lag to y. `tau` is the time constant of the lag, s.
    """
    return first_order_lag(channels.t, channels.output, tau) - channels.output


@dataclass(frozen=True)
class Reorientation(Effect):
    """``e_i = k_i (y_i,lag - y_i)``: the share k_i of the load creeps, with time constant τ, s.

    The load is the specific force on axis i, which a turn of the device changes. y is the output.
    y_lag follows y by ``τ dy_lag/dt = y - y_lag`` and equals y at the start of the log. After a
    turn changes the load of axis i, the output is at first too small by k_i times this change; the
    error decays with exp(-t/τ), where t is the time since the turn.
    Leaves this trace: the output has a trend within each pose, and its mean depends on the pose
    before. Imitated by: no other effect; a support that gives way looks the same.
    """

    tau: float = 10.0

    name = "reorientation"
    sensors = ("accelerometer",)
    parameters = per_axis({"k": "1"})
    reference = "Zhou et al., Materials 10 (2017) 1077, viscoelastic die attach"
    timed = True

    @classmethod
    def variants(cls, channels):
        """Return the variants of the effect to try, a tuple: one for each τ in `CREEPS`, s.

        The Channels `channels` of the data are not used.
        """
        return tuple(cls(tau) for tau in CREEPS)

    def design(self, channels):
        """Return the derivative of e with respect to k, ``y_lag - y`` on each axis, (n, 3, 3).

        e is the error of the class' equation, which also has the parameters k, the output y and its
        lagged response y_lag. The axes of the result are: n points of `channels`, axis of the
        sensor, parameter.
        """
        return on_each_axis(channels.evaluate_memory(creep, self.tau))


# period of the slowest vibration, s: a turn by hand is ten times slower
PERIOD = 0.1
# length of a mean square, s: many periods of a vibration, and shorter than a pose
WINDOW = 1.0


def vibration(channels):
    """Return the mean square of the vibration of each axis at the n samples of a log, SI², (n, 3).

    Vibration is the fast change of the output in the Channels `channels`. Its mean square is
    computed over the `WINDOW` before a sample and over the `WINDOW` after it, and the smaller one
    is the result. Near an end of a rest one of both windows lies in the rest, so that the shaking
    of the move before or after the rest does not count.
    """
    t, squares = channels.t, []
    last = np.searchsorted(t, t + WINDOW, side="right") - 1
    # one axis at a time, to save memory
    for output in np.transpose(channels.output):
        # changes slower than a vibration, as in a turn, are removed
        vibrating = fast_part(t, output[:, None], PERIOD)
        before = moving_mean(t, vibrating**2, WINDOW)[:, 0]
        # the mean square after a sample is the one before the last sample of the window after it
        smaller = np.minimum(before, before[last])
        # rounding of large sums may make small mean squares negative
        squares.append(np.maximum(smaller, 0.0))
    return np.column_stack(squares)


class VibrationRectification(Effect):
    """``e_i = v_i σ_i²``: vibration of mean square σ_i² on the same axis shifts its bias.

    v_i are the parameters. A quadratic nonlinearity K2 of a sensor that follows the vibration has
    the same effect, with v = K2; its response to slow changes, as in a turn, is the `quadratic`
    effect. σ² includes the noise of the sensor, whose constant part is a bias.
    Leaves this trace: the mean over a pose depends on the variance within the pose, or the bias in
    a static record jumps while a motor runs. Imitated by: a support that tilts while it vibrates.
    """

    name = "vibration_rectification"
    sensors = ("accelerometer",)
    parameters = per_axis({"v": "m/s^2 per (m/s^2)^2"})
    reference = "Analog Devices, Vibration Rectification in MEMS Accelerometers"
    records = ("poses", "static_record")
    # ten times what MEMS sensors show, up to 2 mg per g² of mean square
    limit = 2e-3
    timed = True

    def design(self, channels):
        """Return the derivative of e with respect to v, σ² on each axis, SI², (n, 3, 3).

        e is the error of the class' equation, v are its parameters, and σ² is the mean square of
        the vibration. The axes of the result are: n points of `channels`, axis of the sensor,
        parameter.
        """
        return on_each_axis(channels.evaluate_memory(vibration))
