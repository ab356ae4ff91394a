"""Disturbances: knocks, handling and lasting tilts in a static session, by wavelets."""

import numpy as np
import pywt
from scipy import stats

from imuloop.segment.stretches import runs
from imuloop.segment.windows import rounding_variance

# two vanishing moments: a straight drift leaves nothing
WAVELET = pywt.Wavelet("db2")
# specific force and angular rate are judged together
CHANNELS = 6
# fewest coefficients on a scale from which their covariance can be told
FEWEST = 60
# most coefficients that the covariance of a scale is taken from
MOST = 20_000
# quantile that sets the scale where tails are heavier than normal, and how far it may raise it: a
# session handled for longer than the rest of the quantile must not hide that
TAIL, TAIL_LIMIT = 0.99, 4.0
# scales of fewer samples than this see single samples that sensors throw out now and then
LONE = 8
# how much larger, in amplitude, such a sample has to be to count as a knock
LONE_FACTOR = 2.0
# scales of more samples than this are transformed at every shift by half the scale below, so that
# no step falls between two coefficients
DENSE = 32
# a disturbance hidden behind a larger one is found in a later round
ROUNDS = 10


def robust_covariance(x, floor, tail_limit=TAIL_LIMIT):
    """Return the covariance of vectors about zero, as if a part of them were not there.

    Starting from a covariance that is the same in every direction of a sensor, the half of the
    vectors nearest to zero gives the next covariance, until it stands still. Its scale follows
    from the median of the squared distance, χ² with k degrees of freedom; all vectors within the
    97.5 % quantile then give the final covariance. Where tails are heavier than normal, as of a
    noise that swells with temperature, the 99 % quantile sets the scale, up to `tail_limit` times.
    Neither the start nor a step prefers an axis: turning the sensor's frame turns the covariance
    with it.

    Parameters
    ----------
    x : array_like, shape (n, k)
        Vectors of one or more sensors, three axes each.
    floor : array_like, shape (k,)
        Variance added to each channel, that of rounding.
    tail_limit : float
        How far the tail may raise the scale.

    Returns
    -------
    ndarray, shape (k, k)

    References
    ----------
    Rousseeuw, Van Driessen, "A fast algorithm for the minimum covariance determinant estimator",
    Technometrics 41 (1999), theorem 1 and section 4.
    """
    k = x.shape[1]
    sensors = x.reshape(len(x), -1, 3)
    covariance = np.diag(np.repeat(np.median(np.sum(sensors**2, axis=2), axis=0), 3) + floor)
    for _ in range(10):
        distance = squared_distance(x, covariance)
        half = x[distance <= np.median(distance)]
        covariance = half.T @ half / len(half) + np.diag(floor)
    distance = squared_distance(x, covariance)
    scale = np.median(distance) / stats.chi2.median(k)
    cut = stats.chi2.ppf(0.975, k)
    near = x[distance <= cut * scale]
    # second moment of a normal vector within the quantile, of the whole
    covariance = near.T @ near / len(near) * 0.975 / stats.chi2.cdf(cut, k + 2)
    covariance += np.diag(floor)
    tail = np.quantile(squared_distance(x, covariance), TAIL) / stats.chi2.ppf(TAIL, k)
    return covariance * np.clip(tail, 1.0, tail_limit)


def squared_distance(x, covariance):
    """Return the squared Mahalanobis distance of vectors, shape (n, k), from zero."""
    return np.sum((x @ np.linalg.cholesky(np.linalg.inv(covariance))) ** 2, axis=1)


def details(x, stretches, level_count):
    """Yield scale, wavelet coefficients and the first sample each depends on, fine to coarse.

    Coefficient k of level j depends on 3·2ʲ − 2 samples, from 2ʲk − 2(2ʲ − 1) of its stretch on;
    those that reach beyond an end of the stretch are left out.

    Parameters
    ----------
    x : array_like, shape (n, 6)
        Samples.
    stretches : array_like of int, shape (k, 2)
        Undisturbed ranges of samples.
    level_count : int
        Number of levels.

    Yields
    ------
    width : int
        2ʲ, samples.
    coefficients : ndarray, shape (m, 6)
        Of all stretches.
    first : ndarray of int, shape (m,)
        First sample of the support of each.
    """
    # (first sample of the stretch, its end, shift of the sequence, smooth sequence)
    sequences = [(i, j, 0, x[i:j]) for i, j in stretches]
    for level in range(1, level_count + 1):
        width = 2**level
        coefficients, first, halved = [np.empty((0, CHANNELS))], [np.empty(0, dtype=int)], []
        for i, j, shift, smooth in sequences:
            for extra in (0, 1) if width > DENSE else (0,):
                if len(smooth) - extra < WAVELET.dec_len:
                    continue
                begin = shift + extra * width // 2
                halves = pywt.dwt(smooth[extra:], WAVELET, mode="zero", axis=0)
                halved.append((i, j, begin, halves[0]))
                start = begin + width * np.arange(len(halves[1])) - 2 * (width - 1)
                inside = (start >= 0) & (start + 3 * width - 2 <= j - i)
                coefficients.append(halves[1][inside])
                first.append(start[inside] + i)
        sequences = halved
        yield width, np.concatenate(coefficients), np.concatenate(first)


def _mark(x, covariance, first, width, guard, cut):
    # mark what each flagged coefficient saw; on wide supports only where the level changes most
    half, length = width // 2, 3 * width - 2
    for start in first:
        begin, end = start, start + length
        if length > guard:
            total = np.concatenate([np.zeros((1, CHANNELS)), np.cumsum(x[begin:end], axis=0)])
            change = total[width:] - 2 * total[half:-half] + total[:-width]
            begin += int(np.argmax(squared_distance(change, covariance)))
            end = begin + width
        cut[max(begin - guard, 0) : end + guard] = True


def undisturbed(disturbed, stretches):
    """Return the ranges of samples, shape (k, 2), between disturbances and gaps."""
    ranges = [runs(~disturbed[i:j]) + i for i, j in stretches]
    return np.concatenate([np.empty((0, 2), dtype=int), *ranges])


def disturbed_samples(x, stretches, step, settings):
    """Return which samples of a static session are disturbed.

    The coefficients of a wavelet transform of all six channels, scale by scale up to
    `longest_scale_s`, are compared with their own robust covariance on that scale: so flicker,
    random walk and a drift of any length only widen what counts as normal on the scales they
    live on. A coefficient is a disturbance if its squared distance would occur in an undisturbed
    session of Gaussian noise with the probability `false_alarm`, divided by the number of samples.
    All scales together hold 1.3 coefficients a sample (Bonferroni, so right for any correlation).
    Hotelling's T² replaces χ², as scales with few coefficients know their covariance badly.
    Sensors at rest throw out single samples of 7 to 12 standard deviations (an ADIS16405 some
    fifty in a million); below eight samples a disturbance has to have twice the amplitude.

    Of a disturbance that shows on several scales the finest places the cut; the search is then
    repeated on what is left, so that a tilt beside a knock, or the sway after it, is found too. A
    lasting tilt costs its transition only: before and after are separate stretches, never
    compared again.

    Parameters
    ----------
    x : array_like, shape (n, 6)
        Specific force, m/s², and angular rate, rad/s.
    stretches : array_like of int, shape (k, 2)
        Stretches without a gap.
    step : float
        Median step of time, s.
    settings : SegmentSettings
        False alarms, longest scale, guard, shortest static stretch.

    Returns
    -------
    disturbed : ndarray of bool, shape (n,)
    metadata : dict
        Longest scale judged, s, and the number of coefficients that placed a cut, by scale.

    References
    ----------
    Mallat, "A wavelet tour of signal processing", 3rd ed. 2009, section 7.3 (fast transform);
    Donoho, Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 81 (1994),
    section 2.4 (threshold over all coefficients).
    """
    disturbed = np.zeros(len(x), dtype=bool)
    level_count = max(1, int(np.log2(max(settings.longest_scale_s / step, 2))))
    guard = round(settings.guard_s / step)
    shortest = round(settings.shortest_static_s / step)
    floor = np.repeat([rounding_variance(x[:, :3]), rounding_variance(x[:, 3:])], 3)
    flagged, longest = {}, 0.0
    for _ in range(ROUNDS):
        left = undisturbed(disturbed, stretches)
        cut = np.zeros(len(x), dtype=bool)
        for width, coefficients, first in details(x, left, level_count):
            n = len(coefficients)
            # shifted transforms overlap: only so many coefficients are independent
            independent = n // max(1, width // DENSE)
            if independent < FEWEST:
                break
            longest = max(longest, width * step)
            sample = coefficients[:: n // MOST + 1]
            covariance = robust_covariance(sample, floor)
            m = min(independent, len(sample))
            bound = stats.f.isf(settings.false_alarm / len(x), CHANNELS, m - CHANNELS)
            bound *= CHANNELS * (m - 1) * (m + 1) / (m * (m - CHANNELS))
            bound *= LONE_FACTOR**2 if width < LONE else 1.0
            found = first[squared_distance(coefficients, covariance) > bound]
            if len(found):
                seen = np.concatenate([[0], np.cumsum(cut)])
                found = found[seen[found + 3 * width - 2] == seen[found]]
                _mark(x, covariance, found, width, guard, cut)
                flagged[width] = flagged.get(width, 0) + len(found)
        if not cut.any():
            break
        disturbed |= cut
        for i, j in stretches:
            for begin, end in runs(~disturbed[i:j]) + i:
                if end - begin < min(shortest, j - i):
                    disturbed[begin:end] = True
    counts = [{"scale_s": w * step, "count": n} for w, n in sorted(flagged.items()) if n]
    return disturbed, {"longest_scale_s": longest, "flagged": counts}
