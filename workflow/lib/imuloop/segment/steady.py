"""Slow turns and tremor inside rests, found by comparison with all rests of the session."""

import numpy as np
from scipy.ndimage import maximum_filter1d

from imuloop.core.stretches import divided, lengths
from imuloop.segment.disturbance import (
    MOST,
    robust_covariance,
    squared_distance,
    squared_distance_limit,
)
from imuloop.segment.windows import rounding_variance, sliding_statistics

# length of the parts of a rest that are judged, s: in longer parts the bias may drift by warm-up
PART = 10.0
# fewest degrees of freedom of the windows that determine the covariance at rest
FEWEST = 20
# fewest windows of a part of a rest that is judged on a scale
FEWEST_OF_A_PART = 3
# shortest window, share of `window_s`; each scale has windows twice as long as the scale before
FINEST = 1 / 32
# number of scales, lengths of windows, that fit into a part if `window_s` is 1 s
SCALES = 8


def unsteady_samples(w, rests, step, settings):
    """Return at which samples of rests the device turns slowly or trembles, a mask, (n,).

    Each rest is divided into parts of at most `PART` seconds. A slow turn about the vertical does
    not change the specific force, and its mean rate cannot be told from a bias or a g-sensitivity.
    So only changes within a part count: the mean angular rate over a window, minus the median of
    these means over the part. A tremor shows in short windows, a slow turn in long ones.

    The windows have many lengths, up to a third of a part. The means over windows of one length are
    compared with their own covariance over all rests, so that coloured noise is allowed for. The
    test is Hotelling's T², with one degree of freedom less for each part, as its median is
    subtracted. An eighth of `window_s` before and after a marked window is marked as well. Samples
    outside all rests are not marked.

    The covariance is correct if the device is in the hand for less than half of the time at rest.
    In a session of Gaussian noise, the probability that any sample is marked is `false_alarm`; it
    is shared among all lengths and samples (Bonferroni), and so holds for any correlation.

    Parameters
    ----------
    w : ndarray, shape (3, n)
        Angular rate, rad/s.
    rests : ndarray of int, shape (m, 2)
        Ranges of samples of the rests.
    step : float
        Median time step, s.
    settings : SegmentSettings
        Shortest window and false alarm rate.
    """
    parts = [divided(i, j, int(np.ceil((j - i) * step / PART))) for i, j in rests]
    parts = np.concatenate([np.empty((0, 2), dtype=int), *parts])
    unsteady, rounding = np.zeros(w.shape[1], dtype=bool), rounding_variance(w.T)
    window = max(2, round(FINEST * settings.window_s / step))
    while True:
        long = parts[lengths(parts) >= FEWEST_OF_A_PART * window]
        # number of windows that do not overlap, less one for the median of each part
        freedom = int((lengths(long) // window - 1).sum())
        if freedom < FEWEST:
            break
        means = [sliding_statistics(w[:, i:j].T, window)[0] for i, j in long]
        # one row for each sample of the long parts: the change of the mean in the window about it
        x = np.concatenate([mean - np.median(mean, axis=0) for mean in means])
        # variance of a mean of samples that alternate between two levels: a quarter step², over n
        floor = np.full(3, 3 * rounding / window)
        covariance = robust_covariance(x[:: len(x) // MOST + 1], floor, tail_limit=1.0)
        bound = squared_distance_limit(settings.false_alarm / SCALES / len(x), 3, freedom)
        samples = np.r_[*(slice(i, j) for i, j in long)]
        unsteady[samples] |= squared_distance(x, covariance) > bound
        window *= 2
    guard = round(settings.window_s / 8 / step)
    return maximum_filter1d(unsteady, 2 * guard + 1) if len(parts) else unsteady
