"""Windows: sliding mean and variance in time proportional to the number of samples."""

import numpy as np

# samples that decide on the resolution of a sensor
DECIDING = 1_000_000


def sliding_statistics(x, n):
    """Return mean and variance of the window of `n` samples centred on each sample.

    Differences of cumulative sums of x and x², taken after the mean is removed so that little is
    lost in the difference. Within half a window of an end the first or last whole window counts.

    Parameters
    ----------
    x : array_like, shape (m,) or (m, k)
        Samples, m >= n.
    n : int
        Window length, samples.

    Returns
    -------
    mean, variance : ndarray, shape of x
        Unit of x, and its square.
    """
    offset = np.mean(x, axis=0)
    x = x - offset
    out = np.empty((2, *x.shape))
    # the first whole window is centred on this sample
    first = n // 2
    for statistic, y in zip(out, (x, x * x), strict=True):
        total = np.concatenate([np.zeros((1, *x.shape[1:])), np.cumsum(y, axis=0)])
        windows = statistic[first : first + len(x) - n + 1]
        np.subtract(total[n:], total[:-n], out=windows)
        windows /= n
        statistic[:first], statistic[first + len(windows) :] = windows[0], windows[-1]
    mean, variance = out
    variance -= mean * mean
    np.maximum(variance, 0.0, out=variance)
    mean += offset
    return mean, variance


def rounding_variance(x):
    """Return the variance that rounding to the sensor's resolution adds to one axis.

    The resolution is the smallest step between samples that is no rounding of the number format;
    one that never moves has none, and any positive variance then serves as a floor.

    Parameters
    ----------
    x : array_like, shape (m, 3)
        Samples of one sensor; the first million decide.
    """
    x = x[:DECIDING]
    steps = np.abs(np.diff(x, axis=0))
    steps = steps[steps > 1e-9 * np.max(np.abs(x), initial=0.0)]
    return steps.min() ** 2 / 12 if steps.size else 1.0
