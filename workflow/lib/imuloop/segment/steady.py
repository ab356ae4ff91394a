"""Slow turns and tremor inside rests, compared with the device's other rests."""

import numpy as np
from scipy.ndimage import maximum_filter1d

from imuloop.core.stretches import divided, lengths
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
# scales that fit into a part, of windows of 1 s
SCALES = 8


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
    parts = [divided(i, j, int(np.ceil((j - i) * step / PART))) for i, j in rests]
    parts = np.concatenate([np.empty((0, 2), dtype=int), *parts])
    unsteady, rounding = np.zeros(w.shape[1], dtype=bool), rounding_variance(w.T)
    window = max(2, round(FINEST * settings.window_s / step))
    while True:
        long = parts[lengths(parts) >= FEWEST_OF_A_PART * window]
        # separate windows, less one for each part, whose median is taken
        freedom = int((lengths(long) // window - 1).sum())
        if freedom < FEWEST:
            break
        means = [sliding_statistics(w[:, i:j].T, window)[0] for i, j in long]
        x = np.concatenate([mean - np.median(mean, axis=0) for mean in means])
        # a mean of samples that flip between two steps varies by a quarter of a step squared, / n
        floor = np.full(3, 3 * rounding / window)
        covariance = robust_covariance(x[:: len(x) // MOST + 1], floor, tail_limit=1.0)
        bound = distance_beyond(settings.false_alarm / SCALES / len(x), 3, freedom)
        unsteady[np.r_[*(slice(i, j) for i, j in long)]] |= squared_distance(x, covariance) > bound
        window *= 2
    guard = round(settings.window_s / 8 / step)
    return maximum_filter1d(unsteady, 2 * guard + 1) if len(parts) else unsteady
