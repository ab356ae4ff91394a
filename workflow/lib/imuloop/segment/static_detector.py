"""Static detector: rests by windowed variance and mean rate of both sensors.

Tedaldi, Pretto, Menegatti, "A robust and easy to implement method for IMU calibration without
external equipments", ICRA 2014, section IV-A. The paper takes the root of the sum of the squared
variances of the axes, which depends on the orientation of the sensor's axes. This module takes the
sum of the variances, which does not.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import chdtri

from imuloop.core.stretches import lengths, stretches_of
from imuloop.segment.windows import block_means, rounding_variance, sliding_statistics

# largest ratio of the variances of accelerometer and gyroscope to their levels at rest: in a window
# at rest (`unsteady_samples` then finds a hand that trembles), and in a window that is quiet enough
# to determine the gyroscope's bias
MULTIPLES, QUIET = (10, 300), (10, 10)
# fewest samples of a rest: the variance of fewer does not give the error of the mean
FEWEST_SAMPLES = 4
# fewest rests that share a second bias of the gyroscope, and largest share of their windows with
# another rate
RESTS_OF_A_BIAS, FEW = 3, 0.1
# least change of the mean specific force between two windows that is motion, m/s²: 10 mg
FORCE_TOLERANCE = 0.1
# length that is cut from each end of a rest next to motion, and length of the means by which the
# rest is then widened, s
TRIM_S, EDGE_S = 0.05, 0.1


@dataclass(frozen=True)
class Activity:
    """Activity of a device: variances and mean angular rate in a window about each of n samples."""

    # (2, n): variances of accelerometer and gyroscope, summed over the axes, over their level at
    # rest; infinite if no window fits between two long gaps or the accelerometer reads zero
    variances: np.ndarray
    rate: np.ndarray  # (3, n): mean angular rate in the window, rad/s
    window: int  # length of the window, samples

    def within(self, multiples):
        """Return at which of n samples the variances of both sensors are small, a mask, (n,).

        `multiples` is a pair, for accelerometer and gyroscope: the largest ratio of the variance in
        the window to its level at rest that counts as small.
        """
        return np.all(self.variances <= np.reshape(multiples, (2, 1)), axis=0)

    def away(self, biases):
        """Return how far the mean angular rate is away from the nearest of k biases, rad/s, (n,).

        The distance is a norm, one for each of n samples. `biases` are biases of the gyroscope,
        rad/s, (k, 3).
        """
        return np.min([np.linalg.norm(self.rate.T - bias, axis=1) for bias in biases], axis=0)


def activity(force, rate, stretches, window):
    """Return the Activity of a session, by which rests are told from motion.

    The Activity has the variances of both sensors in a window about each sample, divided by their
    levels at rest, and the mean angular rate. The level of a sensor at rest is the 5 % quantile of
    its variance over all windows, but not less than the variance of rounding. The level is correct
    if the device rests in at least a tenth of the log. No window crosses a long gap.

    Parameters
    ----------
    force : ndarray, shape (3, n)
        Specific force, m/s².
    rate : ndarray, shape (3, n)
        Angular rate, rad/s.
    stretches : ndarray of int, shape (k, 2)
        Ranges of samples between long gaps.
    window : int
        Length of the window, samples.
    """
    variances, means = np.full((2, force.shape[1]), np.inf), np.zeros_like(rate)
    for i, j in stretches[lengths(stretches) >= window]:
        # one axis at a time, to save memory
        variances[:, i:j] = 0.0
        for f, w, mean in zip(force, rate, means, strict=True):
            _, force_variance = sliding_statistics(f[i:j], window)
            mean[i:j], rate_variance = sliding_statistics(w[i:j], window)
            variances[:, i:j] += [force_variance, rate_variance]
    # an accelerometer measures gravity at rest: zeros are not measurements
    variances[0, ~force.any(axis=0)] = np.inf
    has_window = np.isfinite(variances[0])
    if has_window.any():
        for variance, x in zip(variances, (force, rate), strict=True):
            level = np.quantile(variance[has_window], 0.05)
            # the variance is a sum of three axes, each of which is rounded
            variance /= max(level, 3 * rounding_variance(x.T))
    return Activity(variances, means, window)


def moves(rows, stretches, step, settings):
    """Return whether the device moves most of the time in a session that should be at rest.

    Each window of `window_s` is compared with the next. The device moves if in most of these pairs
    the mean angular rates differ by more than `rate_tolerance`, or the mean specific forces by more
    than `FORCE_TOLERANCE`.

    Parameters
    ----------
    rows : Samples
        The samples of the session.
    stretches : ndarray of int, shape (k, 2)
        Ranges of samples between long gaps.
    step : float
        Median time step, s.
    settings : SegmentSettings
        Length of the window, s, and `rate_tolerance`, rad/s.
    """
    width = max(round(settings.window_s / step), FEWEST_SAMPLES)
    first, _, means = block_means(rows, stretches, width)
    # size of the change of specific force and of angular rate from each window to the next
    change = np.linalg.norm(np.diff(means, axis=0).reshape(-1, 2, 3), axis=2)
    moved = (change > [FORCE_TOLERANCE, settings.rate_tolerance]).any(axis=1)
    # two windows with a gap between them do not count
    moved = moved[np.diff(first) == width]
    return 2 * np.count_nonzero(moved) > len(moved)


def rates_at_rest(windows, settings):
    """Return the one or two biases of the gyroscope, a list of vectors, rad/s, (3,).

    A second bias is found if the bias jumps during the session. The first bias is the median
    angular rate of all quiet windows, in which the variances are near their levels at rest. Quiet
    windows whose rate differs from it by more than `rate_tolerance` have the second bias if two
    conditions hold: they belong to `RESTS_OF_A_BIAS` rests or more, and nearly all of them have the
    same rate. So slow turns are not taken for a second bias: each has a different rate.

    `windows` is the Activity of the session, and `settings` are SegmentSettings.
    """
    quiet = np.flatnonzero(windows.within(QUIET))
    first = np.median(windows.rate[:, quiet], axis=1) if len(quiet) else np.zeros(3)
    far = quiet[windows.away([first])[quiet] > settings.rate_tolerance]
    # windows more than a window apart belong to different rests
    if 1 + np.sum(np.diff(far) > windows.window) < RESTS_OF_A_BIAS:
        return [first]
    second = np.median(windows.rate[:, far], axis=1)
    strays = windows.away([second])[far] > settings.rate_tolerance
    return [first] if strays.mean() > FEW else [first, second]


def detect_rests(still, stretches, step, settings):
    """Return the rests of a session, (m, 2), and the number of stretches too short to be rests.

    A rest is a half-open range of still samples of at least `shortest_rest_s`. Each end that
    touches motion is trimmed by `TRIM_S`.

    Parameters
    ----------
    still : ndarray of bool, shape (n,)
        Whether each sample is still: the variances of both sensors are within multiples of their
        levels at rest, and the mean rate is within `rate_tolerance` of the bias. Only the mean rate
        shows a slow turn about the vertical.
    stretches : ndarray of int, shape (k, 2)
        Ranges of samples between long gaps.
    step : float
        Median time step, s.
    settings : SegmentSettings
        Shortest rest, s.
    """
    trim, rests = round(TRIM_S / step), [np.empty((0, 2), dtype=int)]
    for i, j in stretches:
        ranges = stretches_of(still[i:j]) + i
        # an end of the stretch touches a gap, not motion, and is not trimmed
        rests.append(ranges + trim * ((ranges > i) & (ranges < j)) * [1, -1])
    rests = np.concatenate(rests)
    kept = long_enough(rests, settings.shortest_rest_s, step)
    return rests[kept], int(np.sum(~kept))


def long_enough(rests, shortest, step):
    """Return which of m ranges of samples are long enough to be rests, a mask, (m,).

    `rests`, (m, 2), are the ranges, half-open. A rest has to last `shortest` seconds and to have
    `FEWEST_SAMPLES` samples. `step` is the time step, s.
    """
    samples = lengths(rests)
    return (samples * step >= shortest - step / 2) & (samples >= FEWEST_SAMPLES)


def widen_rests(f, w, rests, stretches, step):
    """Return the rests, (m, 2), extended on both sides as far as the device is still.

    The static detector makes a rest too short by half a window at each end. So, outward from each
    end, means of both sensors over `EDGE_S` seconds are compared with the mean of the rest. A mean
    agrees if the squared difference, summed over the three axes and divided by the variance of such
    a mean, is below the quantile of χ² that noise exceeds in one of 100,000 means. The new end lies
    `EDGE_S` short of the first mean that does not agree.

    Parameters
    ----------
    f : ndarray, shape (3, n)
        Specific force, m/s².
    w : ndarray, shape (3, n)
        Angular rate, rad/s.
    rests : ndarray of int, shape (m, 2)
        Ranges of samples of the rests.
    stretches : ndarray of int, shape (k, 2)
        Ranges of samples between long gaps.
    step : float
        Median time step, s.
    """
    width = max(round(EDGE_S / step), 1)
    # half of the mean that disagrees, and the samples that are left out before it
    margin = width // 2 + width
    sensors = [(x, uniform_filter1d(x, width, axis=1), rounding_variance(x.T)) for x in (f, w)]
    ends_before, starts_after = np.append(0, rests[:-1, 1]), np.append(rests[1:, 0], f.shape[1])
    wider = rests.copy()
    for k, (i, j) in enumerate(rests):
        # the rest may grow to the neighbouring rests, or to a long gap
        low, high = stretches[np.searchsorted(stretches[:, 0], i, side="right") - 1]
        low, high = max(low, ends_before[k]), min(high, starts_after[k])
        # whether the mean about each sample disagrees with the rest
        disagrees = np.zeros(high - low, dtype=bool)
        for x, means, floor in sensors:
            rest = x[:, i:j]
            # one variance for all axes, so that the result does not depend on the sensor's axes
            variance = max(rest.var(axis=1).mean(), floor) / width
            square = (means[:, low:high] - rest.mean(axis=1, keepdims=True)) ** 2
            disagrees |= square.sum(axis=0) > chdtri(3, 1e-5) * variance
        # last sample before the rest that disagrees, and first one after it; the neighbour is one
        before = np.flatnonzero(np.append(True, disagrees[: i - low]))[-1] + low - 1
        after = np.flatnonzero(np.append(disagrees[j - low :], True))[0] + j
        wider[k] = min(i, before + 1 + margin), max(j, after - margin)
    return wider
