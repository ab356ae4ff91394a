"""Errors of rotations by lost samples and late stamps, measured on the motion itself.

Over a gap the rate is the cubic through the two samples on either side (`mean_rates`). Where the
same rotation lost nothing, samples are left out as in the gap and the interpolation is compared
with what they say: the mean square of the difference is the error of the gap, what the motion bends
and what the noise of fewer samples adds. All windows of the rotation count, so it is that of a loss
that does not wait for a moment of the motion.

Stamps that scatter, of samples that are even, have their own error (`core.stamps`).
"""

from dataclasses import dataclass

import numpy as np

from imuloop.calibrate.undersampling import outer_products
from imuloop.core.errors import plural
from imuloop.core.gaps import gap_limit, lost_samples
from imuloop.core.rotation import mean_rates
from imuloop.core.stamps import Scatter, bend

# windows of a rotation that determine the error of a gap
FEWEST = 10
# error, share of the angle, beyond which a rotation says nothing: as they come, sensors are off
# by less
TELLING = 0.05
# scatter of stamps, share of a step, that counts
LATE = 0.02


@dataclass(frozen=True)
class Lost:
    """Rotations lost to gaps, of all that are short enough to be used.

    They are left out as a gap is too long, or its error not known or too large; `longest` is the
    most samples lost in a row in one of them. Others are left out as the angular rate is `clipped`.
    Rests are left out as the specific force is: `railed` of them. Turns that contradict all others
    are left out too: session, start and end, s, and by how much, rad, of each.
    """

    rotations: int = 0
    left_out: int = 0
    longest: int = 0
    clipped: int = 0
    railed: int = 0
    contradicting: tuple = ()

    @property
    def reason(self):
        """Why they were left out, in words; empty where none was."""
        reasons = ""
        if self.left_out:
            samples = f"{self.longest} sample{'s' * (self.longest != 1)} in a row"
            reasons = f"; {self.left_out} of {self.rotations} turns lost up to {samples} and are "
            reasons += "left out"
        if self.clipped:
            reasons += (
                f"; {self.clipped} of {self.rotations} turns reached the end of the gyroscope's "
                "range and are left out: choose a wider range or turn more slowly"
            )
        return reasons

    @property
    def rests_reason(self):
        """Why rests were left out, in words; empty where none was."""
        if not self.railed:
            return ""
        return (
            f"; {plural(self.railed, 'rest')} at the end of the accelerometer's range left out: "
            "choose a wider range"
        )


def errors_of_time(t, w, begin, last, bias, variance):
    """Return the errors that time stamps bring into rotations.

    Of each rotation steps about which an error is added to the turn, (g,), and its covariance,
    rad², (g, 3, 3): first those over which samples are missing. None where `gap_covariance` is not
    known, or where the root of its trace is above that of the noise and above `TELLING` of the
    angle. Then the samples lost in a row, at most, in each, (m,).

    Takes time, s, (N,), and angular rate, rad/s, (N, 3), of a log, the first and the last sample of
    each rotation, (m,), the mean of the angular rate at rest, and the variance of a sample,
    (rad/s)², (m, 3) each.
    """
    steps = np.diff(t)
    usual = np.median(steps)
    lost = lost_samples(steps, usual)
    late = _lateness(t, w, usual)
    found, longest = [], []
    for i, j, rest, noise in zip(begin, last, bias, variance, strict=True):
        own, turn = lost[i:j], w[i : j + 1]
        longest.append(own.max(initial=0))
        gaps = gap_covariance(turn, own, usual)
        angle = np.linalg.norm(turn[1:] - rest, axis=1) @ steps[i:j]
        most = max(noise.sum() * usual * steps[i:j].sum(), (TELLING * angle) ** 2)
        if gaps is None or np.trace(gaps.sum(axis=0)) > most:
            found.append(None)
        else:
            parts, scatter = _late_covariance(turn, late)
            at = np.append(np.flatnonzero(own), parts)
            found.append((at, np.concatenate([gaps, scatter])))
    return found, np.array(longest, dtype=int)


def _lateness(t, w, usual):
    """Return the standard deviation of a stamp, s; 0 of one that is right, or wrong by little."""
    # of a normal e the median of |e| is 0.6745 of its deviation; e less the mean of two others
    std = np.median(np.abs(bend(t))) / 0.6745 / np.sqrt(1.5) if len(t) > 2 else 0.0
    if std < LATE * usual:
        return 0.0
    scatter = Scatter(usual)
    scatter.add(t, w.T)
    return 0.0 if scatter.followed else std


def _late_covariance(w, late):
    """Return what stamps that scatter add to a rotation, in parts: their middles, and (p, 3, 3).

    A stamp that is late by e gives the step before it e more at the rate before, and the step after
    it as much less: e times half of what the rate changes over both.
    """
    if not late:
        return np.zeros(0, int), np.zeros((0, 3, 3))
    at, squares = outer_products((w[2:] - w[:-2]) / 2)
    return at, late**2 * squares


def gap_covariance(w, lost, usual):
    """Return the covariance of the turn over each gap that interpolation adds, rad², (g, 3, 3).

    None where too little of the rotation is whole. Takes angular rate, rad/s, shape (k, 3), the
    samples missing in each step, (k - 1,), and the usual step, s.
    """
    sizes = {n: _mean_square(w, lost, n, usual) for n in np.unique(lost[lost > 0]).tolist()}
    if any(size is None for size in sizes.values()):
        return None
    return np.array([sizes[n] for n in lost[lost > 0].tolist()]).reshape(-1, 3, 3)


def _mean_square(w, lost, n, usual):
    """Return the mean square of the error of a gap of n samples, (3, 3), or None of too few."""
    # a window: the step before, those of the gap, the step after
    whole = np.convolve(lost == 0, np.ones(n + 3), "valid") > n + 2.5
    first = np.flatnonzero(whole) + 1
    if len(first) < FEWEST:
        return None
    turned = usual * np.cumsum(mean_rates(w, np.full(len(w) - 1, usual)), axis=0)
    around = np.stack([w[first + i] for i in (-1, 0, n + 1, n + 2)], axis=1)
    steps = np.tile(usual * np.array([1.0, n + 1, 1.0]), (len(first), 1))
    over = mean_rates(around, steps, steps > gap_limit(usual))[:, 1] * steps[:, 1:2]
    error = over - (turned[first + n] - turned[first - 1])
    return error.T @ error / len(first)
