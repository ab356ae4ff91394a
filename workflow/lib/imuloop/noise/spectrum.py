"""Power spectral density of an axis whose record may be cut into stretches."""

import numpy as np
from scipy.fft import rfft

from imuloop.core.tables import table
from imuloop.noise.allan import interval

# columns of spectra.parquet
COLUMNS = ("axis", "frequency_hz", "psd", "ci_low", "ci_high")
# bins of a spectrum, at most
POINTS = 300
# samples that the longest stretch needs for a spectrum
FEWEST = 16
# squared correlation, under the Hann window, of coefficients that lie 0, 1, 2, 3 apart: within a
# segment, and between two segments half a segment apart
SAME, NEXT = np.array([[1, 4 / 9, 1 / 36, 0], [1 / 36, 0.020014, 1 / 144, 0.0008]])


def no_spectrum():
    """Return a table with the columns of spectra.parquet and without rows."""
    return table(COLUMNS, "", *[[]] * 4)


def spectrum_table(axis, stretches, rate):
    r"""Return the one-sided power spectral density of an axis by Welch's method, as a table.

    A segment has half the samples of the longest stretch, rounded down to a power of two. Segments
    overlap by half, and none reaches over the end of a stretch. Neighbouring frequencies are
    averaged in logarithmic bins. The interval of a density follows from a chi-square distribution
    with

    .. math:: \nu = 2 n^2 / \sum_{i, j} \rho^2_{ij}, \quad
        \rho^2_{ij} = \Big| \sum_t w_t w_{t+s} e^{-2\pi i d t/L} \Big|^2
        \Big/ \Big(\sum_t w_t^2\Big)^2

    degrees of freedom. n is the number of squared coefficients in a bin, from all segments of L
    samples. The sum is over all pairs i, j of them. The two coefficients of a pair lie d
    frequencies and s samples apart, and :math:`\rho^2` is their squared correlation in white noise.
    w is the Hann window.

    Parameters
    ----------
    axis : str
        Name of the axis.
    stretches : sequence of ndarray
        Output of the axis in each stretch, a range of samples that are evenly spaced, SI, finite.
    rate : float
        Sampling rate, Hz.

    Returns
    -------
    dict of ndarray
        The columns of spectra.parquet: frequencies in Hz, ascending, without the two lowest and
        without half the rate; densities in SI^2/Hz, and the ends of their 95 % intervals. There are
        at most `POINTS` rows, and none if all stretches are shorter than `FEWEST` samples.

    References
    ----------
    P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967), 70-73.
    """
    longest = max(map(len, stretches))
    if longest < FEWEST:
        return no_spectrum()
    length = 1 << (int(longest // 2).bit_length() - 1)
    half, segments, overlaps = length // 2, 0, 0
    window, total = np.hanning(length + 1)[:-1].astype(np.float32), np.zeros(half)
    # values of size one suit single precision; its rounding is 14 decades below the variance
    size = max(map(np.ptp, stretches)) or 1.0
    for x in stretches:
        starts = range(0, len(x) - length + 1, half)
        for i in starts:
            part = x[i : i + length]
            part = ((part - part.mean()) / size).astype(np.float32)
            # scipy.signal.welch takes four times as long
            transform = rfft(part * window)[:half]
            total += transform.real**2 + transform.imag**2
        segments += len(starts)
        overlaps += max(len(starts) - 1, 0)
    edges = np.unique(np.ceil(np.geomspace(1.5, half, POINTS + 1)).astype(int))
    first, count = edges[:-1], np.diff(edges)
    frequency = (first + (count - 1) / 2) * rate / length
    density = 2 * (size / segments) * (size / rate) * total / (window @ window)
    density = np.add.reduceat(density, first) / count
    # number of pairs of coefficients in each bin, by the distance of the two frequencies
    distance = np.arange(len(SAME))
    pairs = np.where(distance > 0, 2, 1) * np.maximum(count[:, None] - distance, 0)
    correlated = segments * (pairs @ SAME) + 2 * overlaps * (pairs @ NEXT)
    edf = 2 * (count * segments) ** 2 / correlated
    return table(COLUMNS, axis, frequency, density, *interval(density, edf))
