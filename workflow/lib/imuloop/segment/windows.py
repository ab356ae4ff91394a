"""Means and variances in sliding windows, and means over blocks of samples."""

import numpy as np
from scipy.ndimage import uniform_filter1d

from imuloop.core.samples import CHANNELS, sums_over

# number of samples, from the start, that determine the resolution of a sensor
DECIDING = 1_000_000


def sliding_statistics(x, n):
    """Return the mean and the variance in a window of `n` samples about each sample, both (m, …).

    `x`, (m, …), has m samples in any unit, at least n of them; further axes are kept. Within half a
    window of either end, the first or the last whole window is used. The variance is the mean of x²
    less the square of the mean of x. To keep rounding errors of this difference small, the median
    is subtracted from x first.
    """
    offset = np.median(x, axis=0)
    x = x - offset
    mean, variance = (uniform_filter1d(y, n, axis=0) for y in (x, x * x))
    variance -= mean * mean
    np.maximum(variance, 0.0, out=variance)
    mean += offset
    # sample at the centre of the first window, and one after the centre of the last
    first, last = n // 2, n // 2 + len(x) - n
    for statistic in (mean, variance):
        statistic[:first], statistic[last:] = statistic[first], statistic[last]
    return mean, variance


def block_means(rows, ranges, width):
    """Return the means of the six channels over blocks of `width` consecutive samples.

    `rows` are Samples, and `ranges`, (m, 2), are half-open ranges of their rows, which are divided
    into blocks. Samples at the end of a range that do not fill a block are left out.

    Returns
    -------
    first : ndarray of int, shape (k,)
        First row of each of the k blocks.
    blocks : ndarray of int, shape (m, 2)
        For each range, the index of its first block among the k blocks, and one more than the index
        of its last block.
    means : ndarray, shape (k, 6)
        Means, SI.
    """
    blocks = [np.arange(i, j - width + 1, width) for i, j in ranges]
    edges = np.cumsum([0, *map(len, blocks)])
    first = np.concatenate([np.empty(0, dtype=int), *blocks])
    rows_of_block = np.column_stack([first, first + width])
    means = np.column_stack([sums_over(rows[name], rows_of_block) for name in CHANNELS]) / width
    return first, np.column_stack([edges[:-1], edges[1:]]), means


def rounding_variance(x):
    """Return the variance that rounding adds to one axis of a sensor, a float.

    The variance is a twelfth of the squared resolution. `x`, (m, 3), are m samples of the three
    axes, in any unit. The resolution is the smallest change between two consecutive samples;
    changes below 1e-9 of the value are ignored as rounding of floating-point numbers. Only the
    first million samples are searched. If the values never change, the resolution is not known. The
    result is then 1: callers use it as the least variance of a channel, and without changes they
    only need that it is not zero.
    """
    x = x[:DECIDING]
    steps, size = np.abs(np.diff(x, axis=0)), np.abs(x)
    is_change = steps > 1e-9 * np.maximum(size[1:], size[:-1])
    resolution = steps.min(where=is_change, initial=np.inf)
    return resolution**2 / 12 if resolution < np.inf else 1.0
