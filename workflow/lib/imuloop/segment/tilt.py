"""Tilts of a device that should rest: gravity turns, and the gyroscope turns it as well."""

import numpy as np

from imuloop.core.samples import CHANNELS
from imuloop.segment.stretches import lengths, merged, runs, without

# blocks that are averaged, s, and at most so many in a session
BLOCK, BLOCKS = 2.0, 1 << 14
# shortest tilt, blocks
FEWEST = 8
# a tilt turns gravity by at least so much, rad: 5 mg
LEAST = 0.005
# what is left of gravity's turn where the gyroscope's is taken from it, of its root mean square
MOST_LEFT = 1 / 3
# blocks of a short rest, s, and parts in which it is judged, s
SHORT_BLOCK, PART = 0.1, 2.0
# share of a rest whose samples may be cut for what is left to lie still
CUT = 0.2
# that any rest of a session that lies still is taken for tilted, and rounds of the odds' estimate
FALSE_ALARM, ROUNDS = 0.01, 10
# share of what gravity's direction does that the gyroscope has to explain
SHARE = 0.7
# logarithm of the ratio of likelihoods below which the midst of a rest counts as still: 20 to 1
SURE = 3.0


def tilts(rows, ranges, step):
    """Return the parts of ranges at rest, (m, 2), in which the device tilted slowly, (k, 2).

    A bias that drifts moves the specific force, u in units of its magnitude, and no gyroscope
    follows; a tilt turns u as it turns the gyroscope, du/dt = u × (r - b). Over windows of every
    length, the course of u is compared with that of ∫ u × (r - b) dt: what the second leaves of the
    first has to be small against the first, course for course. A ramp of temperature that drags
    both biases along bends the integral where it does not bend u.

    First a line is taken from both courses of a window, so that no bias enters: this shows a tilt
    that begins or ends. In what is left b is the median, and a steady tilt shows by its slope.
    Slower than b wanders none is seen. Of a tilt that shows in windows of several lengths the
    shortest is taken, and in it the part in which u moves. Takes Samples and the median step, s.
    """
    width = max(round(BLOCK / step), int(lengths(ranges).sum()) // BLOCKS, 1)
    means = [_block_means(rows, i, j, width) for i, j in ranges]
    # of all blocks, one range after the other
    edges = np.cumsum([0, *map(len, means)])
    stretches = np.column_stack([edges[:-1], edges[1:]])
    means = np.concatenate([np.empty((0, len(CHANNELS))), *means])
    # not its direction alone: a tilt leaves the magnitude as it is
    u = means[:, :3] / np.median(np.linalg.norm(means[:, :3], axis=1)) if len(means) else means
    cuts = np.empty((0, 2), dtype=int)
    for degree in (1, 0):
        rests = without(stretches, cuts)
        if not len(rests):
            break
        bias = np.median(np.concatenate([means[i:j, 3:] for i, j in rests]), axis=0)
        change = np.cross(u, means[:, 3:] - bias) * width * step
        turned = np.cumsum(change, axis=0) - change / 2
        windows = np.concatenate([i + _alike(u[i:j], turned[i:j], degree) for i, j in rests])
        if len(windows):
            placed = np.array([i + _placed(u[i:j]) for i, j in windows])
            cuts = merged(np.concatenate([cuts, placed]))
    # blocks of a range, and the samples that it begins with
    at = np.searchsorted(edges, cuts[:, 0], side="right") - 1
    return cuts * width + (ranges[at, 0] - edges[at] * width)[:, None]


def _block_means(rows, first, last, width):
    """Return the means of all channels over whole blocks of a range, shape (n, 6)."""
    n = (last - first) // width
    means = np.empty((n, len(CHANNELS)))
    # a piece of whole blocks at a time
    size = max((1 << 17) // width, 1)
    for k in range(0, n, size):
        m = min(size, n - k)
        x = rows.read(CHANNELS, first + k * width, first + (k + m) * width)
        means[k : k + m] = x.reshape(len(CHANNELS), m, width).mean(axis=2).T
    return means


def _alike(u, turned, degree):
    """Return the shortest windows of blocks in which two courses are alike, shape (k, 2).

    Both are taken about their mean, or about their line where the degree is one.
    """
    found, length = np.empty((0, 2), dtype=int), FEWEST
    while length <= len(u):
        starts = np.arange(0, len(u) - length + 1, max(length // 4, 1))
        at = starts[:, None] + np.arange(length)
        power, left = (_power(x[at], degree) for x in (u, u - turned))
        # a ramp has a root mean square of a twelfth's root of its span
        sure = (power >= LEAST**2 / 12) & (left <= MOST_LEFT**2 * power)
        windows = np.column_stack([starts, starts + length])[sure]
        # those that a shorter one lies in are placed already
        inside = (found[:, 0] >= windows[:, :1]) & (found[:, 1] <= windows[:, 1:])
        windows = windows[~inside.any(axis=1)]
        found = merged(np.concatenate([found, windows])) if len(windows) else found
        length *= 2
    return found


def _placed(u):
    """Return from where on a direction is no longer that of the start, and up to where the end's.

    The window says that the device tilted; where, the accelerometer knows better.
    """
    left, coming = (np.linalg.norm(u - each, axis=1) > LEAST / 2 for each in (u[0], u[-1]))
    return np.array([max(np.argmax(left) - 1, 0), len(u) - max(np.argmax(coming[::-1]) - 1, 0)])


def _power(x, degree):
    """Return the mean square of vectors about their mean or line, x of shape (k, n, 3)."""
    x = x - x.mean(axis=1, keepdims=True)
    if degree:
        t = np.arange(x.shape[1]) - (x.shape[1] - 1) / 2
        x = x - t[:, None] * (np.einsum("n,kni->ki", t, x) / (t @ t))[:, None]
    return (x**2).sum(axis=2).mean(axis=1)


def rest_tilts(f, w, rests, bias, step):
    r"""Return how far the device tilts within each part of each rest, rad; 0 where it lies still.

    What a sensor's noise does the other sensor's does not. With the direction u of specific force
    and δ the integral of the angular rate less its bias, both less their means over a part, a
    device that tilts has u = u₀ + u₀ × δ and one that lies still u = u₀. The logarithm of the
    ratio of the likelihoods of the two, by the noise σ of a block mean of u,

    .. math:: \sum_t \left[ y \cdot x - x^2 / 2 \right] / \sigma^2,
        \quad y = u - \bar u, \quad x = \bar u × (δ - \bar δ),

    is above log(1/p) with a probability of less than p where the device lies still, whatever the
    gyroscope does (Markov's inequality). A soft surface that settles and a hand show that way.
    An accelerometer may drift: the gyroscope has to explain `SHARE` of y beside its noise.
    Where some do, others are taken for tilted if that is more likely than not; amid a rest, by 20
    to 1.

    Parameters
    ----------
    f, w : ndarray, shape (3, n)
        Specific force, m/s^2, and angular rate, rad/s.
    rests : ndarray, shape (m, 2)
        Ranges of samples.
    bias : array_like, shape (3,)
        Of the angular rate, rad/s.
    step : float
        Time step, s.

    Returns
    -------
    parts : list of ndarray, shape (k, 2)
        Ranges of samples of each rest, some `PART` long.
    tilts : list of ndarray, shape (k,)
        Root mean square of the tilt about its mean in each part, rad.
    """
    width = max(round(SHORT_BLOCK / step), 1)
    parts = [_parts_of(i, j, max(round(PART / step), 4 * width)) for i, j in rests]
    seen = [[_seen(f, w, i, j, bias, width, step) for i, j in each] for each in parts]
    every = [y for each in seen for y, _ in each]
    if not every:
        return parts, []
    # neighbours differ by noise, and by little of a tilt
    noise = np.median([np.mean(np.diff(y, axis=0) ** 2) / 2 for y in every if len(y) > 1] or [0.0])
    gain = np.concatenate([[np.sum(y * x - x**2 / 2) for y, x in each] for each in seen])
    # an accelerometer drifts, too: what is left has to be noise, but for three standard deviations
    power, count = np.transpose([(np.sum(y**2), y.size) for each in seen for y, _ in each])
    signal = np.maximum(power - noise * count, 0.0)
    chance = 3 * np.sqrt(2 * count * noise**2 + 4 * noise * signal)
    gain[2 * gain < SHARE * (signal - chance)] = -np.inf
    size = np.concatenate([[np.sqrt((x**2).sum(axis=1).mean()) for _, x in each] for each in seen])
    tilted = gain > noise * np.log(len(gain) / FALSE_ALARM)
    # a surface that is soft is soft each time: then the odds before the data are the share of
    # those found, of parts that begin a rest by themselves
    begins = np.concatenate([np.arange(len(each)) == 0 for each in parts])
    for _ in range(ROUNDS):
        for alike, least in ((begins, 0.0), (~begins, SURE)):
            if 0 < (share := tilted[alike].mean() if alike.any() else 0) < 1:
                tilted[alike] = gain[alike] > noise * max(np.log(1 / share - 1), least)
    ends = np.cumsum([len(each) for each in parts])[:-1]
    return parts, np.split(np.where(tilted, size, 0.0), ends)


def _parts_of(first, last, length):
    """Return a range in parts of about a length, (k, 2)."""
    edges = np.linspace(first, last, max((last - first) // length, 1) + 1).astype(int)
    return np.column_stack([edges[:-1], edges[1:]])


def _seen(f, w, first, last, bias, width, step):
    """Return the course of gravity's direction, and that which the gyroscope gives it, (b, 3)."""
    count = max((last - first) // width, 1)
    edges = np.linspace(first, last, count + 1).astype(int)
    turned = np.cumsum((w[:, first:last].T - bias) * step, axis=0)
    lengths = np.diff(edges)[:, None]
    u = np.add.reduceat(f[:, first:last].T, edges[:-1] - first, axis=0) / lengths
    turned = np.add.reduceat(turned, edges[:-1] - first, axis=0) / lengths
    mean = u.mean(axis=0)
    size = np.linalg.norm(mean)
    if not size:
        return np.zeros_like(u), np.zeros_like(u)
    return (u - mean) / size, np.cross(mean / size, turned - turned.mean(axis=0))


def steady_rests(f, w, rests, bias, step):
    """Return rests less the ends in which the device tilts, and the tilt that each still has, rad.

    A rest keeps the longest run of its parts without a tilt, if no more than `CUT` of it is lost:
    a tilt changes gravity's direction, not its norm. Else it keeps all, with the root mean square
    of its tilt. Arguments as of `rest_tilts`.
    """
    kept, left = [], []
    for parts, tilts in zip(*rest_tilts(f, w, rests, bias, step), strict=True):
        still = runs(tilts == 0)
        spans = parts[still[:, 1] - 1, 1] - parts[still[:, 0], 0] if len(still) else np.zeros(0)
        if spans.max(initial=0) >= (1 - CUT) * (parts[-1, 1] - parts[0, 0]):
            longest = still[np.argmax(spans)]
            kept.append((parts[longest[0], 0], parts[longest[1] - 1, 1]))
            left.append(0.0)
        else:
            kept.append((parts[0, 0], parts[-1, 1]))
            left.append(np.sqrt(np.mean(tilts**2)))
    return np.array(kept, dtype=int).reshape(-1, 2), np.array(left)
