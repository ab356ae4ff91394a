"""A bias that changes slowly with time: after power-on, or linearly."""

from dataclasses import dataclass

import numpy as np

from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.model.effect import Effect

# time constants to try, s, from a chip on its board to a closed housing. They differ by a factor of
# 3.4, so that a true one is within a factor of 1.85
SETTLING = (30.0, 100.0, 350.0, 1200.0)
# least length of a record in time constants: in a shorter one an exponential is nearly linear
SETTLINGS = 2
# fewest points within twice the time constant: with fewer, a single outlier could imitate a warm-up
POINTS = 3


def settling(channels, tau):
    """Return ``exp(-t/τ)`` at the n samples of a log, (n,).

    t is the time since the start of the log, s, in the Channels `channels`, and τ is the time
    constant `tau`, s.
    """
    return np.exp(-channels.t / tau)


@dataclass(frozen=True)
class WarmUp(Effect):
    """``e_i = A_i exp(-t/τ)``: after power-on the bias settles exponentially, τ in s.

    t is the time since the start of each log. If the power was on for the time t_on before the log,
    A_i has already decayed by the factor exp(-t_on/τ); t_on is taken as the same in all sessions.
    Leaves this trace: the means of poses are wrong in the first minutes, and right later. Imitated
    by: `bias_temperature`, if the thermometer shows the same warming; `bias_drift`, if τ is as long
    as the log.
    """

    tau: float = SETTLING[0]

    name = "warm_up"
    parameters = per_axis({"A": "output"})
    reference = "IEEE Std 528-2001, warm-up time"
    records = ("poses", "static_record")
    after_temperature = True

    @classmethod
    def variants(cls, channels):
        """Return the variants of the effect to try, a tuple: one for each visible time constant τ.

        τ can be seen if the record, the Channels `channels`, is at least `SETTLINGS` times as long
        as τ and has at least `POINTS` points in its first 2 τ. If no τ can be seen, the tuple has
        only the variant with the default τ.
        """
        with_points = [tau for tau in SETTLING if np.sum(channels.t < 2 * tau) >= POINTS]
        longest = np.ptp(channels.t) / SETTLINGS
        return tuple(cls(tau) for tau in with_points if tau <= longest) or (cls(),)

    def design(self, channels):
        """Return the derivative of e with respect to A, ``exp(-t/τ)`` on each axis, (n, 3, 3).

        e is the error of the class' equation, and A has its parameters. At a pose the result is the
        mean over the samples of the pose. Its axes are: n points of `channels`, axis of the sensor,
        parameter.
        """
        return on_each_axis(channels.evaluate(settling, self.tau))


class BiasDrift(Effect):
    """``e_i = d_i t``: the bias drifts linearly with the time t from the start of each log.

    Leaves this trace: an error of the means over poses grows with time in every attitude. Imitated
    by: `bias_temperature`, if the temperature only rises or falls; a long `warm_up`; and random
    walk, which the test allows for as part of the noise. In a static record the effect is called
    `ramp`.
    """

    name = "bias_drift"
    parameters = per_axis({"d": "output per s"})
    reference = "IEEE Std 952-1997, annex C, rate ramp"
    after_temperature = True

    def design(self, channels):
        """Return the derivative of e with respect to d, the time t, s, on each axis, (n, 3, 3).

        e is the error of the class' equation, and d has its parameters. The axes of the result are:
        n points of `channels`, axis of the sensor, parameter.
        """
        return on_each_axis(channels.t)


class Ramp(BiasDrift):
    """``e_i = d_i t``: the drift of the bias in a static record; at poses it is `bias_drift`.

    t is the time since the start of the log.
    Leaves this trace: the mean of the output changes linearly. Imitated by: `bias_temperature`, if
    the temperature only rises or falls; a long `warm_up`; and random walk, which the test allows
    for as part of the noise.
    """

    name = "ramp"
    records = ("static_record",)
    lasting = False
