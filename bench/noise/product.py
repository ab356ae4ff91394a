"""The product's estimator, as all parts of the bench call it."""

from functools import cache

from imuloop.noise.allan import allan_table, allan_variance, averaging_factors
from imuloop.noise.axis import estimate_axis
from imuloop.noise.curve_covariance import curve_covariance, degrees_of_freedom
from imuloop.noise.layout import Layout
from imuloop.noise.modes import modes
from imuloop.noise.settings import NoiseSettings

SETTINGS = NoiseSettings()
TERMS = "QNBKR"


def estimate(x, rate):
    """Return the AxisNoise of one record without gaps."""
    return estimate_axis(*_basis(len(x), rate), [[x]], SETTINGS).noise


@cache
def _basis(n, rate):
    layouts = [Layout(rate, (0,), (n,), (0,))]
    return layouts, modes(layouts)


@cache
def curve(n, rate):
    """Return the averaging factors of a record of `n` samples and the covariance of its curve."""
    factors = averaging_factors(n, SETTINGS)
    return factors, curve_covariance(factors, [n], rate)


def values(noise):
    """Return the identifiable coefficients of an AxisNoise by letter."""
    found = {name: getattr(noise, name) for name in TERMS}
    return {name: c.value for name, c in found.items() if c.identifiable}


def curve_table(x, rate):
    """Return the rows of allan.parquet of one record, its intervals from the fitted model."""
    factors, spread = curve(len(x), rate)
    tau = factors / rate
    edf = degrees_of_freedom(estimate(x, rate), tau, spread)
    return allan_table("ax", tau, allan_variance([x], factors), edf)
