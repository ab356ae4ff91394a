"""Slow turns and tremor inside rests, compared with the device's other rests."""

import numpy as np
from scipy.special import ndtri, stdtrit

from imuloop.segment.disturbance import distance_beyond, robust_covariance, squared_distance
from imuloop.segment.windows import rounding_variance, sliding_statistics

# longer rests are judged in parts of this length, s: over more, a bias that warms up moves
PART = 10.0
# fewest windows free to vary that determine the level of rest
FEWEST = 20
# quartile of the normal distribution, standard deviations
QUARTILE = ndtri(0.75)
# windows that a part of a rest has to hold to be judged on their scale
FEWEST_OF_A_PART = 3


def shortest_half(x):
    """Return centre and standard deviation of values by their densest half.

    References
    ----------
    Rousseeuw, Leroy, "Robust regression and outlier detection", 1987, section 4.2 (the shortest
    half, least median of squares of a location).
    """
    x = np.sort(x)
    half = len(x) // 2 + 1
    first = int(np.argmin(x[half - 1 :] - x[: len(x) - half + 1]))
    low, high = x[first], x[first + half - 1]
    return (low + high) / 2, (high - low) / (2 * QUARTILE)


def unsteady_samples(w, rests, step, settings):
    """Return the samples of rests that turn slowly or tremble.

    A slow turn about the vertical leaves specific force where it was, and in the mean over a rest
    it is the same as a bias, or a g-sensitivity. So only what changes **inside** a rest counts, in
    two statistics of the angular rate:

    - turning: the mean over a window, less the median of all such means in the rest. Windows of
      `window_s`/2, twice that and so on up to a third of a rest are compared with their own
      covariance over all rests, on each scale for itself, so that coloured noise widens it as it
      should. Hotelling's T², less a degree of freedom for each rest, whose median was taken.
    - trembling: the logarithm of the variance in a window of `window_s`/2, summed over the axes.
      Its centre and spread over all rests come from the densest half of them; the spread is never
      below the √(2/3n) of white noise.

    Both are right as long as more than half of the time at rest is spent out of the hand. In an
    undisturbed session of Gaussian noise anything at all is cut with the probability `false_alarm`,
    shared among the statistics and all samples (Bonferroni, so right for any correlation). Takes
    angular rate, rad/s, (3, n), ranges of samples at rest and the median step of time, s; gives a
    mask, (n,).
    """
    parts = [part for i, j in rests for part in _parts(i, j, step)]
    window = max(2, round(settings.window_s / 2 / step))
    scales = []
    while _freedom(parts, window) >= FEWEST:
        scales.append(window)
        window *= 2
    unsteady = np.zeros(w.shape[1], dtype=bool)
    if not scales:
        return unsteady
    probability = settings.false_alarm / (len(scales) + 1)
    rounding = rounding_variance(w.T)

    for window in scales:
        long = [slice(i, j) for i, j in parts if j - i >= FEWEST_OF_A_PART * window]
        means = [sliding_statistics(w[:, each].T, window)[0] for each in long]
        x = np.concatenate([mean - np.median(mean, axis=0) for mean in means])
        # a mean of samples that flip between two steps varies by a quarter of a step squared, / n
        covariance = robust_covariance(x, np.full(3, 3 * rounding / window), tail_limit=1.0)
        bound = distance_beyond(probability / len(x), 3, _freedom(parts, window))
        unsteady[np.r_[*long]] |= squared_distance(x, covariance) > bound

    window = scales[0]
    long = [slice(i, j) for i, j in parts if j - i >= window]
    variances = [sliding_statistics(w[:, each].T, window)[1].sum(axis=1) for each in long]
    x = np.log(np.concatenate(variances) + 9 * rounding)
    centre, spread = shortest_half(x)
    m = sum((each.stop - each.start) // window for each in long)
    bound = max(spread, np.sqrt(2 / (3 * window))) * -stdtrit(m - 1, probability / len(x))
    unsteady[np.r_[*long]] |= x > centre + bound
    return unsteady


def _freedom(parts, window):
    """Return the number of separate windows, less one for each part, of parts that hold some."""
    return sum((j - i) // window - 1 for i, j in parts if j - i >= FEWEST_OF_A_PART * window)


def _parts(i, j, step):
    """Return a rest in parts of `PART` or a sample at most, as even as can be."""
    count = min(j - i, max(1, int(np.ceil((j - i) * step / PART))))
    parts = np.array_split(np.arange(i, j), count)
    return [(int(part[0]), int(part[-1]) + 1) for part in parts]
