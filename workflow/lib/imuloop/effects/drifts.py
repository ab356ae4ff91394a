"""A bias that changes slowly with time: linearly, after power-on, or randomly."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis

# s; a factor 3.4 apart, so that a true one is at most 1.85 from one that is tried; from a chip
# on its board to a closed housing
SETTLING = (30.0, 100.0, 350.0, 1200.0)
# settling times that a record must hold: with less, an exponential is nearly a straight line
SETTLINGS = 2
# points within twice the time constant, without which it would be an outlier's second name
POINTS = 3


def settling(channels, tau):
    """Return ``exp(-t/τ)`` of a whole log, shape (n,)."""
    return np.exp(-channels.t / tau)


@dataclass(frozen=True)
class WarmUp(Effect):
    """``e_i = A_i exp(-t/τ)``: after power-on the bias settles exponentially, τ in s.

    t counts from the start of each log: one that starts t_on after the power has the amplitude
    A exp(-t_on/τ); several sessions are taken to start alike.
    Leaves: first poses and minutes off, later ones not. Imitated by: `bias_temperature`, if the
    thermometer shows the same warming; `bias_drift` where τ is as long as the log.
    """

    tau: float = SETTLING[0]

    name = "warm_up"
    parameters = per_axis({"A": "output"})
    equation = "e_i = A_i exp(-t/τ)"
    reference = "IEEE Std 528-2001, warm-up time"
    timed = True
    after_temperature = True

    @classmethod
    def shapes(cls, channels):
        """Return the time constants that the data span several times, with several points each."""
        several = [tau for tau in SETTLING if np.sum(channels.t < 2 * tau) >= POINTS]
        longest = np.ptp(channels.t) / SETTLINGS
        return tuple(cls(tau) for tau in several if tau <= longest) or (cls(),)

    def design(self, channels):
        """Return the exponential on each axis, its mean over a pose, shape (n, 3, 3)."""
        return on_each_axis(channels.evaluate(settling, self.tau))


class BiasDrift(Effect):
    """``e_i = d_i t``: the bias drifts linearly from the start of each log.

    Leaves: an error of pose means that grows with time whatever the attitude. Imitated by:
    `bias_temperature` where the temperature only rises or falls, a long `warm_up`, and the noise's
    own random walk, which the floor holds. In a static record the same term is called `ramp`.
    """

    name = "bias_drift"
    parameters = per_axis({"d": "output per s"})
    equation = "e_i = d_i t"
    reference = "IEEE Std 952-1997, annex C, rate ramp"
    timed = True
    after_temperature = True
    records = ("poses",)

    def design(self, channels):
        """Return the time on each axis, shape (n, 3, 3)."""
        return on_each_axis(channels.t)


class Ramp(BiasDrift):
    """``e_i = d_i t``: between poses this is `bias_drift`.

    Leaves: levels that change evenly. Imitated by: `bias_temperature` where the temperature only
    rises or falls, a long `warm_up`, and random walk, which the noise of the test allows for.
    """

    name = "ramp"
    records = ("static_record",)
    lasting = False
