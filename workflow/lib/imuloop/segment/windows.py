"""Windows: sliding mean and variance in time proportional to the number of samples."""

import numpy as np

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
    out = np.empty((2, *x.shape))
    # the first whole window is centred on this sample
    first = n // 2
    for statistic, y in zip(out, (x, x * x), strict=True):
        windows = statistic[first : first + len(x) - n + 1]
        np.divide(_window_sums(y, n), n, out=windows)
        statistic[:first], statistic[first + len(windows) :] = windows[0], windows[-1]
    mean, variance = out
    variance -= mean * mean
    np.maximum(variance, 0.0, out=variance)
    mean += offset
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


def _window_sums(y, n):
    """Return the sum of each window of `n` values, shape (m - n + 1, …), from those within alone.

    A running sum, as of scipy's `uniform_filter1d`, would lose its digits after one value that is
    far too large; the variance of pandas' `rolling` is 2 % off in a rest after fast turns. Here a
    window, which lies in two blocks of n, is the end of one and the begin of the next.
    """
    count = len(y) - n + 1
    blocks = np.zeros((len(y) // n + 1, n, *y.shape[1:]))
    flat = blocks.reshape(-1, *y.shape[1:])
    flat[: len(y)] = y
    ends = np.cumsum(blocks[:, ::-1], axis=1)[:, ::-1]
    # what begins with a block ends with it
    np.cumsum(blocks, axis=1, out=blocks)
    blocks[:, -1] = 0.0
    return ends.reshape(flat.shape)[:count] + flat[n - 1 : n - 1 + count]


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
