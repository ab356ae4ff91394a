"""Disturbances of a device at rest: second differences of means that no noise has."""

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.special import betaincinv, chdtr, chdtri

from imuloop.core.stretches import lengths, merged, without
from imuloop.segment.windows import rounding_variance

# fewest separate second differences of a scale that determine their covariance
FEWEST = 60
# most second differences that the covariance of a scale is taken from
MOST = 20_000
# quantile that sets the scale where tails are heavier than normal, and how far it may raise it: a
# session handled for longer than the rest of the quantile must not hide that
TAIL, TAIL_LIMIT = 0.99, 4.0
# means over fewer samples than this see single samples that sensors throw out now and then
LONE = 4
# how much larger, in amplitude, such a sample has to be to count as a knock
LONE_FACTOR = 2.0
# most samples from one second difference to the next: of a day at 1 kHz they are 130 MB
SPACING = 32
# times that a covariance is taken of what was near by the one before
REWEIGHTINGS = 5
# added to correlations, whose rounding is 1e-15
_RIDGE = 1e-12
# a disturbance hidden behind a larger one is found in a later round
ROUNDS = 10


def robust_covariance(x, floor, tail_limit=TAIL_LIMIT):
    """Return a covariance of vectors about zero that outliers do not affect, (k, k).

    Starting from a covariance that is the same in every direction of a sensor, the vectors within
    the 97.5 % quantile give the next one. The scale follows from the median of the squared
    distance, χ² with k degrees of freedom. Where tails are heavier than normal the 99 % quantile
    sets it, up to `tail_limit` times. No step prefers an axis.

    Takes vectors of one or more sensors, three axes each, (n, k), and the variance of rounding,
    (k,), which is added to each channel.

    References
    ----------
    Rousseeuw, Van Driessen, "A fast algorithm for the minimum covariance determinant estimator",
    Technometrics 41 (1999), section 4 (the reweighting).
    """
    k, sizes = x.shape[1], np.sum(x.reshape(len(x), -1, 3) ** 2, axis=2)
    covariance = np.diag(np.repeat(np.median(sizes, axis=0), 3) + floor)
    cut, middle = chdtri(k, 0.025), chdtri(k, 0.5)
    for _ in range(REWEIGHTINGS):
        distance = squared_distance(x, covariance)
        near = x.T.compress(distance <= cut / middle * np.median(distance), axis=1)
        # second moment of a normal vector within the quantile, of the whole
        covariance = near @ near.T / near.shape[1] * 0.975 / chdtr(k + 2, cut) + np.diag(floor)
    tail = np.quantile(squared_distance(x, covariance), TAIL) / chdtri(k, 1 - TAIL)
    return covariance * np.clip(tail, 1.0, tail_limit)


def squared_distance(x, covariance):
    """Return the squared Mahalanobis distance of vectors, shape (n, k), from zero."""
    scale = np.sqrt(np.diag(covariance))
    # channels that copy each other leave nothing between them but rounding
    correlation = covariance / np.outer(scale, scale) + _RIDGE * np.eye(len(scale))
    y = np.linalg.inv(np.linalg.cholesky(correlation)) / scale @ x.T
    return np.einsum("ij,ij->j", y, y)


def distance_beyond(probability, k, m):
    """Return the squared distance that a vector of noise exceeds with a given probability.

    The covariance of the k channels is known from m other vectors, so that the distance is
    Hotelling's T², (m² − 1) k / (m (m − k)) times F with k and m − k degrees of freedom. F is
    beyond ``(m − k) (1 − z) / (k z)`` where a beta variable with m − k and k degrees of freedom is
    below z; a small probability keeps its digits in it.
    """
    z = betaincinv((m - k) / 2, k / 2, probability)
    return (m * m - 1) / m * (1 - z) / z


def undisturbed(x, ranges, step, settings):
    """Return the parts of ranges of samples, (m, 2), without a disturbance, (k, 2).

    The mean over `half` samples, less those of as many before and after, is a second difference: a
    steady drift leaves nothing of it. On each scale, up to a `half` of `longest_scale_s`, second
    differences of all channels are compared with their own robust covariance: so flicker, random
    walk and a drift of any length only widen what counts as normal on the scales they live on. One
    is a disturbance if its squared distance would occur in undisturbed Gaussian noise with the
    probability `false_alarm`, divided by the number of samples. All scales together hold 1.3 second
    differences per sample (Bonferroni, so right for any correlation). Sensors at rest throw out
    single samples of 7 to 12 standard deviations (an ADIS16405 some fifty in a million); the mean
    of fewer than four samples has to have twice the amplitude.

    Of a disturbance that shows on several scales the finest places the cut, of a wide one where the
    level changes more; the search is then repeated on the rest, so that a tilt beside a knock, or
    the sway after it, is found too. A lasting tilt costs its transition only: before and after are
    separate stretches.

    Takes the six channels, SI, (6, n), their stretches between long gaps, and the median step of
    time, s.

    References
    ----------
    Donoho, Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 81 (1994),
    section 2.4 (threshold over all coefficients of all scales).
    """
    floor = np.repeat([rounding_variance(each.T) for each in np.split(x, 2)], 3)
    shortest, rest = round(settings.shortest_static_s / step), ranges
    for _ in range(ROUNDS):
        cuts = _cuts(x, rest, floor, step, settings)
        if not len(cuts):
            break
        rest = without(rest, cuts)
        whole = lengths(ranges)[np.searchsorted(ranges[:, 0], rest[:, 0], side="right") - 1]
        rest = rest[lengths(rest) >= np.minimum(shortest, whole)]
    return rest


def _cuts(x, ranges, floor, step, settings):
    """Return what is to be cut from ranges; takes the variance of rounding, (6,)."""
    cuts, half, n = np.empty((0, 2), dtype=int), 2, x.shape[1]
    guard = round(settings.guard_s / step)
    # sums over `half` samples, `apart` samples apart
    sums = [_doubled(x[:, i:j], 1, 2) for i, j in ranges]
    while half * step <= settings.longest_scale_s:
        separate = int((lengths(ranges) // (3 * half)).sum())
        if separate < FEWEST:
            break
        apart = min(half, SPACING)
        lag = half // apart
        differences = [
            (each[:, : -2 * lag] - 2 * each[:, lag:-lag] + each[:, 2 * lag :]) / np.sqrt(6 * half)
            for each in sums
        ]
        every = sum(each.shape[1] for each in differences) // MOST + 1
        sample = np.hstack([each[:, ::every] for each in differences]).T
        covariance = robust_covariance(sample, floor)
        bound = distance_beyond(settings.false_alarm / n, 6, min(separate, len(sample)))
        bound *= LONE_FACTOR**2 if half < LONE else 1.0
        for start, total, each in zip(ranges[:, 0], sums, differences, strict=True):
            first, marks = _marks(total, each, half, covariance, bound, guard)
            # a finer scale has placed a cut already in what this one reaches
            k = np.searchsorted(cuts[:, 1], start + first, side="right")
            free = start + first + 3 * half <= np.append(cuts[:, 0], n)[k]
            if free.any():
                cuts = merged(np.concatenate([cuts, start + marks[free]]))
        half *= 2
        sums = [_doubled(each, lag, 2 if half <= SPACING else 1) for each in sums]
    return np.clip(cuts, 0, n)


def _marks(sums, differences, half, covariance, bound, guard):
    """Return first samples of what is too large in a range, (k,), and what to cut, (k, 2)."""
    distance, apart = squared_distance(differences.T, covariance), min(half, SPACING)
    large, lag = distance > bound, half // apart
    if 3 * half <= max(guard, SPACING):
        first = apart * np.flatnonzero(large)
        return first, first[:, None] + [-guard, 3 * half + guard]
    # of what overlaps the largest, at that of its two edges at which the level changes more
    at = np.flatnonzero(large & (distance == maximum_filter1d(distance, 2 * lag + 1)))
    a, b, c = (sums[:, at + k * lag] for k in range(3))
    late = squared_distance((c - b).T, covariance) > squared_distance((b - a).T, covariance)
    edge, beside = apart * at + half * (1 + late), half // 4 + guard
    return apart * at, edge[:, None] + [-beside, beside]


def _doubled(sums, lag, thin):
    """Return sums over twice as many samples; of them one in `thin` is kept."""
    return sums[:, :-lag:thin] + sums[:, lag::thin]
