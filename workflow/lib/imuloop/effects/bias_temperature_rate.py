"""A bias that follows the rate of the temperature: lag, and gradients in the housing."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.memory import first_order_lag, in_pieces
from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.effects.thermometer import temperature

# s; half decades, so that a true lag is at most a factor 1.8 from one that is tried and their
# responses correlate by 2 √1.8/(1 + 1.8) = 0.96. From a package's (seconds) to a housing's lag
LAGS = (10.0, 30.0, 100.0, 300.0, 1000.0)
# relaxation times that a record must hold; with fewer the lag is hardly known from θ itself
RELAXATIONS = 3


@in_pieces
def lagged_rate(channels, tau):
    """Return ``(θ - θ_lag)/τ`` of a whole log, K/s, shape (n,): the lagged dθ/dt."""
    warm = temperature(channels)
    return (warm - first_order_lag(channels.t, warm, tau, channels.past)) / tau


@dataclass(frozen=True)
class BiasTemperatureRate(Effect):
    """``e_i = r_i (θ - θ_lag)/τ``: the bias follows dθ/dt, seen through a first-order lag τ in s.

    ``τ dθ_lag/dt = θ - θ_lag``, in equilibrium at the start of the log. Beside a
    `bias_temperature` c1 (θ - θ0) a sensor that lags behind the thermometer has r = -c1 τ exactly,
    a thermometer that lags behind the sensor r of the sign of c1, a gradient across the housing
    any. Leaves: branches of heating and cooling that differ while the temperature moves, and no
    more once it rests. Imitated by: `thermal_hysteresis`, whose branches stay apart at rest too.
    """

    tau: float = LAGS[0]

    name = "bias_temperature_rate"
    parameters = per_axis({"r": "output per K/s"})
    equation = "e_i = r_i (θ - θ_lag)/τ"
    reference = "Kim and Jung, Sensors 25 (2025) 6131, bias against the rate of temperature"
    timed = True
    needs = ("temperature",)

    @classmethod
    def shapes(cls, channels):
        """Return the lags of which the data hold several."""
        longest = np.ptp(channels.t) / RELAXATIONS
        return tuple(cls(tau) for tau in LAGS if tau <= longest) or (cls(),)

    def design(self, channels):
        """Return the lagged rate of temperature on each axis, shape (n, 3, 3)."""
        return on_each_axis(channels.remembered(lagged_rate, self.tau))
