"""Tilts of a device that should rest: gravity's direction turns as the gyroscope says."""

import numpy as np

from imuloop.core.stretches import divided, lengths, merged, stretches_of
from imuloop.segment.windows import block_means

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

    Less a line, so that no bias enters, both courses of a window show a tilt that begins or ends;
    less their mean, with the median of the rates for b, a steady tilt shows by its slope. Slower
    than b wanders none is seen. Of a tilt that shows in windows of several lengths the
    shortest is taken, and in it the part in which u moves. Takes Samples and the median step, s.
    """
    width = max(round(BLOCK / step), int(lengths(ranges).sum()) // BLOCKS, 1)
    first, stretches, means = block_means(rows, ranges, width)
    size = np.median(np.linalg.norm(means[:, :3], axis=1)) if len(first) else 0.0
    # of rows that are zero there is no direction
    if not size > 0:
        return np.empty((0, 2), dtype=int)
    # not its direction alone: a tilt leaves the magnitude as it is
    u = means[:, :3] / size
    change = np.cross(u, means[:, 3:] - np.median(means[:, 3:], axis=0)) * width * step
    turned = np.cumsum(change, axis=0) - change / 2
    windows = np.concatenate([i + _alike(u[i:j], turned[i:j]) for i, j in stretches])
    if not len(windows):
        return windows
    cuts = merged(np.array([i + _placed(u[i:j]) for i, j in windows]))
    return np.column_stack([first[cuts[:, 0]], first[cuts[:, 1] - 1] + width])


def _alike(u, turned):
    """Return the shortest windows of blocks in which two courses are alike, shape (k, 2).

    Of both a line is left out, or the mean.
    """
    alike, length = np.empty((0, 2), dtype=int), FEWEST
    while length <= len(u):
        starts = np.arange(0, len(u) - length + 1, max(length // 4, 1))
        at = starts[:, None] + np.arange(length)
        sure = np.zeros(len(starts), dtype=bool)
        for degree in (1, 0):
            basis = np.linalg.qr(np.vander(np.arange(length), degree + 1))[0]
            power, residual = (
                ((x - basis @ (basis.T @ x)) ** 2).sum(axis=2).mean(axis=1)
                for x in (u[at], (u - turned)[at])
            )
            # a ramp has a root mean square of a twelfth's root of its span
            sure |= (power >= LEAST**2 / 12) & (residual <= MOST_LEFT**2 * power)
        windows = np.column_stack([starts, starts + length])[sure]
        # those that a shorter one lies in are placed already
        inside = (alike[:, 0] >= windows[:, :1]) & (alike[:, 1] <= windows[:, 1:])
        windows = windows[~inside.any(axis=1)]
        alike = merged(np.concatenate([alike, windows])) if len(windows) else alike
        length *= 2
    return alike


def _placed(u):
    """Return from where on a direction is no longer that of the start, and up to where the end's.

    The window says that the device tilted; where, the accelerometer knows better.
    """
    after, before = (np.linalg.norm(u - each, axis=1) > LEAST / 2 for each in (u[0], u[-1]))
    return np.array([max(np.argmax(after) - 1, 0), len(u) - max(np.argmax(before[::-1]) - 1, 0)])


def without_tilts(f, w, rests, bias, step):
    """Return rests less the ends in which the device tilts, and the tilt that each still has, rad.

    A rest keeps the longest stretch of its parts without a tilt, if no more than `CUT` of it is
    lost: a tilt changes gravity's direction, not its norm. Else it keeps all, with the root mean
    square of its tilt. Arguments as in `rest_tilts`.
    """
    kept, tilt = rests.copy(), np.zeros(len(rests))
    for k, (parts, tilts) in enumerate(rest_tilts(f, w, rests, bias, step)):
        still = stretches_of(tilts == 0)
        spans = parts[still[:, 1] - 1, 1] - parts[still[:, 0], 0]
        if spans.max(initial=0) >= (1 - CUT) * (rests[k, 1] - rests[k, 0]):
            first, end = still[np.argmax(spans)]
            kept[k] = parts[first, 0], parts[end - 1, 1]
        else:
            tilt[k] = np.sqrt(np.mean(tilts**2))
    return kept, tilt


def rest_tilts(f, w, rests, bias, step):
    r"""Return the parts of each rest, (k, 2), and how far the device tilts in each, rad, (k,).

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
    to 1. A part that lies still has the tilt 0, else its root mean square about its mean.

    Takes specific force, m/s², and angular rate, rad/s, (3, n), ranges of samples, (m, 2), the
    gyroscope's bias, rad/s, (3,), and the step of time, s.
    """
    if not len(rests):
        return []
    width = max(round(SHORT_BLOCK / step), 1)
    length = max(round(PART / step), 4 * width)
    parts = [divided(i, j, (j - i) // length) for i, j in rests]
    begins = np.concatenate([np.arange(len(each)) == 0 for each in parts])
    courses = [_courses(f, w, i, j, bias, width, step) for i, j in np.concatenate(parts)]
    # neighbours differ by noise, and by little of a tilt
    noise = np.median([np.mean(np.diff(y, axis=0) ** 2) / 2 for y, _ in courses if len(y) > 1])
    gain = np.array([np.sum(y * x - x**2 / 2) for y, x in courses])
    size = np.array([np.sqrt((x**2).sum(axis=1).mean()) for _, x in courses])
    # an accelerometer drifts, too: what is left has to be noise, but for three standard deviations
    power, count = np.transpose([(np.sum(y**2), y.size) for y, _ in courses])
    signal = np.maximum(power - noise * count, 0.0)
    chance = 3 * np.sqrt(2 * count * noise**2 + 4 * noise * signal)
    gain[2 * gain < SHARE * (signal - chance)] = -np.inf
    tilted = gain > noise * np.log(len(gain) / FALSE_ALARM)
    # a surface that is soft is soft each time: then the odds before the data are the share of
    # those found, of parts that begin a rest by themselves
    for _ in range(ROUNDS):
        for alike, least in ((begins, 0.0), (~begins, SURE)):
            if 0 < (share := tilted[alike].mean() if alike.any() else 0) < 1:
                tilted[alike] = gain[alike] > noise * max(np.log(1 / share - 1), least)
    tilts = np.split(np.where(tilted, size, 0.0), np.flatnonzero(begins)[1:])
    return list(zip(parts, tilts, strict=True))


def _courses(f, w, first, last, bias, width, step):
    """Return the course of gravity's direction, and that which the gyroscope gives it, (b, 3)."""
    blocks = divided(first, last, (last - first) // width) - first
    turned = np.cumsum((w[:, first:last].T - bias) * step, axis=0)
    u, turned = (
        np.add.reduceat(x, blocks[:, 0], axis=0) / np.diff(blocks)
        for x in (f[:, first:last].T, turned)
    )
    mean = u.mean(axis=0)
    size = np.linalg.norm(mean)
    return (u - mean) / size, np.cross(mean / size, turned - turned.mean(axis=0))
