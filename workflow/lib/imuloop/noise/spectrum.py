"""Power spectral density of records that may be cut into stretches."""

from functools import cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import rfft

from imuloop.core.tables import table
from imuloop.noise.allan import interval

# columns of spectra.parquet
COLUMNS = ("axis", "frequency_hz", "psd", "ci_low", "ci_high")
# points of a spectrum
POINTS = 300
# up to three lengths of the segments, each this much shorter than the one before, none below 64
SHORTER, SHORTEST = 64, 64
# periods per segment that a frequency has at least where a longer segment is at hand
PERIODS = 16
# samples that are transformed at a time, or one segment
PIECE = 1 << 16
# squared correlation, by the Hann window, of coefficients d = 0, 1, ... apart: of a segment with
# itself, and with that half a segment on
SAME, NEXT = np.array([[1, 4 / 9, 1 / 36, 0], [1 / 36, 0.020014, 1 / 144, 0.0008]])


def spectrum_table(axis, stretches, rate):
    """Return the rows of spectra.parquet of one axis: SI^2/Hz with its 95 % interval.

    By chi-square; takes the output of each stretch, finite, SI, and the rate, Hz.
    """
    frequency, density, edf = power_spectrum(stretches, rate)
    return table(COLUMNS, axis, frequency, density, *interval(density, edf))


def no_spectrum():
    """Return a table of spectra.parquet without rows."""
    return table(COLUMNS, "", *[[]] * 4)


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

    Returns
    -------
    frequency, density, edf : ndarray, shape (k,)
        Hz, ascending, at most `POINTS`, without the two lowest and the Nyquist frequency of a
        segment; unit of the output squared per Hz; and equivalent degrees of freedom. Empty where
        no stretch has 16 samples.

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
        density, segments, overlaps = _pooled_welch(stretches, rate, length)
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


def _pooled_welch(stretches, rate, length):
    """Return the density pooled over stretches, the segments, and the pairs that overlap.

    In single precision, whose rounding lies 14 decades below the variance.
    """
    window, total, segments, overlaps = _window(length), 0.0, 0, 0
    at_once = max(1, PIECE // length)
    for x in (x for x in stretches if len(x) >= length):
        each, size = sliding_window_view(x, length)[:: length // 2], np.ptp(x) or np.float64(1)
        for i in range(0, len(each), at_once):
            part = each[i : i + at_once]
            part = (part - part.mean(axis=1, keepdims=True)) / size
            transform = rfft(part.astype(np.float32) * window)
            total += size**2 * (transform.real**2 + transform.imag**2).sum(axis=0)
        segments += len(each)
        overlaps += len(each) - 1
    return 2 * total / (rate * segments * (window @ window)), segments, overlaps


@cache
def _window(length):
    """Return the periodic Hann window."""
    return np.hanning(length + 1)[:-1].astype(np.float32)


def _freedom(frequencies, segments, overlaps):
    """Return the degrees of freedom of a mean over neighbouring frequencies and all segments."""
    distance = np.arange(min(frequencies, len(SAME)))
    pairs = np.where(distance > 0, 2, 1) * (frequencies - distance)
    correlated = segments * (pairs @ SAME[distance]) + 2 * overlaps * (pairs @ NEXT[distance])
    return 2 * (frequencies * segments) ** 2 / correlated
