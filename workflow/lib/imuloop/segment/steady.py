"""Slow turns and tremor inside rests, compared with the device's other rests."""

from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d

from imuloop.segment.disturbance import MOST, distance_beyond, robust_covariance, squared_distance
from imuloop.segment.windows import rounding_variance, sliding_statistics

# longer rests are judged in parts of this length, s: over more, a bias that warms up moves
PART = 10.0
# fewest windows free to vary that determine the level of rest
FEWEST = 20
# windows that a part of a rest has to hold to be judged on their scale
FEWEST_OF_A_PART = 3
# shortest window, of `window_s`; it is twice as long on each next scale
FINEST = 1 / 32


def unsteady_samples(w, rests, step, settings):
    """Return the samples of rests that turn slowly or tremble.

    A slow turn about the vertical leaves specific force where it was, and in the mean over a rest
    it is the same as a bias, or a g-sensitivity. So only what changes **inside** a rest counts: the
    mean of the angular rate over a window, less the median of all such means in the rest. Windows
    of every length up to a third of a rest are compared with their own covariance over all rests,
    on each scale for itself, so that coloured noise widens it as it should: by Hotelling's T², less
    a degree of freedom for each rest, whose median was taken. A tremor shows in short windows, a
    slow turn in long ones. Around each such window an eighth of `window_s` is unsteady as well.

    It is right as long as more than half of the time at rest is spent out of the hand. In an
    undisturbed session of Gaussian noise anything at all is cut with the probability `false_alarm`,
    shared among the scales and all samples (Bonferroni, so right for any correlation). Takes
    angular rate, rad/s, (3, n), ranges of samples at rest and the median step of time, s; gives a
    mask, (n,).
    """
    parts = [part for i, j in rests for part in _parts(i, j, step)]
    window, scales = max(2, round(FINEST * settings.window_s / step)), []
    while _freedom(parts, window) >= FEWEST:
        scales.append(window)
        window *= 2
    unsteady, rounding = np.zeros(w.shape[1], dtype=bool), rounding_variance(w.T)
    for window in scales:
        long = [slice(i, j) for i, j in parts if j - i >= FEWEST_OF_A_PART * window]
        means = [sliding_statistics(w[:, each].T, window)[0] for each in long]
        x = np.concatenate([mean - np.median(mean, axis=0) for mean in means])
        # a mean of samples that flip between two steps varies by a quarter of a step squared, / n
        floor = np.full(3, 3 * rounding / window)
        covariance = robust_covariance(x[:: len(x) // MOST + 1], floor, tail_limit=1.0)
        probability = settings.false_alarm / len(scales) / len(x)
        bound = distance_beyond(probability, 3, _freedom(parts, window))
        unsteady[np.r_[*long]] |= squared_distance(x, covariance) > bound
    guard = round(settings.window_s / 8 / step)
    return maximum_filter1d(unsteady, 2 * guard + 1)


def _freedom(parts, window):
    """Return the number of separate windows, less one for each part, of parts that hold some."""
    return sum((j - i) // window - 1 for i, j in parts if j - i >= FEWEST_OF_A_PART * window)


def _parts(i, j, step):
    """Return a rest in parts of `PART` or a sample at most, as even as can be."""
    edges = np.linspace(i, j, min(j - i, max(1, int(np.ceil((j - i) * step / PART)))) + 1)
    return list(pairwise(edges.astype(int).tolist()))
