"""Disturbances of a device at rest: changes of the mean that are too large for noise."""

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.special import betaincinv, chdtr, chdtri

from imuloop.core.stretches import lengths, merged, without
from imuloop.segment.windows import rounding_variance

# fewest second differences of a scale, without overlap, that determine their covariance
FEWEST = 60
# most second differences from which the covariance of a scale is estimated
MOST = 20_000
# quantile that sets the scale if the tails are heavier than normal, and most by which it may raise
# the covariance: a device that is handled for longer must not hide it
TAIL, TAIL_LIMIT = 0.99, 4.0
# number of samples below which a mean is affected by single outliers of a sensor, and the factor by
# which the amplitude of a second difference of such means has to be larger to be a disturbance
LONE, LONE_FACTOR = 4, 2.0
# most samples between two second differences: they take 130 MB for a day at 1 kHz
SPACING = 32
# number of times that the covariance is estimated from the vectors within a quantile
REWEIGHTINGS = 5
# number that is added to the diagonal of correlations, whose rounding is 1e-15
_RIDGE = 1e-12
# most rounds: a later round finds disturbances next to larger ones
ROUNDS = 10


def robust_covariance(x, floor, tail_limit=TAIL_LIMIT):
    """Return a robust covariance of vectors of mean zero, (k, k): outliers have no effect on it.

    First, a covariance that is equal in all directions follows from the median size of the vectors.
    By this covariance, vectors near zero are chosen: those whose squared Mahalanobis distance is
    below the 97.5 % quantile of χ². Their second moments, corrected for the vectors that are left
    out, give the next covariance. This is repeated `REWEIGHTINGS` times. If the tails are then
    heavier than normal, the covariance is multiplied by a factor of up to `tail_limit`, so that 1 %
    of the vectors exceed the 99 % quantile of χ². If the axes of a sensor are rotated, the result
    rotates with them.

    Parameters
    ----------
    x : ndarray, shape (n, k)
        n vectors of k = 3 or 6 channels: the three axes of one or more sensors.
    floor : ndarray, shape (k,)
        Variance that rounding adds to each channel. It is added on the diagonal, so that a channel
        that never changes has a positive variance, too.
    tail_limit : float, optional
        Largest factor by which heavy tails raise the covariance.

    References
    ----------
    Rousseeuw, Van Driessen, "A fast algorithm for the minimum covariance determinant estimator",
    Technometrics 41 (1999), section 4 (the reweighting).
    """
    k, sizes = x.shape[1], np.sum(x.reshape(len(x), -1, 3) ** 2, axis=2)
    covariance = np.diag(np.repeat(np.median(sizes, axis=0), 3) + floor)
    # 97.5 % quantile and median of χ²
    cut, middle = chdtri(k, 0.025), chdtri(k, 0.5)
    # vectors within the quantile have a smaller second moment than all normal vectors
    correction = 0.975 / chdtr(k + 2, cut)
    for _ in range(REWEIGHTINGS):
        distance = squared_distance(x, covariance)
        # the median sets the scale of the distances, so that a wrong scale does not matter
        near = x.T.compress(distance <= cut * np.median(distance) / middle, axis=1)
        covariance = near @ near.T / near.shape[1] * correction + np.diag(floor)
    tail = np.quantile(squared_distance(x, covariance), TAIL) / chdtri(k, 1 - TAIL)
    return covariance * np.clip(tail, 1.0, tail_limit)


def squared_distance(x, covariance):
    """Return the squared Mahalanobis distance from zero of n vectors, (n,).

    `x`, (n, k), are the vectors, and `covariance`, (k, k), is their covariance.
    """
    std = np.sqrt(np.diag(covariance))
    # the ridge keeps the matrix positive definite if a channel copies another
    correlation = covariance / np.outer(std, std) + _RIDGE * np.eye(len(std))
    whitened = np.linalg.inv(np.linalg.cholesky(correlation)) / std @ x.T
    return np.einsum("ij,ij->j", whitened, whitened)


def squared_distance_limit(probability, k, m):
    """Return the squared distance that a vector of Gaussian noise exceeds with a `probability`.

    The distance is Mahalanobis' distance from zero. A vector has `k` channels, and their covariance
    is estimated from `m` other vectors. So the squared distance is Hotelling's T²: (m² − 1) k / (m
    (m − k)) times an F variable with k and m − k degrees of freedom. F exceeds ``(m − k) (1 − z) /
    (k z)`` with the probability that a Beta((m − k)/2, k/2) variable is below z. This form is
    accurate for small probabilities.
    """
    z = betaincinv((m - k) / 2, k / 2, probability)
    return (m * m - 1) / m * (1 - z) / z


def undisturbed_ranges(x, ranges, step, settings):
    """Return the ranges of samples in which a device at rest is not disturbed, (k, 2).

    A disturbance is a knock, a tilt or handling: a change of the mean that is too large for noise.
    It shows in second differences. A second difference is the sum over h samples, minus twice the
    sum over the next h samples, plus the sum over the h samples after these. A linear drift does
    not change it. Each h = 2, 4, 8 … is a scale, up to the duration `longest_scale_s`. The second
    differences of one scale, of all channels, are compared with their own robust covariance. So
    flicker, random walk and drift only increase the covariance of the scales on which they act.

    A second difference is a disturbance if its squared distance occurs in Gaussian noise with a
    probability below `false_alarm` divided by the number of samples. The division allows for the
    number of second differences, 1.3 per sample over all scales (Bonferroni, which holds for any
    correlation). Exception: for sums of fewer than `LONE` samples the limit is `LONE_FACTOR` times
    as large in amplitude. Sensors at rest show single samples that are off by 7 to 12 standard
    deviations (an ADIS16405 some fifty in a million), and these are not disturbances.

    If several scales show a disturbance, the finest one determines the samples that are cut out. A
    wide disturbance is cut at the edge where the mean changes more. The search is then repeated on
    the remaining ranges, so that a tilt next to a knock, or the sway after a knock, is found too.
    Of a lasting tilt only the transition is cut out: the device rests before and after it, in two
    ranges. Ranges shorter than `shortest_static_s` are dropped. Exception: one of the `ranges` that
    is short itself stays if it has no disturbance.

    Parameters
    ----------
    x : ndarray, shape (6, n)
        The six channels of accelerometer and gyroscope at n samples, SI.
    ranges : ndarray of int, shape (m, 2)
        Half-open ranges of samples between long gaps, which are searched.
    step : float
        Median time step, s.
    settings : SegmentSettings
        False alarm rate, longest scale, and the number of seconds cut around a disturbance.

    References
    ----------
    Donoho, Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 81 (1994),
    section 2.4 (threshold over all coefficients of all scales).
    """
    floor = np.repeat([rounding_variance(sensor.T) for sensor in np.split(x, 2)], 3)
    shortest, remaining = round(settings.shortest_static_s / step), ranges
    for _ in range(ROUNDS):
        cuts = _find_cuts(x, remaining, floor, step, settings)
        if not len(cuts):
            break
        remaining = without(remaining, cuts)
        # a short piece is dropped, unless the range that it lies in is itself as short
        number = np.searchsorted(ranges[:, 0], remaining[:, 0], side="right") - 1
        least = np.minimum(shortest, lengths(ranges)[number])
        remaining = remaining[lengths(remaining) >= least]
    return remaining


def _find_cuts(x, ranges, floor, step, settings):
    """Return the cuts, ranges of samples with a disturbance, (k, 2), of one round of the search.

    A disturbance is a second difference that is too large for noise (`undisturbed_ranges`). The
    search goes from sums over two samples to longer ones. A second difference that overlaps with a
    cut by shorter sums is taken for the same disturbance and is not cut again.

    Parameters
    ----------
    x : ndarray, shape (6, n)
        The six channels of accelerometer and gyroscope at n samples, SI.
    ranges : ndarray of int, shape (m, 2)
        Ranges of samples that are searched.
    floor : ndarray, shape (6,)
        Variance that rounding adds to each channel.
    step : float
        Median time step, s.
    settings : SegmentSettings
        False alarm rate, longest scale, and the number of seconds cut around a disturbance.
    """
    cuts, half, n = np.empty((0, 2), dtype=int), 2, x.shape[1]
    guard = round(settings.guard_s / step)
    # in each range, sums over `half` samples, which start `apart` samples apart
    sums = [_double_sums(x[:, i:j], lag=1, thin=2) for i, j in ranges]
    while half * step <= settings.longest_scale_s:
        # number of second differences without overlap
        separate = int((lengths(ranges) // (3 * half)).sum())
        if separate < FEWEST:
            break
        apart = min(half, SPACING)
        lag = half // apart
        # by white noise, before - 2 during + after has the variance of 1 + 4 + 1 sums of `half`
        # samples: the division makes it the same at every scale
        differences = [
            (s[:, : -2 * lag] - 2 * s[:, lag:-lag] + s[:, 2 * lag :]) / np.sqrt(6 * half)
            for s in sums
        ]
        # some of them determine the covariance
        every = sum(d.shape[1] for d in differences) // MOST + 1
        sample = np.hstack([d[:, ::every] for d in differences]).T
        covariance = robust_covariance(sample, floor)
        bound = squared_distance_limit(settings.false_alarm / n, 6, min(separate, len(sample)))
        # sums of few samples show single outliers of the sensor
        bound *= LONE_FACTOR**2 if half < LONE else 1.0
        for start, s, d in zip(ranges[:, 0], sums, differences, strict=True):
            first, marks = _find_large(s, d, half, covariance, bound, guard)
            # a second difference that overlaps with a cut of a finer scale is the same disturbance
            next_cut = np.searchsorted(cuts[:, 1], start + first, side="right")
            is_new = start + first + 3 * half <= np.append(cuts[:, 0], n)[next_cut]
            if is_new.any():
                cuts = merged(np.concatenate([cuts, start + marks[is_new]]))
        half *= 2
        # sums over twice as many samples; they start twice as far apart, up to the spacing
        sums = [_double_sums(s, lag, thin=2 if half <= SPACING else 1) for s in sums]
    return np.clip(cuts, 0, n)


def _find_large(sums, differences, half, covariance, bound, guard):
    """Return two arrays about k large second differences: first samples, (k,), and cuts, (k, 2).

    A second difference is the sum over `half` samples, minus twice the sum over the next ones, plus
    the sum over those after them. A large one is a disturbance. The first array has the first
    sample of each, the second the half-open range of samples to cut out. Samples are counted from
    the first column of `sums`. A second difference is short if it spans at most `guard` or
    `SPACING` samples; then all its samples are cut out. A long one is cut at one edge: at the start
    or the end of its middle samples, where the mean changes more. Of long ones that overlap, only
    the largest counts.

    Parameters
    ----------
    sums : ndarray, shape (6, m + 2 half/spacing)
        Sums of six channels over `half` samples. Column i starts at the sample i times the spacing,
        which is the smaller one of `half` and `SPACING`.
    differences : ndarray, shape (6, m)
        Second differences of adjoining sums, in units in which white noise has one variance for all
        `half`; column i starts at the sample i times the spacing, too.
    half : int
        Number of samples of a sum.
    covariance : ndarray, shape (6, 6)
        Covariance of the second differences.
    bound : float
        Squared Mahalanobis distance above which a second difference is large.
    guard : int
        Number of samples to cut before and after a disturbance.
    """
    distance, spacing = squared_distance(differences.T, covariance), min(half, SPACING)
    large, lag = distance > bound, half // spacing
    # a second difference is short if it is no longer than the guard, or than the spacing
    if 3 * half <= max(guard, SPACING):
        first = spacing * np.flatnonzero(large)
        return first, first[:, None] + [-guard, 3 * half + guard]
    # of overlapping second differences only the largest counts
    index = np.flatnonzero(large & (distance == maximum_filter1d(distance, 2 * lag + 1)))
    before, during, after = (sums[:, index + k * lag] for k in range(3))
    first_change, second_change = (
        squared_distance(change.T, covariance) for change in (during - before, after - during)
    )
    edge = spacing * index + np.where(second_change > first_change, 2 * half, half)
    margin = half // 4 + guard
    return spacing * index, edge[:, None] + [-margin, margin]


def _double_sums(sums, lag, thin):
    """Return sums of six channels over twice as many samples, (6, k).

    `sums`, (6, m), are sums over consecutive samples. The samples of two sums adjoin each other if
    their columns differ by `lag`; such two are added. Of every `thin` results the first is kept.
    """
    return sums[:, :-lag:thin] + sums[:, lag::thin]
