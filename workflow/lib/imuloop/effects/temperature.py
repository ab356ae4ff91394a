"""Temperature: bias and scale factor follow it, with lag or hysteresis."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import filled
from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.effects.filters import first_order_lag, play

# degC, at which data sheets give bias and scale factor
ROOM = 25.0
# K; one step of a thermometer of whole degrees, or the error of one on a chip, is as much
LEAST_SPAN = 1.0
# degC, between which a reference can lie
CELSIUS = (-273.15, 1000.0)


def _logged(channels):
    return channels.temperature is not None and bool(np.isfinite(channels.temperature).any())


def temperature(channels):
    """Return the temperature, degC, gaps filled on a line or held; ImuloopError without one."""
    if not _logged(channels):
        raise ImuloopError("an effect of temperature needs a temperature, and none was logged")
    return filled(channels.t, np.asarray(channels.temperature, dtype=float))


def whole_degrees(channels):
    """Return a reference near the middle of the data, degC: their mean, rounded."""
    return float(np.round(temperature(channels).mean()))


def span(channels):
    """Return the largest temperature less the smallest, K; zero where none was logged."""
    return float(np.ptp(temperature(channels))) if _logged(channels) else 0.0


# s; a thermometer on the chip, beside it, on the board, on the housing; by the root of two, so that
# what a true lag leaves is no other effect, and then fitted between them
THERMOMETER_LAGS = (10.0, 14.0, 20.0, 28.0, 40.0, 57.0, 80.0, 113.0, 160.0, 226.0, 320.0)
# a thermometer is on time unless data say otherwise: the lag is one more constant, and chance
# lowers the logarithm of a p-value by so much in one of some 70 logs
PRICE_OF_A_LAG = 3.0
# share of a thermometer's lag by which what it lacks is smoothed: its noise grows by the inverse
SMOOTHED = 0.1
# relaxation times that a record must hold; with fewer the lag is hardly known from θ itself
RELAXATIONS = 3


def ahead(channels, lag):
    """Return the temperature that a thermometer lags behind by ``lag``, degC, shape (n,).

    ``θ_s = θ_l + (θ - θ_l)/a``, θ_l the reading θ after a lag of a lag, a = `SMOOTHED`: the inverse
    ``θ + lag dθ/dt`` of a first-order lag for all that is slower than a lag.
    """
    warm = temperature(channels)
    smooth = first_order_lag(channels.t, warm, SMOOTHED * lag)
    return smooth + (warm - smooth) / SMOOTHED


# K; over less a curved line is straight: it leaves its chord by c2 span²/8, 1 % of c1 span with
# c2/c1 = 1/50 per K, the median of twelve axes in two recordings
SPAN_OF_AN_ORDER = 5.0


@dataclass(frozen=True)
class BiasTemperature(Effect):
    """``e_i = Σ_k c_ki (θ - θ0)^k``, k = 1 … order: the bias is a polynomial of the temperature θ.

    Order 3 at most, what thermal calibration of MEMS sensors uses; θ0 is the reference in degC. θ
    is the reading of the thermometer or, where that is late by a `lag` in s, first order, what it
    is late behind: at a steady temperature both are the same.
    Leaves: a bias that copies θ(t), the same way up as down, on every axis whatever its load.
    Imitated by: a drift and a warm-up where θ only rises or only falls: a temperature that is
    logged goes before them. A hysteresis where it turns (it differs on the two branches).
    """

    order: int = 1
    reference_temperature: float = ROOM
    lag: float = 0.0

    name = "bias_temperature"
    equation = "e_i = Σ_k c_ki (θ - θ0)^k"
    reference = "Niu et al., Sensors 13 (2013) 12192, thermal calibration"
    bounds = {"order": (1, 3), "reference_temperature": CELSIUS, "lag": (0.0, 1e5)}
    needs = ("temperature",)

    @property
    def timed(self):
        """Whether the thermometer lags, so that the past counts."""
        return self.lag > 0

    @property
    def price(self):
        """By how much a lag has to lower the logarithm of the p-value."""
        return PRICE_OF_A_LAG if self.lag else 0.0

    @property
    def parameters(self):
        """Names and units, first all axes of order 1."""
        powers = {f"c{k}": f"output per K^{k}" for k in range(2, self.order + 1)}
        return per_axis({"c1": "output per K"} | powers)

    @classmethod
    def shapes(cls, channels):
        """Return orders 1 to 3, as many as the span of temperature can carry, without and with lag.

        Lags that the data are as long as.
        """
        if not span(channels):
            return (cls(),)
        orders = 1 + min(2, int(span(channels) / SPAN_OF_AN_ORDER))
        about = whole_degrees(channels)
        lags = (0.0, *(lag for lag in THERMOMETER_LAGS if lag <= np.ptp(channels.t)))
        return tuple(cls(k, about, lag) for lag in lags for k in range(1, orders + 1))

    def design(self, channels):
        """Return the powers of the temperature on each axis, shape (n, 3, 3 order)."""
        warm = channels.evaluate_memory(ahead, self.lag) if self.lag else temperature(channels)
        warmer = warm - self.reference_temperature
        return on_each_axis(*(warmer**k for k in range(1, self.order + 1)))

    def clamped(self, design, low, high):
        """Return the powers of the clamped temperature; an even power alone would lose its sign."""
        first = super().clamped(design[:, :, :3], low[:3], high[:3])
        return np.concatenate([first**k for k in range(1, self.order + 1)], axis=2)


@dataclass(frozen=True)
class ScaleTemperature(Effect):
    """``e_i = sT_i (θ - θ0) y_i``: the scale factor is a straight line of the temperature θ.

    θ0 is the reference in degC. Leaves: an error that copies θ(t) on loaded axes alone, so at rest
    on the accelerometer's vertical one, and in a gyroscope's turns.
    Imitated by: `bias_temperature` where the attitude, or the turn, is always the same.
    """

    reference_temperature: float = ROOM

    name = "scale_temperature"
    parameters = per_axis({"sT": "1 per K"})
    equation = "e_i = sT_i (θ - θ0) y_i"
    reference = "Niu et al., Sensors 13 (2013) 12192, thermal calibration"
    bounds = {"reference_temperature": CELSIUS}
    needs = ("temperature",)
    # ten times what data sheets of MEMS sensors state, some 300 ppm/K
    limit = 3e-3

    @classmethod
    def shapes(cls, channels):
        """Return the one shape, about the mean temperature."""
        return (cls(whole_degrees(channels)),) if span(channels) else (cls(),)

    def design(self, channels):
        """Return each axis' own output times the temperature, shape (n, 3, 3)."""
        warmer = temperature(channels) - self.reference_temperature
        return on_each_axis(warmer[:, None] * channels.output)


# s; half decades, so that a true lag is at most a factor 1.8 from one that is tried and their
# responses correlate by 2 √1.8/(1 + 1.8) = 0.96. From a package's (seconds) to a housing's lag
LAGS = (10.0, 30.0, 100.0, 300.0, 1000.0)


def lagged_rate(channels, tau):
    """Return ``(θ - θ_lag)/τ`` of a whole log, K/s, shape (n,): the lagged dθ/dt."""
    warm = temperature(channels)
    return (warm - first_order_lag(channels.t, warm, tau)) / tau


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
    after_temperature = True
    needs = ("temperature",)

    @classmethod
    def shapes(cls, channels):
        """Return the lags that the data span several times."""
        longest = np.ptp(channels.t) / RELAXATIONS
        return tuple(cls(tau) for tau in LAGS if tau <= longest) or (cls(),)

    def design(self, channels):
        """Return the lagged rate of temperature on each axis, shape (n, 3, 3)."""
        return on_each_axis(channels.evaluate_memory(lagged_rate, self.tau))


# half-widths as shares of the span: a loop with steep ends, a rounder one, and one that only just
# closes (at 1/2 no turn of the temperature is long enough to cross it)
SHARES = (0.05, 0.15, 0.4)


def branch(channels, half_width):
    """Return ``(θ - play θ)/w`` of a whole log, shape (n,): 1 while heating on, -1 cooling on."""
    warm = temperature(channels)
    return (warm - play(warm, half_width)) / half_width


@dataclass(frozen=True)
class ThermalHysteresis(Effect):
    """``e_i = h_i (θ - play_w θ)/w``: the bias depends on the direction from which θ came.

    play_w is dragged along between two walls w (the half-width, K) on either side of θ: the bracket
    is 1 while heating goes on, -1 while cooling does, 0 at the log's start, and crosses over within
    2 w of a turning point. At rest it stays. 2 h_i is the opening of the loop.
    Leaves: two branches of bias over temperature. Imitated by: `bias_temperature_rate` where the
    temperature always moves at one speed; `bias_temperature` and `bias_drift` where it never turns.
    """

    half_width: float = 5.0

    name = "thermal_hysteresis"
    parameters = per_axis({"h": "output"})
    equation = "e_i = h_i (θ - play_w θ)/w"
    reference = "Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, play operator"
    bounds = {"half_width": (1e-3, 1e3)}
    timed = True
    after_temperature = True
    needs = ("temperature",)

    @classmethod
    def shapes(cls, channels):
        """Return half-widths that are shares of the span of the temperature, in 10 mK."""
        widths = {max(round(share * span(channels), 2), 0.01) for share in SHARES}
        return tuple(cls(w) for w in sorted(widths)) if span(channels) else (cls(),)

    def design(self, channels):
        """Return the branch on each axis, shape (n, 3, 3)."""
        return on_each_axis(channels.evaluate_memory(branch, self.half_width))
