"""Windows: sliding mean and variance in time proportional to the number of samples."""

import numpy as np
from scipy.ndimage import uniform_filter1d

from imuloop.core.samples import CHANNELS, sums_over

# number of samples, from the start, that determine the resolution of a sensor
DECIDING = 1_000_000


def sliding_statistics(x, n):
    """Return mean and variance in the window of `n` samples about each sample of x, (m, …) each.

    x has m samples, at least n. Within half a window of either end, the first or the last window is
    used. The variance is the mean of x² less the square of the mean of x; the median is subtracted
    from x first, so that rounding does not matter.
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
    """Return the means of all channels over consecutive blocks of `width` samples within ranges.

    Takes Samples and ranges of rows, (m, 2). Samples at the end of a range that fill no block do
    not count.

    Returns
    -------
    first : ndarray of int, shape (k,)
        First row of each block.
    blocks : ndarray of int, shape (m, 2)
        Range of the blocks of each range of rows.
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

    Takes the m samples of the three axes of the sensor, x, (m, 3). The variance is a twelfth of the
    squared resolution. The resolution is the smallest step between the first million samples that
    is larger than the rounding of their number format. If the values never change, there is no such
    step; the result is then 1, as any positive variance will do.
    """
    x = x[:DECIDING]
    steps, size = np.abs(np.diff(x, axis=0)), np.abs(x)
    is_change = steps > 1e-9 * np.maximum(size[1:], size[:-1])
    resolution = steps.min(where=is_change, initial=np.inf)
    return resolution**2 / 12 if resolution < np.inf else 1.0
