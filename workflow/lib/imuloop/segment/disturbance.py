"""Disturbances: knocks, handling and lasting tilts in a static session, by wavelets."""

from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv, chdtr, chdtri

from imuloop.core.samples import CHANNELS
from imuloop.core.stretches import lengths, merged, without
from imuloop.segment.wavelets import FINE, SPACING, coarse_details, fine_details
from imuloop.segment.windows import DECIDING, rounding_variance

# specific force and angular rate are judged together
K = len(CHANNELS)
# fewest coefficients on a scale that determine their covariance
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
# added to correlations, whose rounding is 1e-15
_RIDGE = 1e-12
# a disturbance hidden behind a larger one is found in a later round
ROUNDS = 10
# samples over which the places of cuts are looked for at once
TOGETHER = 1 << 18


def robust_covariance(x, floor, tail_limit=TAIL_LIMIT):
    """Return a covariance of vectors about zero that outliers do not affect, (k, k).

    Starting from a covariance that is the same in every direction of a sensor, the half of the
    vectors nearest to zero gives the next covariance, until it stands still. Its scale follows
    from the median of the squared distance, χ² with k degrees of freedom; all vectors within the
    97.5 % quantile then give the final covariance. Where tails are heavier than normal the 99 %
    quantile sets the scale, up to `tail_limit` times. No step prefers an axis.

    Takes vectors of one or more sensors, three axes each, (n, k), and the variance of rounding,
    (k,), which is added to each channel.

    References
    ----------
    Rousseeuw, Van Driessen, "A fast algorithm for the minimum covariance determinant estimator",
    Technometrics 41 (1999), theorem 1 and section 4.
    """
    k = x.shape[1]
    sensors = x.reshape(len(x), -1, 3)
    covariance = np.diag(np.repeat(np.median(np.sum(sensors**2, axis=2), axis=0), 3) + floor)
    middle = (len(x) - 1) // 2
    for _ in range(10):
        distance = squared_distance(x, covariance)
        nearest = distance <= np.partition(distance, middle)[middle]
        half = x.T.compress(nearest, axis=1)
        last, covariance = covariance, half @ half.T / half.shape[1] + np.diag(floor)
        if np.array_equal(covariance, last):
            break
    distance = squared_distance(x, covariance)
    scale = np.median(distance) / chdtri(k, 0.5)
    cut = chdtri(k, 0.025)
    near = x.T.compress(distance <= cut * scale, axis=1)
    # second moment of a normal vector within the quantile, of the whole
    covariance = near @ near.T / near.shape[1] * 0.975 / chdtr(k + 2, cut)
    covariance += np.diag(floor)
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


def undisturbed(rows, stretches, step, settings):
    """Return the ranges of a static session between its disturbances.

    The coefficients of a wavelet transform of all six channels, scale by scale up to
    `longest_scale_s`, are compared with their own robust covariance on that scale: so flicker,
    random walk and a drift of any length only widen what counts as normal on the scales they
    live on. A coefficient is a disturbance if its squared distance would occur in an undisturbed
    session of Gaussian noise with the probability `false_alarm`, divided by the number of samples.
    All scales together hold 1.3 coefficients per sample (Bonferroni, so right for any correlation).
    Sensors at rest throw out single samples of 7 to 12 standard deviations (an ADIS16405 some
    fifty in a million); below eight samples a disturbance has to have twice the amplitude.

    Of a disturbance that shows on several scales the finest places the cut; the search is then
    repeated on the rest, so that a tilt beside a knock, or the sway after it, is found too. A
    lasting tilt costs its transition only: before and after are separate stretches.

    Takes Samples, their stretches between long gaps, and the median step of time, s.

    References
    ----------
    Mallat, "A wavelet tour of signal processing", 3rd ed. 2009, section 7.3 (fast transform);
    Donoho, Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 81 (1994),
    section 2.4 (threshold over all coefficients).
    """
    levels = max(1, int(np.log2(max(settings.longest_scale_s / step, 2))))
    sensors = np.split(rows.read(CHANNELS, 0, min(DECIDING, len(rows))), 2)
    search = _WaveletSearch(
        rows=rows,
        widths=[2**level for level in range(1, levels + 1)],
        floor=np.repeat([rounding_variance(x.T) for x in sensors], 3),
        false_alarm=settings.false_alarm / max(len(rows), 1),
        guard=round(settings.guard_s / step),
    )
    shortest = round(settings.shortest_static_s / step)
    ranges = stretches
    for _ in range(ROUNDS):
        cuts = search.cuts(ranges)
        if not len(cuts):
            break
        ranges = without(ranges, cuts)
        stretch = np.searchsorted(stretches[:, 0], ranges[:, 0], side="right") - 1
        ranges = ranges[lengths(ranges) >= np.minimum(shortest, lengths(stretches)[stretch])]
    return ranges


@dataclass(frozen=True)
class _WaveletSearch:
    """What a round of the search needs: samples, scales, noise of rounding, probability, guard."""

    rows: object
    widths: list
    floor: np.ndarray
    false_alarm: float
    guard: int

    def cuts(self, ranges):
        """Return what is to be cut from ranges."""
        cuts = np.empty((0, 2), dtype=int)
        for width, covariance, first in self._too_large(ranges):
            # a finer scale has placed a cut already in what this one reaches
            k = np.searchsorted(cuts[:, 1], first, side="right")
            reached = np.append(cuts[:, 0], len(self.rows) + 1)[k]
            first = first[first + 3 * width - 2 <= reached]
            if len(first):
                cuts = merged(np.concatenate([cuts, self._marks(first, width, covariance)]))
        return cuts

    def _too_large(self, ranges):
        """Yield scale, covariance and first samples of what is too large, fine to coarse.

        Up to the first scale that has too few coefficients.
        """
        n = lengths(ranges)
        fine = [w for w in self.widths if w in FINE]
        counts = [int(np.maximum(n // w - (1 if w == 2 else 2), 0).sum()) for w in fine]
        widths = fine[: next((k for k, count in enumerate(counts) if count < FEWEST), None)]
        if not widths:
            return
        each = [fine_details(self.rows.read(CHANNELS, i, j), len(widths)) for i, j in ranges]
        for k, width in enumerate(widths):
            firsts, details = zip(*(of_range[k] for of_range, _ in each), strict=True)
            level = self._level(_even(np.hstack(details), counts[k]), counts[k], width)
            beyond = [
                start + first + width * _beyond(detail, *level)
                for start, first, detail in zip(ranges[:, 0], firsts, details, strict=True)
            ]
            yield width, level[0], np.concatenate(beyond)
        if len(widths) == len(fine):
            smooth = {start: rest for start, (_, rest) in zip(ranges[:, 0], each, strict=True)}
            yield from self._coarse(smooth, self.widths[len(fine) :])

    def _coarse(self, smooth, widths):
        """Yield the same of the scales above `FINE`; takes their smooth sequence by range."""
        shifts = [0]
        for width in widths:
            halved = {start: coarse_details(each, width) for start, each in smooth.items()}
            details = [detail for detail, _ in halved.values()]
            smooth = {start: rest for start, (_, rest) in halved.items()}
            # shift after shift, so that what is taken of them overlaps as little as all of them
            overlap = width // SPACING
            shifts = [shift + half for shift in shifts for half in (0, overlap // 2)]
            sample = np.hstack([each[:, s::overlap] for each in details for s in shifts])
            # only so many are independent
            if sample.shape[1] // overlap < FEWEST:
                return
            level = self._level(_even(sample, sample.shape[1]), sample.shape[1], width)
            first = [
                start + 2 + SPACING * _beyond(detail, *level)
                for start, detail in zip(smooth, details, strict=True)
            ]
            yield width, level[0], np.concatenate(first)

    def _level(self, sample, count, width):
        """Return covariance of a scale's coefficients and the bound of their squared distance."""
        covariance = robust_covariance(sample.T, self.floor)
        m = min(count // max(1, width // SPACING), sample.shape[1])
        bound = distance_beyond(self.false_alarm, K, m)
        return covariance, bound * (LONE_FACTOR**2 if width < LONE else 1.0)

    def _marks(self, first, width, covariance):
        """Return the ranges to cut; of wide supports only where the level changes most."""
        length = 3 * width - 2
        if length > self.guard:
            first = steepest(self.rows, first, width, covariance)
            length = width
        return np.column_stack([np.maximum(first - self.guard, 0), first + length + self.guard])


def _even(details, count):
    """Return every n-th coefficient, so that `MOST` of `count` remain."""
    return details[:, :: count // MOST + 1]


def _beyond(details, covariance, bound):
    """Return which coefficients have a squared distance beyond the bound."""
    return np.flatnonzero(squared_distance(details.T, covariance) > bound)


def steepest(rows, first, width, covariance):
    """Return where, in the support of each coefficient, the means of two halves differ most.

    Takes the first samples of the supports, in order, and the covariance of the coefficients,
    (6, 6); the halves are of half a scale each.
    """
    half, length, best = width // 2, 3 * width - 2, np.empty_like(first)
    # supports overlap: those in a part of the log are looked at together
    group = (first - first[0]) // max(length, TOGETHER)
    for members in np.split(np.arange(len(first)), np.flatnonzero(np.diff(group)) + 1):
        low, high = first[members[0]], first[members[-1]] + length
        total = np.zeros((K, high - low + 1))
        np.cumsum(rows.read(CHANNELS, low, high), axis=1, out=total[:, 1:])
        difference = total[:, width:] - 2 * total[:, half : half - width] + total[:, :-width]
        change = squared_distance(difference.T, covariance)
        for k in members:
            a = first[k] - low
            best[k] = first[k] + np.argmax(change[a : a + length - width + 1])
    return best
