"""Windows: sliding mean and variance in time proportional to the number of samples."""

import numpy as np
from scipy.ndimage import uniform_filter1d

from imuloop.core.samples import CHANNELS, sums_over

# samples that decide on the resolution of a sensor
DECIDING = 1_000_000


def sliding_statistics(x, n):
    """Return mean and variance of the window of `n` samples centred on each sample of x, (m, …).

    Sums of x and x², the median removed so that little is lost in their difference. Within half a
    window of an end the first or last whole window counts; m is at least n.
    """
    offset = np.median(x, axis=0)
    x = x - offset
    mean, variance = (uniform_filter1d(y, n, axis=0) for y in (x, x * x))
    variance -= mean * mean
    np.maximum(variance, 0.0, out=variance)
    mean += offset
    # the first whole window is centred on this sample
    first, last = n // 2, n // 2 + len(x) - n
    for statistic in (mean, variance):
        statistic[:first], statistic[last:] = statistic[first], statistic[last]
    return mean, variance


def block_means(rows, ranges, width):
    """Return the means of all channels over whole blocks of `width` samples within ranges.

    Takes Samples and ranges of rows, (m, 2). Gives the first row of each block, (k,), the blocks of
    each range, (m, 2), and the means, SI, (k, 6).
    """
    blocks = [np.arange(i, j - width + 1, width) for i, j in ranges]
    edges = np.cumsum([0, *map(len, blocks)])
    first = np.concatenate([np.empty(0, dtype=int), *blocks])
    whole = np.column_stack([first, first + width])
    means = np.column_stack([sums_over(rows[name], whole) for name in CHANNELS]) / width
    return first, np.column_stack([edges[:-1], edges[1:]]), means


def rounding_variance(x):
    """Return the variance that rounding to the sensor's resolution adds to one axis of x, (m, 3).

    The resolution is the smallest step between the first million samples that is no rounding of
    their number format; one that never moves has none, and any positive variance then serves.
    """
    x = x[:DECIDING]
    steps, size = np.abs(np.diff(x, axis=0)), np.abs(x)
    true = steps > 1e-9 * np.maximum(size[1:], size[:-1])
    resolution = steps.min(where=true, initial=np.inf)
    return resolution**2 / 12 if resolution < np.inf else 1.0
