"""Static detector: rests by windowed variance and mean rate of both sensors.

Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration without
external equipments", ICRA 2014, section IV-A. The paper takes the root of the sum of the squared
variances of the axes, which depends on how the sensor's frame lies; their sum, taken here, does
not, and a multiple of it means the same.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import chdtri

from imuloop.core.stretches import lengths, stretches_of
from imuloop.segment.windows import block_means, rounding_variance, sliding_statistics

# multiples of the level of both variances up to which a window is at rest: a hand that trembles is
# found later; and up to which it is quiet enough to set the gyroscope's bias
MULTIPLES, QUIET = (10, 300), (10, 10)
# samples of a rest: the variance of fewer says nothing of its mean's error
FEWEST_SAMPLES = 4
# rests from which on a rate that they share is the gyroscope's bias, and share of their windows
# that may be away from it
RESTS_OF_A_BIAS, FEW = 3, 0.1
# change of the mean specific force from one window to the next that is motion, m/s²: 10 mg
FORCE_TOLERANCE = 0.1
# cut from each end of a rest that touches motion, and short means by which it is then widened, s
TRIM_S, EDGE_S = 0.05, 0.1


@dataclass(frozen=True)
class Activity:
    """Windowed variances and mean rate about each sample."""

    # (2, n): sums over the axes of accelerometer and gyroscope, of their level at rest; infinite
    # where no whole window fits between two long gaps, or the accelerometer reads zero
    variances: np.ndarray
    rate: np.ndarray  # (3, n): windowed mean, rad/s
    window: int  # samples

    def within(self, multiples):
        """Return whether both variances are within multiples of their levels, shape (n,)."""
        return np.all(self.variances <= np.reshape(multiples, (2, 1)), axis=0)

    def away(self, biases):
        """Return how far the mean rate is from the nearest of biases, (k, 3), rad/s, (n,)."""
        return np.min([np.linalg.norm(self.rate.T - bias, axis=1) for bias in biases], axis=0)


def activity(force, rate, stretches, window):
    """Return the Activity of a session; no window reaches across a long gap.

    The level of a sensor at rest is the 5 % quantile of its windowed variance, the median of the
    quietest tenth: right as long as a tenth of the log is at rest. None is below the variance of
    rounding. Takes specific force, m/s², and angular rate, rad/s, shape (3, n), the stretches
    between long gaps, and the window's length, samples.
    """
    variances, means = np.full((2, force.shape[1]), np.inf), np.zeros_like(rate)
    for i, j in stretches[lengths(stretches) >= window]:
        # one axis at a time, as a log of hours takes memory
        variances[:, i:j] = 0.0
        for f, w, mean in zip(force, rate, means, strict=True):
            variances[0, i:j] += sliding_statistics(f[i:j], window)[1]
            mean[i:j], variance = sliding_statistics(w[i:j], window)
            variances[1, i:j] += variance
    # one that reads zero was not read: at rest it feels gravity
    variances[0, ~force.any(axis=0)] = np.inf
    for sensor, x in zip(variances, (force, rate), strict=True):
        if np.isfinite(variances[0]).any():
            level = np.quantile(sensor[np.isfinite(variances[0])], 0.05)
            sensor /= max(level, 3 * rounding_variance(x.T))
    return Activity(variances, means, window)


def moves(rows, stretches, step, settings):
    """Return whether the device moves most of the time in a session that should be at rest.

    It does if most windows differ from the next by more than `rate_tolerance` in the mean angular
    rate or by more than `FORCE_TOLERANCE` in the mean specific force. Takes Samples, the stretches
    between long gaps, and the median step of time, s.
    """
    width = max(round(settings.window_s / step), FEWEST_SAMPLES)
    first, _, means = block_means(rows, stretches, width)
    change = np.linalg.norm(np.diff(means, axis=0).reshape(-1, 2, 3), axis=2)
    moved = (change > [FORCE_TOLERANCE, settings.rate_tolerance]).any(axis=1)
    moved = moved[np.diff(first) == width]
    return 2 * np.count_nonzero(moved) > len(moved)


def rates_at_rest(moving, settings):
    """Return the biases of the gyroscope at rest, rad/s, (k, 3): two where it jumps.

    The first is the median over all windows that are quiet, whatever their attitude. A turn that no
    variance shows ends, and the next is another; a bias that jumped stays. So there is a second
    where windows that are away from the first by more than `rate_tolerance` nearly all share
    another rate, at several rests.
    """
    at = np.flatnonzero(moving.within(QUIET))
    first = np.median(moving.rate[:, at], axis=1) if len(at) else np.zeros(3)
    far = at[moving.away([first])[at] > settings.rate_tolerance]
    if 1 + np.sum(np.diff(far) > moving.window) < RESTS_OF_A_BIAS:
        return [first]
    other = np.median(moving.rate[:, far], axis=1)
    strays = moving.away([other])[far] > settings.rate_tolerance
    return [first] if strays.mean() > FEW else [first, other]


def detect_rests(still, stretches, step, settings):
    """Return the rests of a session, and the number of those dropped as too short.

    Edges that touch motion are trimmed. Takes whether each sample is still: the windowed variances
    of both sensors within their multiples of the level, and the windowed mean rate within
    `rate_tolerance` of the bias, as a slow turn about the vertical shows in nothing else.
    """
    trim, rests = round(TRIM_S / step), [np.empty((0, 2), dtype=int)]
    for i, j in stretches:
        each = stretches_of(still[i:j]) + i
        rests.append(each + trim * ((each > i) & (each < j)) * [1, -1])
    rests = np.concatenate(rests)
    kept = long_enough(rests, settings.shortest_rest_s, step)
    return rests[kept], int(np.sum(~kept))


def long_enough(rests, shortest, step):
    """Return which rests are long enough, s, and hold enough samples, (m,)."""
    samples = lengths(rests)
    return (samples * step >= shortest - step / 2) & (samples >= FEWEST_SAMPLES)


def widened(f, w, rests, stretches, step):
    """Return rests extended as far as short means of both sensors agree with the rest.

    The window of the detector ends a rest half its length early. From each end on, the mean over
    `EDGE_S` of each sensor is compared with that of the rest, by the variance of its samples there:
    the sum of the three squares is below the quantile of χ² that noise passes once in 100,000. The
    last `EDGE_S` before the first one above is left out. Takes specific force and angular rate,
    (3, n), ranges of samples, the stretches between long gaps, and the step of time, s.
    """
    width = max(round(EDGE_S / step), 1)
    sensors = [(x, uniform_filter1d(x, width, axis=1), rounding_variance(x.T)) for x in (f, w)]
    edges, wider = np.concatenate([[0], rests.ravel(), [f.shape[1]]]), rests.copy()
    for k, (i, j) in enumerate(rests):
        low, high = stretches[np.searchsorted(stretches[:, 0], i, side="right") - 1]
        low, high = max(low, edges[2 * k]), min(high, edges[2 * k + 3])
        away = np.ones(high - low + 2, dtype=bool)
        away[1:-1] = False
        for x, means, floor in sensors:
            rest = x[:, i:j]
            # of all axes alike: the frame of the sensor does not matter
            variance = max(rest.var(axis=1).mean(), floor) / width
            square = (means[:, low:high] - rest.mean(axis=1, keepdims=True)) ** 2
            away[1:-1] |= square.sum(axis=0) > chdtri(3, 1e-5) * variance
        before, after = np.flatnonzero(away[: i - low + 1]), np.flatnonzero(away[j - low + 1 :])
        left_out = width + width // 2
        wider[k] = min(i, low + before[-1] + left_out), max(j, j + after[0] - left_out)
    return wider
