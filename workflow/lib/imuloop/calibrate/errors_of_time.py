"""Errors of rotations by dropped samples and by jitter of time stamps.

Both errors are measured on the motion itself. It is assumed that samples are dropped independently
of the motion.
"""

import numpy as np

from imuloop.calibrate.undersampling import PARTS, outer_products, sum_parts
from imuloop.core.gaps import gap_limit, lost_samples
from imuloop.core.rotation import mean_rates
from imuloop.ingest.jitter import bend, jitter_sign

# fewest windows of a rotation that determine the error of a gap
FEWEST = 10
# error by gaps, share of the angle, above which a rotation is useless: even the errors of sensors
# without a calibration are smaller
LARGEST_ERROR = 0.05
# standard deviation of the jitter, share of a step, below which it is neglected
LEAST_JITTER = 0.02


def errors_of_time(t, w, begin, last, bias, variance):
    """Return the errors of m rotations by dropped samples and by jitter of the time stamps.

    The angular rate over a gap is interpolated. The error of the angle over a gap of n samples is
    measured where the samples are complete: n of them are left out and interpolated.

    Jitter of the time stamps matters if the samples were taken at even steps. A time stamp that is
    late by e makes the step before it longer by e and the step after it shorter by e. The angle is
    then wrong by e times half the change of the rate over both steps.

    Parameters
    ----------
    t, w : ndarray, shape (N,), (N, 3)
        Time, s, and angular rate, rad/s, of the whole log.
    begin, last : ndarray of int, shape (m,)
        Index of the first and of the last sample of each rotation.
    bias, variance : ndarray, shape (m, 3)
        Mean, rad/s, and sample variance, (rad/s)², of the angular rate at rest.

    Returns
    -------
    covariance : ndarray, shape (m, PARTS, 3, 3)
        Covariance of the error that arises in each of `PARTS` equal parts of a rotation, on body
        axes, rad².
    accurate : ndarray of bool, shape (m,)
        Whether a rotation can be used. It can if all gaps together give its angle an error whose
        standard deviation is at most the standard deviation that the noise of the gyroscope gives
        the angle, or at most `LARGEST_ERROR` times the angle.
    longest : ndarray of int, shape (m,)
        Largest number of samples dropped in a row in each rotation; zero if none was dropped.
    """
    steps = np.diff(t)
    usual = np.median(steps)
    lost, jitter = lost_samples(steps, usual), _estimate_jitter(t, w, usual)
    covariance = np.zeros((len(begin), PARTS, 3, 3))
    accurate, longest = np.zeros(len(begin), bool), np.zeros(len(begin), int)
    for k, (i, j) in enumerate(zip(begin, last, strict=True)):
        rates, missing = w[i : j + 1], lost[i:j]
        gaps = gap_covariance(rates, missing, usual)
        half_changes = (rates[2:] - rates[:-2]) / 2
        covariance[k] = sum_parts(gaps) + jitter**2 * sum_parts(outer_products(half_changes))
        # variance of a sum of samples with white noise, times the step squared
        by_noise = variance[k].sum() * usual * steps[i:j].sum()
        angle = np.linalg.norm(rates[1:] - bias[k], axis=1) @ steps[i:j]
        accurate[k] = np.trace(gaps.sum(axis=0)) <= max(by_noise, (LARGEST_ERROR * angle) ** 2)
        longest[k] = missing.max(initial=0)
    return covariance, accurate, longest


def _estimate_jitter(t, w, usual):
    """Return the standard deviation of the jitter of the time stamps of a log, s.

    Jitter is the random error of a time stamp. The result is zero in two cases: the jitter is below
    `LEAST_JITTER` times a step, or the uneven time stamps are right, because the samples were taken
    at them. `t` are the time stamps, s, (N,), `w` is the angular rate, rad/s, (N, 3), and `usual`
    the median step, s.
    """
    # `bend` is a time stamp less the mean of its neighbours, with 1.5 times the variance of one.
    # The median of |e| of a normal variable e is 0.6745 of its standard deviation
    std = np.median(np.abs(bend(t))) / 0.6745 / np.sqrt(1.5) if len(t) > 2 else 0.0
    if std < LEAST_JITTER * usual:
        return 0.0
    # the sign is 1 if the motion fits the uneven time stamps better than even ones
    taken_at_stamps = jitter_sign(t, w.T, usual) == 1
    return 0.0 if taken_at_stamps else std


def gap_covariance(w, lost, usual):
    """Return the covariance of the error that lost samples cause in the angle of each step, rad².

    A step leads from one logged sample to the next, and is long if samples between them were lost.
    The error is measured elsewhere in the same rotation: as many samples are left out where none
    was lost, and interpolated. The result has the shape (k - 1, 3, 3) for a rotation of k samples:
    a matrix for each step, on the axes of the body. The matrix is zero for a step without lost
    samples, and infinite if there are fewer than `FEWEST` places to measure the error. `w` is the
    angular rate, rad/s, (k, 3), `lost` the number of samples lost in each step, (k - 1,), and
    `usual` the median step of the log, s.
    """
    covariance = np.zeros((len(lost), 3, 3))
    for n in set(lost[lost > 0].tolist()):
        covariance[lost == n] = _interpolation_error(w, lost, n, usual)
    return covariance


def _interpolation_error(w, lost, n, usual):
    """Return the mean square error of the angle over a gap of `n` samples, rad², (3, 3).

    The result is a matrix on the axes of the body. The angle over a gap follows from the
    interpolated angular rate. Its error is measured in windows of n + 3 steps of a rotation in
    which no sample is missing: n samples are left out and interpolated. The result is infinite if
    there are fewer than `FEWEST` such windows. `w` is the angular rate of the k samples of the
    rotation, rad/s, (k, 3), `lost` the number of samples lost in each step, (k - 1,), and `usual`
    the median step of the log, s.
    """
    # a window has n + 3 steps: the one before the gap, the n + 1 of the gap, and the one after it
    complete_steps = np.convolve(lost == 0, np.ones(n + 3), "valid")
    first = np.flatnonzero(complete_steps == n + 3) + 1
    if len(first) < FEWEST:
        return np.full((3, 3), np.inf)
    # angle by all samples since the start, at the end of each step
    turned = usual * np.cumsum(mean_rates(w, np.full(len(w) - 1, usual)), axis=0)
    # the two samples before and the two after the gap, and the angle over it by interpolation
    around = np.stack([w[first + i] for i in (-1, 0, n + 1, n + 2)], axis=1)
    steps = np.tile(usual * np.array([1.0, n + 1, 1.0]), (len(first), 1))
    interpolated = mean_rates(around, steps, steps > gap_limit(usual))[:, 1] * steps[:, 1:2]
    error = interpolated - (turned[first + n] - turned[first - 1])
    return error.T @ error / len(first)
