"""Other views of a static record: power spectral density, autocorrelation, other deviations."""

from functools import cache

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from imuloop.core.tables import joined, table
from imuloop.noise import allan
from imuloop.noise.allan import averaging_factors
from imuloop.noise.deviations import (
    hadamard_variance,
    interval,
    m_sample_variance,
    modified_variance,
    total_variance,
)

# columns of views.parquet
COLUMNS = ("view", "axis", "x", "value", "ci_low", "ci_high")
# what each view is, so that no two of them are taken for the same figure
VIEWS = {
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
DEVIATIONS = {
    "total": total_variance,
    "modified": modified_variance,
    "hadamard": hadamard_variance,
}
# points of a spectrum, lags of an autocorrelation
POINTS = 300
LAGS = 200
# lag up to this share of the longest stretch
LAG_SHARE = 0.1
# up to three lengths of the segments, each this much shorter than the one before, none below 64
SHORTER, SHORTEST = 64, 64
# periods a segment that a frequency has at least where a longer segment is at hand
PERIODS = 16
# longest transform of a segment; samples that are transformed at a time; shortest block of lags
TRANSFORM, PIECE, BLOCK = 1 << 17, 1 << 16, 1 << 15


def label(view):
    """Return the words for a view of views.parquet, 'm_sample_3' among them."""
    name, _, samples = view.partition("m_sample_")
    return VIEWS[name] if name else VIEWS["m_sample"].replace("M", samples, 2)


def views(layout, values, axis, settings):
    """Return the views of one axis of one session.

    Parameters
    ----------
    layout : Layout or Record
        Rate and lengths of the clean stretches.
    values : sequence of array_like, shape (n_s,)
        Output of each stretch, finite, SI.
    axis : str
        Name of the axis.
    settings : NoiseSettings
        Which views, and the averaging times of the deviations.

    Returns
    -------
    dict of ndarray
        Columns `COLUMNS`. x: frequency (Hz), lag or averaging time (s). value: SI^2/Hz, 1, or a
        deviation in SI. 95 % interval of the value; for the autocorrelation, which has none that
        holds under any noise, the band in which white noise would lie; not-a-number for the
        M-sample deviation.
    """
    asked = dict.fromkeys([*settings.views, *(f"m_sample_{m}" for m in settings.m_samples)])
    tables = [table(COLUMNS, view, axis, *_view(view, layout, values, settings)) for view in asked]
    return joined([empty(), *tables])


def empty():
    """Return a table of views without rows."""
    return table(COLUMNS, "", "", *[[]] * 4)


def _view(view, layout, values, settings):
    """Return x, value, ci_low and ci_high of one view."""
    if view == "psd":
        frequency, density, edf = power_spectrum(values, layout.rate)
        return frequency, density, *allan.interval(density, edf)
    if view == "autocorrelation":
        lags, value, pairs = autocorrelation(values)
        band = 1.96 / np.sqrt(pairs)
        return lags / layout.rate, value, -band, band
    factors = averaging_factors(max(layout.lengths), settings)
    if view in DEVIATIONS:
        variance = DEVIATIONS[view](values, factors)
        low, high = interval(view, layout.lengths, factors, variance)
    else:
        variance = m_sample_variance(values, factors, int(view.rpartition("_")[2]))
        low = high = np.full(len(factors), np.nan)
    found = np.isfinite(variance)
    roots = (np.sqrt(each[found]) for each in (variance, low, high))
    return factors[found] / layout.rate, *roots


def power_spectrum(stretches, rate):
    r"""Return the one-sided power spectral density by Welch's method, pooled over stretches.

    Segments half overlap and never reach over a cut. Low frequencies come from long segments,
    high ones from short segments, of which there are more and in stretches of any length.
    Neighbouring frequencies are averaged in logarithmic bins. With w the Hann window, the
    coefficients at k and k + d of two segments s samples apart have the squared correlation

    .. math:: \rho^2_{s d} = \Big| \sum_t w_t w_{t+s} e^{-2\pi i d t/L} \Big|^2
        \Big/ \Big(\sum_t w_t^2\Big)^2

    for noise that is white within a bin, and a mean over n values has the degrees of freedom
    2 n^2 over the sum of that over all pairs.

    Parameters
    ----------
    stretches : sequence of array_like, shape (n_s,)
        Evenly sampled output, any unit.
    rate : float
        Sampling rate, Hz.

    Returns
    -------
    frequency : ndarray, shape (k,)
        Hz, ascending, at most `POINTS`, without the two lowest and the Nyquist frequency of a
        segment; empty where no stretch has 16 samples.
    density : ndarray, shape (k,)
        Unit of the output squared per Hz.
    edf : ndarray, shape (k,)
        Equivalent degrees of freedom.

    References
    ----------
    P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967), 70-73.
    """
    lengths = segment_lengths(max(map(len, stretches)))
    if not lengths:
        return np.empty(0), np.empty(0), np.empty(0)
    edges = np.geomspace(1.5 * rate / lengths[0], rate / 2, POINTS + 1)
    rows, last = [], POINTS
    for length in reversed(lengths):
        longest = length == lengths[0]
        first = 0 if longest else int(np.searchsorted(edges, PERIODS * rate / length))
        density, segments, overlaps = _welch(stretches, rate, length)
        index = np.ceil(edges * length / rate).astype(int)
        for k in range(last - 1, first - 1, -1):
            i, j = index[k], min(index[k + 1], length // 2)
            if i < j:
                edf = _freedom(j - i, segments, overlaps)
                rows.append(((i + j - 1) / 2 * rate / length, density[i:j].mean(), edf))
        last = first
    return tuple(np.array(rows[::-1]).T)


def segment_lengths(longest):
    """Return lengths of segments, powers of 2: from half the longest stretch, where it has 16."""
    if longest < 16:
        return []
    length = 1 << (int(longest // 2).bit_length() - 1)
    shorter = [length // SHORTER**i for i in (1, 2)]
    return [length, *(each for each in shorter if each >= SHORTEST)]


def _welch(stretches, rate, length):
    """Return the density pooled over stretches, the segments, and the pairs that overlap.

    Of segments beyond `TRANSFORM` samples only the lowest share 1 / (2 * 128) of the frequencies
    is asked for: triangular means leave an alias of 1e-8 there, and their own response is undone.
    """
    divisor = max(1, length // TRANSFORM)
    length //= divisor
    step, window = length // 2, hann(length)
    total, segments, overlaps = np.zeros(step + 1), 0, 0
    for stretch in stretches:
        x = np.asarray(stretch) if divisor == 1 else _triangular_means(stretch, divisor)
        count = max(0, (len(x) - length) // step + 1)
        at_once = max(1, PIECE // length)
        for i in range(0, count, at_once):
            j = min(i + at_once, count)
            each = np.lib.stride_tricks.sliding_window_view(x[i * step : (j + 1) * step], length)
            each = each[::step] - each[::step].mean(axis=1, keepdims=True)
            each *= window
            spectrum = rfft(each, axis=1)
            total += (spectrum.real**2 + spectrum.imag**2).sum(axis=0)
        segments += count
        overlaps += max(0, count - 1)
    density = total * 2 * divisor / (rate * (window @ window) * segments)
    phase = np.pi * np.arange(1, step + 1) / length
    density[1:] /= (np.sin(phase) / (divisor * np.sin(phase / divisor))) ** 4
    return density, segments, overlaps


def hann(length):
    """Return a period of the Hann window, shape (length,)."""
    return 0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, length, endpoint=False))


def _triangular_means(x, divisor):
    """Return means of 2 * divisor samples weighted by a triangle, one each divisor samples."""
    blocks = np.asarray(x)[: len(x) // divisor * divisor].reshape(-1, divisor)
    rising = (np.arange(divisor) + 0.5) / divisor**2
    return blocks[:-1] @ rising + blocks[1:] @ rising[::-1]


@cache
def _freedom(frequencies, segments, overlaps):
    """Return the degrees of freedom of a mean over neighbouring frequencies and all segments."""
    distance = np.arange(min(frequencies, len(SAME)))
    pairs = np.where(distance > 0, 2, 1) * (frequencies - distance)
    correlated = segments * (pairs @ SAME[distance]) + 2 * overlaps * (pairs @ NEXT[distance])
    return 2 * (frequencies * segments) ** 2 / correlated


def _squared_correlation(shift, length=64):
    """Return the squared correlation of coefficients d = 0, 1, ... apart, `shift` segments on."""
    window = hann(length)
    step = int(shift * length)
    product = window[step:] * window[: length - step]
    return np.abs(rfft(product, length) / (window @ window))[: length // 4] ** 2


# the same segment, and the one half a segment on
SAME, NEXT = _squared_correlation(0.0), _squared_correlation(0.5)


def autocorrelation(stretches):
    r"""Return the autocorrelation about the mean of each stretch, pooled over stretches.

    .. math:: \rho_k = \frac{\sum_s \sum_t y_{s,t}\, y_{s,t+k} / n_k}
        {\sum_s \sum_t y_{s,t}^2 / n_0},\quad n_k = \sum_s \max(0, n_s - k)

    Taking the mean off lowers it by about the variance of that mean over the variance.

    Parameters
    ----------
    stretches : sequence of array_like, shape (n_s,)
        Evenly sampled output, any unit.

    Returns
    -------
    lags : ndarray of int, shape (k,)
        At most `LAGS`, log-spaced up to a tenth of the longest stretch; empty where the output is
        constant or has under 10 samples a stretch.
    value : ndarray, shape (k,)
        1 at lag 0, which is left out.
    pairs : ndarray of int, shape (k,)
        n_k.
    """
    lengths = np.array([len(x) for x in stretches])
    longest = int(lengths.max() * LAG_SHARE)
    lags = np.unique(np.rint(np.geomspace(1, max(longest, 1), LAGS)).astype(int))[:longest]
    products, power = np.zeros(len(lags)), 0.0
    for x in stretches:
        at_zero, at_lags = _lagged_products(np.asarray(x), lags)
        power += at_zero
        products += at_lags
    if not power:
        lags, products = lags[:0], products[:0]
    pairs = np.maximum(lengths[:, None] - lags, 0).sum(axis=0)
    return lags, products / pairs / (power / lengths.sum() if power else 1.0), pairs


def _lagged_products(x, lags):
    """Return the sums of y_t y_{t+k} at k = 0 and at the lags, y = x without its mean."""
    at_lags = np.zeros(len(lags))
    if not len(lags) or np.ptp(x) == 0:
        return 0.0, at_lags
    mean, reach = x.mean(), min(lags[-1], len(x) - 1)
    # each block against itself and the next, which stands half a transform on: exp(-i pi k)
    block = next_fast_len(max(int(reach), BLOCK), real=True)
    sign = (-1.0) ** np.arange(block + 1)
    spectrum, before = np.zeros((2, block + 1), dtype=complex)
    for i in range(0, len(x), block):
        here = rfft(x[i : i + block] - mean, 2 * block)
        spectrum += here.real**2 + here.imag**2
        before *= here
        spectrum += before
        before = np.conj(here) * sign
    products = irfft(spectrum, 2 * block)
    inside = lags <= reach
    at_lags[inside] = products[lags[inside]]
    return products[0], at_lags
