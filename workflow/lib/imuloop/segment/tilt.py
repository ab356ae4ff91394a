"""Tilts of a device that should rest: gravity changes its direction as the gyroscope says."""

import numpy as np

from imuloop.core.stretches import divided, lengths, merged, stretches_of
from imuloop.segment.windows import block_means

# length of a block whose samples are averaged, s, and most blocks of a session
BLOCK, BLOCKS = 2.0, 1 << 14
# shortest tilt, blocks
FEWEST = 8
# least turn of gravity by a tilt, rad: 5 mg
LEAST = 0.005
# largest ratio of the residual, which remains of the turn of gravity after the turn by the
# gyroscope is subtracted, to this turn of gravity, root mean squares
MOST_LEFT = 1 / 3
# length of a block of a short rest, s, and of the parts in which it is judged, s
SHORT_BLOCK, PART = 0.1, 2.0
# largest share of a rest that may be cut so that the remainder lies still
CUT = 0.2
# probability that any rest of a session that lies still is taken for tilted, and rounds in which
# the share of tilted parts is estimated
FALSE_ALARM, ROUNDS = 0.01, 10
# least share of the motion of gravity's direction that the gyroscope has to explain
SHARE = 0.7
# logarithm of the likelihood ratio below which a part within a rest counts as still: 20 to 1
SURE = 3.0


def tilts(rows, ranges, step):
    """Return the ranges of samples in which a device that should rest tilts slowly, (k, 2).

    A tilt is a slow turn about a horizontal axis. Both sensors see it. Let u be the specific force
    in units of its magnitude, r the angular rate and b the bias of the gyroscope. A tilt turns u by
    du/dt = u × (r - b). A drift of the accelerometer's bias changes u as well, but does not change
    r. So the change of u is compared with the turn that the gyroscope shows, ∫ u × (r - b) dt, in
    windows of all lengths. A window shows a tilt under two conditions: u changes by at least
    `LEAST`; and the change of u minus the turn that the gyroscope shows is at most the share
    `MOST_LEFT` of the change of u, both as root mean squares over the window.

    The comparison is made in two ways. First, the best line over time is subtracted from the change
    of u and from the turn, which removes any bias: this shows tilts that start or end in the
    window. Second, only the mean is subtracted, and b is the median rate: this shows steady tilts.
    Tilts slower than the drift of b are not seen. A ramp of the temperature that changes both
    biases is not taken for a tilt, because it makes the turn quadratic in time and u linear.

    If windows of several lengths show a tilt, the shortest is used. The result is the range of
    samples, within each window with a tilt, in which u changes.

    Parameters
    ----------
    rows : Samples
        The samples of a session.
    ranges : ndarray of int, shape (m, 2)
        Half-open ranges of samples at rest, which are searched.
    step : float
        Median time step, s.
    """
    width = max(round(BLOCK / step), int(lengths(ranges).sum()) // BLOCKS, 1)
    first, stretches, means = block_means(rows, ranges, width)
    size = np.median(np.linalg.norm(means[:, :3], axis=1)) if len(first) else 0.0
    # a specific force of zero has no direction
    if not size > 0:
        return np.empty((0, 2), dtype=int)
    # one magnitude for all blocks: a change of the magnitude is not a tilt and has to remain
    # visible
    u = means[:, :3] / size
    change = np.cross(u, means[:, 3:] - np.median(means[:, 3:], axis=0)) * width * step
    # the turn up to the middle of each block
    turned = np.cumsum(change, axis=0) - change / 2
    windows = np.concatenate([i + _find_windows(u[i:j], turned[i:j]) for i, j in stretches])
    if not len(windows):
        return windows
    cuts = merged(np.array([i + _changing_part(u[i:j]) for i, j in windows]))
    # from the first sample of the first block to the last sample of the last
    return np.column_stack([first[cuts[:, 0]], first[cuts[:, 1] - 1] + width])


def _find_windows(u, turned):
    """Return the shortest windows of blocks in which the device tilts by both sensors, (k, 2).

    A window is a half-open range of block numbers. In a window with a tilt, the specific force
    turns as the gyroscope says. `u`, (n, 3), is the direction of specific force in n blocks of
    samples. `turned`, (n, 3), is the change of u since the first block by the gyroscope, rad. u and
    `turned` are compared twice: after the best line is subtracted from both, and after only the
    mean is subtracted. Windows that overlap are merged.
    """
    chosen, length = np.empty((0, 2), dtype=int), FEWEST
    while length <= len(u):
        starts = np.arange(0, len(u) - length + 1, max(length // 4, 1))
        # blocks of each window, (number of windows, length)
        blocks = starts[:, None] + np.arange(length)
        tilted = np.zeros(len(starts), dtype=bool)
        for degree in (1, 0):
            # orthonormal basis of the lines, or of the constants
            basis = np.linalg.qr(np.vander(np.arange(length), degree + 1))[0]
            # mean square, in each window, of u and of u less the change that the gyroscope shows
            power, residual = (
                ((x - basis @ (basis.T @ x)) ** 2).sum(axis=2).mean(axis=1)
                for x in (u[blocks], (u - turned)[blocks])
            )
            # the mean square of a ramp about its mean is a twelfth of the square of its span
            tilted |= (power >= LEAST**2 / 12) & (residual <= MOST_LEFT**2 * power)
        windows = np.column_stack([starts, starts + length])[tilted]
        # a window that contains a shorter one is left out
        inside = (chosen[:, 0] >= windows[:, :1]) & (chosen[:, 1] <= windows[:, 1:])
        windows = windows[~inside.any(axis=1)]
        chosen = merged(np.concatenate([chosen, windows]))
        length *= 2
    return chosen


def _changing_part(u):
    """Return the range of blocks in which u changes from its first to its last value, (2,).

    The range is half-open. `u`, (n, 3), is the specific force in n blocks of samples, divided by
    its usual magnitude. The range starts with the last block before u is, for the first time, more
    than `LEAST` / 2 away from its first value. It ends with the first block from which on u stays
    within `LEAST` / 2 of its last value.
    """
    # blocks after u has left the first value, and before it reaches the last
    has_left, is_before = (np.linalg.norm(u - x, axis=1) > LEAST / 2 for x in (u[0], u[-1]))
    start = max(np.argmax(has_left) - 1, 0)
    return np.array([start, len(u) - max(np.argmax(is_before[::-1]) - 1, 0)])


def without_tilts(f, w, rests, bias, step):
    """Return m rests without the ends in which the device tilts, and the tilt of each rest.

    Each rest is divided into parts of about `PART` seconds. It is cut to its longest stretch of
    parts without a tilt, if that removes at most the share `CUT` of it; its tilt is then zero.
    Otherwise the rest is kept as it is, because a tilt changes the direction of gravity but not the
    norm, by which an accelerometer is calibrated. Its tilt is then the root mean square of the
    tilts in its parts.

    Parameters
    ----------
    f : ndarray, shape (3, n)
        Specific force, m/s².
    w : ndarray, shape (3, n)
        Angular rate, rad/s.
    rests : ndarray of int, shape (m, 2)
        Half-open ranges of samples of the rests.
    bias : ndarray, shape (3,)
        Bias of the gyroscope, rad/s.
    step : float
        Median time step, s.

    Returns
    -------
    ndarray of int, shape (m, 2)
        Ranges of samples of the rests, cut or as they were.
    ndarray, shape (m,)
        Tilt of each rest, rad.
    """
    kept, tilt = rests.copy(), np.zeros(len(rests))
    for k, (parts, tilts) in enumerate(rest_tilts(f, w, rests, bias, step)):
        # stretches of parts without a tilt, and the samples from the first part to the last
        still = stretches_of(tilts == 0)
        samples = np.column_stack([parts[still[:, 0], 0], parts[still[:, 1] - 1, 1]])
        if lengths(samples).max(initial=0) >= (1 - CUT) * (rests[k, 1] - rests[k, 0]):
            kept[k] = samples[np.argmax(lengths(samples))]
        else:
            tilt[k] = np.sqrt(np.mean(tilts**2))
    return kept, tilt


def rest_tilts(f, w, rests, bias, step):
    r"""Return a pair for each rest: its k parts, (k, 2), and the tilt in each part, rad, (k,).

    The result is a list. A part is a half-open range of samples of about `PART` seconds. A device
    may tilt during a rest on a soft surface or in a hand. The noise of the two sensors is
    independent, but both see a tilt. Let y be the direction of specific force minus its mean over a
    part, and let x be the same difference as the integral of the angular rate gives it; both are
    means over blocks of `SHORT_BLOCK` seconds. If the device lies still, y is only the noise of the
    accelerometer; if it tilts, y is x plus this noise. The logarithm of the likelihood ratio of a
    tilting device to a still one is

    .. math:: \sum_t \left[ y \cdot x - x^2 / 2 \right] / \sigma^2.

    The sum is over the blocks of the part, and σ is the standard deviation of the noise of y. If
    the device lies still, the logarithm exceeds log(1/p) with a probability below p, whatever the
    gyroscope shows (Markov's inequality). A part counts as tilting if the logarithm exceeds log(n /
    `FALSE_ALARM`), with n parts in the session. Since an accelerometer may drift, x also has to
    explain at least the share `SHARE` of Σ y² less the part of Σ y² that is noise.

    If some parts of a session tilt, others are more likely to tilt as well. So the limit is then
    lowered to log((1 - q)/q), where q is the share of parts that tilt. The first parts of all rests
    have one q, and the other parts have another. For the other parts the limit is never below
    `SURE`. The tilt of a part is 0 if it lies still, else the root mean square of x.

    Parameters
    ----------
    f : ndarray, shape (3, n)
        Specific force, m/s².
    w : ndarray, shape (3, n)
        Angular rate, rad/s.
    rests : ndarray of int, shape (m, 2)
        Half-open ranges of samples of the m rests.
    bias : ndarray, shape (3,)
        Bias of the gyroscope, rad/s.
    step : float
        Median time step, s.
    """
    if not len(rests):
        return []
    width = max(round(SHORT_BLOCK / step), 1)
    length = max(round(PART / step), 4 * width)
    parts = [divided(i, j, (j - i) // length) for i, j in rests]
    # whether a part is the first of its rest
    begins = np.concatenate([np.arange(len(ranges)) == 0 for ranges in parts])
    # y and x in the blocks of each part
    changes = [_block_changes(f, w, i, j, bias, width, step) for i, j in np.concatenate(parts)]
    # σ² of a component: neighbouring blocks differ by noise only, as a tilt is slow
    noise = np.median([np.mean(np.diff(y, axis=0) ** 2) / 2 for y, _ in changes if len(y) > 1])
    # the logarithm of the likelihood ratio, times σ²
    gain = np.array([np.sum(y * x - x**2 / 2) for y, x in changes])
    size = np.array([np.sqrt((x**2).sum(axis=1).mean()) for _, x in changes])
    # sum of the squares of y without noise, and three standard deviations of it
    power, count = np.transpose([(np.sum(y**2), y.size) for y, _ in changes])
    signal = np.maximum(power - noise * count, 0.0)
    chance = 3 * np.sqrt(2 * count * noise**2 + 4 * noise * signal)
    # the gyroscope explains Σ y² - Σ (y - x)² = 2 Σ (y·x - x²/2)
    gain[2 * gain < SHARE * (signal - chance)] = -np.inf
    tilted = gain > noise * np.log(len(gain) / FALSE_ALARM)
    for _ in range(ROUNDS):
        for group, least in ((begins, 0.0), (~begins, SURE)):
            share = tilted[group].mean() if group.any() else 0.0
            if 0 < share < 1:
                tilted[group] = gain[group] > noise * max(np.log((1 - share) / share), least)
    by_rest = np.split(np.where(tilted, size, 0.0), np.flatnonzero(begins)[1:])
    return list(zip(parts, by_rest, strict=True))


def _block_changes(f, w, first, last, bias, width, step):
    """Return the change of gravity's direction in b blocks, rad, by each sensor, two arrays (b, 3).

    The first array is the change by the accelerometer, the second the change by the gyroscope, both
    on body axes and relative to their mean over all blocks. The second array is ``ū × (δ - δ̄)``. ū
    is the mean direction of specific force, δ is the integral of the angular rate less the bias,
    and δ̄ is the mean of δ.

    Parameters
    ----------
    f : ndarray, shape (3, n)
        Specific force, m/s².
    w : ndarray, shape (3, n)
        Angular rate, rad/s.
    first, last : int
        Half-open range of samples that is divided into blocks.
    bias : ndarray, shape (3,)
        Bias of the gyroscope, rad/s.
    width : int
        Samples in a block.
    step : float
        Median time step, s.
    """
    blocks = divided(first, last, (last - first) // width) - first
    rotation = np.cumsum((w[:, first:last].T - bias) * step, axis=0)
    # means over the blocks
    force, rotation = (
        np.add.reduceat(x, blocks[:, 0], axis=0) / np.diff(blocks)
        for x in (f[:, first:last].T, rotation)
    )
    mean_force = force.mean(axis=0)
    size = np.linalg.norm(mean_force)
    by_gyroscope = np.cross(mean_force / size, rotation - rotation.mean(axis=0))
    return (force - mean_force) / size, by_gyroscope
