"""What views.parquet holds of a record beside its Allan curve."""

import numpy as np

from imuloop.core.tables import joined, table
from imuloop.noise.allan import averaging_factors, interval
from imuloop.noise.deviations import (
    DEVIATIONS,
    deviation_interval,
    deviation_variance,
    m_sample_variance,
)
from imuloop.noise.spectrum import autocorrelation, power_spectrum

# columns of views.parquet
COLUMNS = ("view", "axis", "x", "value", "ci_low", "ci_high")
# what each is, so that no two of them are taken for the same figure
WORDS = {
    "psd": "Power spectral density, one-sided: Welch with a Hann window, 95 % by chi-square",
    "autocorrelation": "Autocorrelation about the mean of each stretch; the band is that of white "
    "noise, 95 %",
    "total": "Total deviation: the ends continued by reflection; under flicker and walk below the "
    "Allan deviation at long times",
    "modified": "Modified Allan deviation: tells quantisation from white noise of the integral; "
    "not the Allan deviation, below it for white noise",
    "hadamard": "Hadamard deviation: blind to a constant drift; not the Allan deviation",
    "m_sample": "M-sample deviation: of M consecutive averages; the Allan deviation for M = 2 only",
}


def label(view):
    """Return the words for a view of views.parquet, 'm_sample_3' among them."""
    name, _, samples = view.partition("m_sample_")
    return WORDS[name] if name else WORDS["m_sample"].replace("M", samples, 2)


def empty():
    """Return a table of views.parquet without rows."""
    return table(COLUMNS, "", "", *[[]] * 4)


def representations(rate, stretches, axis, settings):
    """Return the rows of views.parquet of one axis of one session.

    x: frequency (Hz), lag or averaging time (s). value: SI^2/Hz, 1, or a deviation in SI. 95 %
    interval of the value; for the autocorrelation, which has none that holds under any noise, the
    band in which white noise would lie; not-a-number for the M-sample deviation.
    Takes the rate, Hz, and the output of each stretch, finite, SI.
    """
    asked = dict.fromkeys([*settings.views, *(f"m_sample_{m}" for m in settings.m_samples)])
    rows = ((view, _columns(view, rate, stretches, settings)) for view in asked)
    return joined([empty(), *(table(COLUMNS, view, axis, *each) for view, each in rows)])


def _columns(view, rate, stretches, settings):
    """Return x, value, ci_low and ci_high of one view."""
    if view == "psd":
        frequency, density, edf = power_spectrum(stretches, rate)
        return frequency, density, *interval(density, edf)
    if view == "autocorrelation":
        lags, value, pairs = autocorrelation(stretches)
        band = 1.96 / np.sqrt(pairs)
        return lags / rate, value, -band, band
    lengths = [len(x) for x in stretches]
    factors = averaging_factors(max(lengths), settings)
    if view in DEVIATIONS:
        variance = deviation_variance(view, stretches, factors)
        low, high = deviation_interval(view, lengths, factors, variance)
    else:
        variance = m_sample_variance(stretches, factors, int(view.rpartition("_")[2]))
        low = high = np.full(len(factors), np.nan)
    found = np.isfinite(variance)
    roots = (np.sqrt(each[found]) for each in (variance, low, high))
    return factors[found] / rate, *roots
