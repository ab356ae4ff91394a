"""Errors of rotations by dropped samples and jitter of time stamps, measured on the motion itself.

Over a gap, the angular rate is interpolated by the cubic through the two samples on either side
(`mean_rates`). The error of this interpolation is measured in the parts of the same rotation that
have all samples: as many samples as in the gap are left out, and the interpolated angle is compared
with the angle of all samples. The mean square difference over all such windows is the covariance of
the gap. It includes both the curvature of the motion and the noise of fewer samples, and assumes
that samples are dropped independently of the motion.

Time stamps with jitter, of samples that were taken at even steps, add an error of their own
(`ingest.jitter`).
"""

from dataclasses import dataclass

import numpy as np

from imuloop.calibrate.undersampling import outer_products
from imuloop.core.errors import plural
from imuloop.core.gaps import gap_limit, lost_samples
from imuloop.core.rotation import mean_rates
from imuloop.ingest.jitter import JitterTest, bend

# fewest windows of a rotation that determine the error of a gap
FEWEST = 10
# error, share of the angle, above which a rotation is useless: uncalibrated sensors are better
LARGEST_ERROR = 0.05
# standard deviation of the jitter, share of a step, below which it is neglected
LEAST_JITTER = 0.02


@dataclass(frozen=True)
class Lost:
    """Numbers of the rotations and rests that are not used, and why."""

    rotations: int = 0  # all rotations that are short enough to be used
    left_out: int = 0  # those with a gap that is too long, or whose error is unknown or too large
    longest: int = 0  # largest number of samples dropped in a row in one of these
    clipped: int = 0  # rotations whose angular rate is clipped
    railed: int = 0  # rests whose specific force is clipped
    # rotations that contradict all others: session, start and end, s, and contradiction, rad, of
    # each
    contradicting: tuple = ()

    @property
    def reason(self):
        """Why rotations were left out, text; empty if none was."""
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
        """Why rests were left out, text; empty if none was."""
        if not self.railed:
            return ""
        return (
            f"; {plural(self.railed, 'rest')} at the end of the accelerometer's range left out: "
            "choose a wider range"
        )


def errors_of_time(t, w, begin, last, bias, variance):
    """Return the errors of rotations by dropped samples and by jitter of the time stamps.

    Parameters
    ----------
    t, w : ndarray, shape (N,), (N, 3)
        Time, s, and angular rate, rad/s, of the whole log.
    begin, last : ndarray of int, shape (m,)
        First and last sample of each rotation.
    bias, variance : ndarray, shape (m, 3)
        Mean, rad/s, and sample variance, (rad/s)², of the angular rate at rest.

    Returns
    -------
    errors : list
        For each rotation, the steps in which an error arises, (g,), and the covariance of each
        error as a rotation vector, rad², (g, 3, 3); the errors of gaps come first. None if
        `gap_covariance` gives none, or if the standard deviation of the angle by all gaps is larger
        than both that by the noise and `LARGEST_ERROR` of the angle.
    longest : ndarray of int, shape (m,)
        Largest number of samples dropped in a row.
    """
    steps = np.diff(t)
    usual = np.median(steps)
    lost = lost_samples(steps, usual)
    jitter = _estimate_jitter(t, w, usual)
    errors, longest = [], []
    for i, j, rest, noise in zip(begin, last, bias, variance, strict=True):
        lost_here, rates = lost[i:j], w[i : j + 1]
        longest.append(lost_here.max(initial=0))
        gaps = gap_covariance(rates, lost_here, usual)
        angle = np.linalg.norm(rates[1:] - rest, axis=1) @ steps[i:j]
        limit = max(noise.sum() * usual * steps[i:j].sum(), (LARGEST_ERROR * angle) ** 2)
        if gaps is None or np.trace(gaps.sum(axis=0)) > limit:
            errors.append(None)
        else:
            parts, by_jitter = _jitter_covariance(rates, jitter)
            places = np.append(np.flatnonzero(lost_here), parts)
            errors.append((places, np.concatenate([gaps, by_jitter])))
    return errors, np.array(longest, dtype=int)


def _estimate_jitter(t, w, usual):
    """Return the standard deviation of the jitter of time stamps, s.

    Zero if the samples were taken at their time stamps, or if the jitter is below `LEAST_JITTER`.
    Takes time, s, (N,), angular rate, rad/s, (N, 3), and the usual step, s.
    """
    # the median of |e| of a normal variable e is 0.6745 of its standard deviation; `bend` adds half
    # of the variance, as it subtracts the mean of two neighbours
    std = np.median(np.abs(bend(t))) / 0.6745 / np.sqrt(1.5) if len(t) > 2 else 0.0
    if std < LEAST_JITTER * usual:
        return 0.0
    test = JitterTest(usual)
    test.add(t, w.T)
    return 0.0 if test.followed else std


def _jitter_covariance(w, jitter):
    """Return the steps, (p,), and the covariance, rad², (p, 3, 3), of the errors by jitter.

    A time stamp that is late by e makes the step before it longer by e and the step after it
    shorter by e. The angle is then wrong by e times half the change of the rate over both steps.
    The errors are summed over p parts of the rotation. Takes angular rate, rad/s, (k, 3), and the
    standard deviation of the jitter, s.
    """
    if not jitter:
        return np.zeros(0, int), np.zeros((0, 3, 3))
    middles, squares = outer_products((w[2:] - w[:-2]) / 2)
    return middles, jitter**2 * squares


def gap_covariance(w, lost, usual):
    """Return the covariance of the rotation over each gap by interpolation, rad², (g, 3, 3).

    None if too little of the rotation has all samples. Takes angular rate, rad/s, (k, 3), the
    number of samples missing in each step, (k - 1,), and the usual step, s.
    """
    sizes = {n: _mean_square(w, lost, n, usual) for n in np.unique(lost[lost > 0]).tolist()}
    if any(size is None for size in sizes.values()):
        return None
    return np.array([sizes[n] for n in lost[lost > 0].tolist()]).reshape(-1, 3, 3)


def _mean_square(w, lost, n, usual):
    """Return the mean square error of interpolation over gaps of n samples, rad², (3, 3).

    None if fewer than `FEWEST` windows have all samples. Arguments as for `gap_covariance`, and n.
    """
    # a window has the step before the gap, the n + 1 steps of the gap, and the step after it
    complete = np.convolve(lost == 0, np.ones(n + 3), "valid") > n + 2.5
    first = np.flatnonzero(complete) + 1
    if len(first) < FEWEST:
        return None
    turned = usual * np.cumsum(mean_rates(w, np.full(len(w) - 1, usual)), axis=0)
    around = np.stack([w[first + i] for i in (-1, 0, n + 1, n + 2)], axis=1)
    steps = np.tile(usual * np.array([1.0, n + 1, 1.0]), (len(first), 1))
    interpolated = mean_rates(around, steps, steps > gap_limit(usual))[:, 1] * steps[:, 1:2]
    error = interpolated - (turned[first + n] - turned[first - 1])
    return error.T @ error / len(first)
