"""Slow tilts in a static session: gravity turns, and the gyroscope turns it as well."""

import numpy as np

from imuloop.core.samples import CHANNELS
from imuloop.segment.stretches import lengths, merged, without

# blocks that are averaged, s, and at most so many in a session
BLOCK, BLOCKS = 2.0, 1 << 14
# shortest tilt, blocks
FEWEST = 8
# a tilt turns gravity by at least so much, rad: 5 mg
LEAST = 0.005
# what is left of gravity's turn where the gyroscope's is taken from it, of its root mean square
MOST_LEFT = 1 / 3


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
