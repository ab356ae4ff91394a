"""Effects of the temperature on bias and scale factor, with lag or hysteresis."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import filled
from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.effects.filters import first_order_lag, play
from imuloop.model.effect import Effect

# temperature at which data sheets give bias and scale factor, degC
ROOM = 25.0
# step of a thermometer of whole degrees, or error of one on a chip, K
LEAST_SPAN = 1.0
# limits of a reference temperature, degC
CELSIUS = (-273.15, 1000.0)


def _has_temperature(channels):
    """Return whether the Channels `channels` have a temperature at any point."""
    return channels.temperature is not None and bool(np.isfinite(channels.temperature).any())


def temperature(channels):
    """Return the temperature at n points of Channels, degC, (n,); missing values are interpolated.

    `channels` are the Channels. Raises an ImuloopError if no temperature was logged.
    """
    if not _has_temperature(channels):
        raise ImuloopError("an effect of temperature needs a temperature, and none was logged")
    return filled(channels.t, np.asarray(channels.temperature, dtype=float))


def whole_degrees(channels):
    """Return the mean temperature, rounded to whole degrees, degC, for use as a reference.

    `channels` are the Channels that have the temperature.
    """
    return float(np.round(temperature(channels).mean()))


def span(channels):
    """Return the largest temperature minus the smallest, K; zero if none was logged.

    `channels` are the Channels that may have a temperature.
    """
    return float(np.ptp(temperature(channels))) if _has_temperature(channels) else 0.0


# lags to try, s, of a thermometer on the chip, next to it, on the board or on the housing. They
# differ by the root of two, so that the error of a lag is not taken for another effect; the lag is
# then fitted between them
THERMOMETER_LAGS = (10.0, 14.0, 20.0, 28.0, 40.0, 57.0, 80.0, 113.0, 160.0, 226.0, 320.0)
# amount by which a lag has to lower the logarithm of the p-value, as it is one more constant: it
# does so by chance in one of some 70 logs
PRICE_OF_A_LAG = 3.0
# ratio of a smoothing time to the lag of a thermometer. To undo the lag multiplies the noise by the
# inverse of this ratio
SMOOTHED = 0.1
# least length of a record in lags: in a shorter one the lagged temperature is too similar to θ
RELAXATIONS = 3


def undo_lag(channels, lag):
    """Return the temperature without the lag of the thermometer, degC, (n,).

    `channels` are the Channels of n samples. Their thermometer reads θ; it has a first-order lag of
    `lag`, s. The result is ``θ_s = θ_l + (θ - θ_l)/a``. Here a is `SMOOTHED`, and θ_l is the
    response to θ of a first-order lag of the time a · lag. For changes slower than a · lag the
    result is ``θ + lag dθ/dt``, the inverse of the thermometer's lag.
    """
    warm = temperature(channels)
    smooth = first_order_lag(channels.t, warm, SMOOTHED * lag)
    return smooth + (warm - smooth) / SMOOTHED


# least span of the temperature for each order, K: over a smaller span a quadratic polynomial is
# nearly linear. The distance of a parabola from its chord, c2 span²/8, is 1 % of c1 span for
# c2/c1 = 1/50 per K, the median of twelve axes in two recordings
SPAN_OF_AN_ORDER = 5.0


@dataclass(frozen=True)
class BiasTemperature(Effect):
    """``e_i = Σ_k c_ki (θ - θ0)^k``, k = 1 … order: the bias is a polynomial of the temperature θ.

    The order is at most 3, as in thermal calibration of MEMS sensors. θ0 is the reference, degC. θ
    is the reading of the thermometer. If the thermometer has a first-order `lag`, s, θ is its
    reading without this lag.
    Leaves this trace: the bias follows θ(t) on every axis, in every attitude, whether θ rises or
    falls. Imitated by: a drift and a warm-up, if θ only rises or only falls (so they are tested
    after the temperature); a hysteresis, if θ turns (a hysteresis differs between rise and fall).
    """

    order: int = 1
    reference_temperature: float = ROOM
    lag: float = 0.0

    name = "bias_temperature"
    reference = "Niu et al., Sensors 13 (2013) 12192, thermal calibration"
    records = ("poses", "static_record")
    bounds = {"order": (1, 3), "reference_temperature": CELSIUS, "lag": (0.0, 1e5)}
    needs = ("temperature",)

    @property
    def timed(self):
        """Whether the thermometer has a lag, so that the effect depends on earlier samples."""
        return self.lag > 0

    @property
    def price(self):
        """Number that is added to the logarithm of the p-value for a lag; 0 without a lag.

        A variant with a lag has one more constant, so it fits the data better by chance alone. The
        variant with the smallest sum is chosen, so a lag has to lower the logarithm by more than
        this number.
        """
        return PRICE_OF_A_LAG if self.lag else 0.0

    @property
    def parameters(self):
        """Units of the parameters by name: c1 of each axis, then c2, then c3, up to the order.

        ``output`` stands for the SI unit of the sensor.
        """
        powers = {f"c{k}": f"output per K^{k}" for k in range(2, self.order + 1)}
        return per_axis({"c1": "output per K"} | powers)

    @classmethod
    def variants(cls, channels):
        """Return the variants of the effect to try, a tuple, with different orders and lags.

        `channels` are the Channels of the data. The order, 1 to 3, grows with the span of the
        temperature. Each order is tried without lag, and with each lag that is shorter than the
        data.
        """
        orders = 1 + min(2, int(span(channels) / SPAN_OF_AN_ORDER))
        reference = whole_degrees(channels)
        lags = (0.0, *(lag for lag in THERMOMETER_LAGS if lag <= np.ptp(channels.t)))
        return tuple(
            cls(order=k, reference_temperature=reference, lag=lag)
            for lag in lags
            for k in range(1, orders + 1)
        )

    def design(self, channels):
        """Return the derivative of e with respect to c, powers of θ - θ0, K^k, (n, 3, 3 order).

        e is the error of the class' equation, with the parameters c, the temperature θ and its
        reference θ0. The axes of the result are: n points of `channels`, axis of the sensor,
        parameter.
        """
        warm = channels.evaluate_memory(undo_lag, self.lag) if self.lag else temperature(channels)
        warmer = warm - self.reference_temperature
        return on_each_axis(*(warmer**k for k in range(1, self.order + 1)))

    def clamped(self, design, low, high):
        """Return the derivative with the temperature θ - θ0 clamped to a range, (n, 3, 3 order).

        `design`, (n, 3, 3 order), is the derivative: n points, axis of the sensor, parameter. `low`
        and `high`, (3 order,), are the ends of the ranges of its columns in the data of the fit.
        Only the first three columns, θ - θ0 on each axis, are clamped. The higher powers are
        computed from the clamped θ - θ0, because from an even power it cannot be seen which end of
        the range θ has left.
        """
        warmer = super().clamped(design[:, :, :3], low[:3], high[:3])
        return np.concatenate([warmer**k for k in range(1, self.order + 1)], axis=2)


@dataclass(frozen=True)
class ScaleTemperature(Effect):
    """``e_i = sT_i (θ - θ0) y_i``: the scale factor is linear in the temperature θ.

    y is the output, θ0 the reference, degC.
    Leaves this trace: an error follows θ(t) on loaded axes only: the vertical axis of an
    accelerometer at rest, the axis about which a gyroscope turns. Imitated by: `bias_temperature`,
    if the attitude, or the turn, is always the same.
    """

    reference_temperature: float = ROOM

    name = "scale_temperature"
    parameters = per_axis({"sT": "1 per K"})
    reference = "Niu et al., Sensors 13 (2013) 12192, thermal calibration"
    records = ("poses", "static_record")
    bounds = {"reference_temperature": CELSIUS}
    needs = ("temperature",)
    # ten times what data sheets of MEMS sensors state, some 300 ppm/K
    limit = 3e-3

    @classmethod
    def variants(cls, channels):
        """Return the one variant of the effect to try, a tuple.

        Its reference is the mean temperature in the Channels `channels` of the data.
        """
        return (cls(whole_degrees(channels)),)

    def design(self, channels):
        """Return the derivative of e with respect to sT, (θ - θ0) y on each axis, (n, 3, 3).

        e is the error of the class' equation, with the parameters sT, the temperature θ, its
        reference θ0 and the output y. The axes of the result are: n points of `channels`, axis of
        the sensor, parameter.
        """
        warmer = temperature(channels) - self.reference_temperature
        return on_each_axis(warmer[:, None] * channels.output)


# lags to try, s, from the lag of a package (seconds) to the lag of a housing. They differ by half a
# decade: a true lag is within a factor of 1.8, and responses correlate by 2 √1.8/(1 + 1.8) = 0.96
LAGS = (10.0, 30.0, 100.0, 300.0, 1000.0)


def lagged_rate(channels, tau):
    """Return the lagged rate of change of the temperature at the n samples of a log, K/s, (n,).

    It is ``(θ - θ_lag)/τ``. θ is the temperature in the Channels `channels`, and θ_lag is the
    response to it of a first-order lag with the time constant τ, `tau`, s.
    """
    warm = temperature(channels)
    return (warm - first_order_lag(channels.t, warm, tau)) / tau


@dataclass(frozen=True)
class BiasTemperatureRate(Effect):
    """``e_i = r_i (θ - θ_lag)/τ``: the bias follows the rate dθ/dt after a first-order lag τ, s.

    θ_lag follows the temperature θ by ``τ dθ_lag/dt = θ - θ_lag`` and equals it at the start of the
    log. The sign of r may show the cause, if there is also a `bias_temperature` c1 (θ - θ0): a
    sensor that lags behind the thermometer has r = -c1 τ; a thermometer that lags behind the sensor
    gives r the sign of c1. A gradient across the housing may cause any r.
    Leaves this trace: biases differ between heating and cooling, and agree when the temperature is
    constant. Imitated by: `thermal_hysteresis`, whose difference remains at a constant temperature.
    """

    tau: float = LAGS[0]

    name = "bias_temperature_rate"
    parameters = per_axis({"r": "output per K/s"})
    reference = "Kim and Jung, Sensors 25 (2025) 6131, bias against the rate of temperature"
    records = ("poses", "static_record")
    after_temperature = True
    needs = ("temperature",)

    @classmethod
    def variants(cls, channels):
        """Return the variants of the effect to try, a tuple: one for each lag that is short enough.

        `channels` are the Channels of the data. If they are too short for any lag, the tuple has
        the variant with the default lag.
        """
        longest = np.ptp(channels.t) / RELAXATIONS
        return tuple(cls(tau) for tau in LAGS if tau <= longest) or (cls(),)

    def design(self, channels):
        """Return the derivative of e with respect to r, ``(θ - θ_lag)/τ``, K/s, (n, 3, 3).

        e is the error of the class' equation, with the parameters r, the temperature θ and its
        lagged response θ_lag. The axes of the result are: n points of `channels`, axis of the
        sensor, parameter.
        """
        return on_each_axis(channels.evaluate_memory(lagged_rate, self.tau))


# half-widths to try, shares of the span of the temperature: loops with steep ends, with round ends,
# and one that barely closes (at 1/2 the temperature does not cross it)
SHARES = (0.05, 0.15, 0.4)


def hysteresis_state(channels, half_width):
    """Return the state of a thermal hysteresis at the n samples of a log, (n,), from -1 to 1.

    It is ``(θ - play θ)/w``: 1 in long heating, -1 in long cooling. θ is the temperature in the
    Channels `channels`. play θ is a point that is dragged by two walls at the distance w,
    `half_width`, K, on either side of θ.
    """
    warm = temperature(channels)
    return (warm - play(warm, half_width)) / half_width


@dataclass(frozen=True)
class ThermalHysteresis(Effect):
    """``e_i = h_i (θ - play_w θ)/w``: the bias depends on whether the temperature θ rose or fell.

    play_w θ is a point that is dragged by two walls at the distance w, K, on either side of θ. So
    the factor (θ - play_w θ)/w is 0 at the start of the log, 1 in long heating and -1 in long
    cooling. After θ turns, the factor changes its sign within 2 w; at a constant temperature it
    stays. The biases in heating and in cooling differ by 2 h_i.
    Leaves this trace: the bias over the temperature has two branches. Imitated by:
    `bias_temperature_rate`, if the temperature always changes at one speed; `bias_temperature` and
    `bias_drift`, if it never turns.
    """

    half_width: float = 5.0

    name = "thermal_hysteresis"
    parameters = per_axis({"h": "output"})
    reference = "Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, play operator"
    records = ("poses", "static_record")
    bounds = {"half_width": (1e-3, 1e3)}
    after_temperature = True
    needs = ("temperature",)

    @classmethod
    def variants(cls, channels):
        """Return the variants of the effect to try, a tuple with a few half-widths.

        They are the `SHARES` of the span of the temperature in the Channels `channels`.
        """
        widths = {max(round(share * span(channels), 2), 0.01) for share in SHARES}
        return tuple(cls(width) for width in sorted(widths))

    def design(self, channels):
        """Return the derivative of e with respect to h, ``(θ - play_w θ)/w``, (n, 3, 3).

        e is the error of the class' equation, which defines play_w θ and the parameters h. The axes
        of the result are: n points of `channels`, axis of the sensor, parameter.
        """
        return on_each_axis(channels.evaluate_memory(hysteresis_state, self.half_width))
