"""Whether the angular rate at rest has the mean that it must have.

A gyroscope at rest shows its bias and Earth's rotation, and its noise has power at all low
frequencies. Firmware or a logger that follows the mean at rest and takes it away leaves neither:
the mean of W seconds is then smaller than noise of the level found within a second lets it be, or
smaller than Earth's rate. A bias makes both only larger, flicker and drift as well.

"""

import numpy as np
from scipy.special import chdtr, chdtri

from imuloop.core.gravity import EARTH_RATE
from imuloop.core.samples import ACCELERATION, CHANNELS
from imuloop.core.stretches import stretches_of

# means at rest are of blocks of at least so long (s) and so many rows, of so many parts that tell
# the noise; of so many blocks, a day and a half
BLOCK_TIME, BLOCK_ROWS, PARTS, MOST_BLOCKS = 1.0, 16, 4, 1 << 17
# a block rests where its variances are below so many times those of the quietest quarter
QUIET_BLOCK = 4.0
# what firmware needs until it has the mean does not count: this part of all rests, the first, and
# so many blocks of each
SETTLED, SETTLING = 0.25, 1
# noise of a row spans at least this part of a step, else a mean says little
LEAST_NOISE = 0.5
# power of the means is lacking where chance makes it as small so seldom, with so much room for an
# error of the noise level, and it is below this share
LEAST_CHANCE, ROOM, MOST_SHARE = 1e-5, 1.25, 0.5
# means and pairs of them needed; for Earth's rate, standard errors below a part of it
LEAST_MEANS, LEAST_PAIRS, SIGMAS, EARTH_PART = 24, 32, 6.0, 0.5


class RestMeans:
    """Means of the angular rate in blocks of about a second, over a log."""

    def __init__(self, rate):
        part = max(round(BLOCK_TIME * rate), BLOCK_ROWS) // PARTS
        self.rows, self.block_s = part * PARTS, part * PARTS / rate
        # per block: variance of the force; of each rate the variance and the mean of each part
        self.blocks, self.held = [], 0

    def add(self, x):
        """Take in a row group."""
        n = len(x["ax"]) // self.rows
        if not n or self.held >= MOST_BLOCKS:
            return
        columns, force = [], np.zeros(n)
        for name in CHANNELS:
            block = x[name][: n * self.rows].reshape(n, PARTS, -1)
            means = np.einsum("ijk->ij", block) / block.shape[2]
            power = np.einsum("ijk,ijk->i", block, block) / self.rows
            spread = power - means.mean(axis=1) ** 2
            # what rounding leaves of a channel that does not change
            spread[spread < 1e-12 * power] = 0.0
            if name in ACCELERATION:
                force += spread
            else:
                columns += [spread, means]
        self.blocks.append(np.column_stack([force, *columns]))
        self.held += n

    def figures(self, steps):
        """Return the mean rate at rest beside noise and Earth, as in quality.schema.yaml.

        `steps` are the quantisation steps of the three axes, rad/s, or None. Mean rate and bound
        are None where the rests are too short, all is None where there are none, or no noise.
        """
        if not self.blocks:
            return None
        blocks = np.concatenate(self.blocks)
        force, rates = blocks[:, 0], blocks[:, 1:].reshape(-1, 3, 1 + PARTS)
        spread, parts = rates[:, :, 0], rates[:, :, 1:]
        live = np.isfinite(blocks).all(axis=1) & (spread > 0).all(axis=1)
        if live.sum() < LEAST_PAIRS:
            return None
        rests = live & (force <= QUIET_BLOCK * np.quantile(force[live], 0.25))
        rests &= (spread <= QUIET_BLOCK * np.quantile(spread[live], 0.25, axis=0)).all(axis=1)
        noise = _white(parts[rests], self.block_s)
        least = [(LEAST_NOISE * (step or 0.0)) ** 2 for step in steps]
        coarse = not rests.any() or (np.median(spread[rests], axis=0) < least).any()
        if coarse or not (noise > 0).all():
            return None
        rests[: np.flatnonzero(rests)[int(SETTLED * rests.sum())]] = False
        means_of = [parts[a + SETTLING : b].mean(axis=2) for a, b in stretches_of(rests)]
        found = {"rate": None, "upper": None, "window_s": None, "noise_share": None}
        tracked, size = False, 1
        while any(len(rest) >= size for rest in means_of):
            means = [r[: len(r) // size * size].reshape(-1, size, 3).mean(axis=1) for r in means_of]
            every, window = np.concatenate(means), size * self.block_s
            power, n = (every**2 / noise).sum() * window, every.size
            if n >= LEAST_MEANS:
                found["noise_share"] = min(found["noise_share"] or np.inf, float(power / n))
                tracked |= power < MOST_SHARE * n and chdtr(n, ROOM * power) < LEAST_CHANCE
            # noise of neighbours is not the same, bias and Earth's rate are
            pairs = [m[: len(m) // 2 * 2].reshape(-1, 2, 3) for m in means]
            power = np.concatenate(pairs).prod(axis=1).sum(axis=1)
            if len(power) >= LEAST_PAIRS:
                upper = power.mean() + SIGMAS * power.std(ddof=1) / np.sqrt(len(power))
                rates = np.sqrt(np.maximum([power.mean(), upper], 0.0)).tolist()
                found |= {"rate": rates[0], "upper": rates[1], "window_s": window}
            size *= 2
        if found["upper"] is not None:
            tracked |= found["upper"] < EARTH_PART * EARTH_RATE
        return {**found, "tracked": bool(tracked)}


def _white(parts, block_s):
    """Return the white noise of each axis, (rad/s)^2/Hz: the least of two near averaging times."""
    if not len(parts):
        return np.zeros(3)
    halves = parts.reshape(*parts.shape[:2], 2, -1).mean(axis=3)
    # of a difference of two means the variance is twice theirs; medians pass over knocks
    return np.min(
        [
            np.median(np.diff(means, axis=2) ** 2, axis=(0, 2)) * block_s / means.shape[2]
            for means in (parts, halves)
        ],
        axis=0,
    ) / (2 * chdtri(1, 0.5))
