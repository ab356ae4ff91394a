"""Odd devices, which differ from the other devices of their type."""

import numpy as np
from scipy.special import ndtri

from imuloop.family.random_effects import fit

# number of robust standard deviations from the median above which a device does not count in the
# spread that others are compared with, as two odd devices would hide each other; and the largest
# share of such devices
FAR, AT_MOST = 4.0, 0.1
# number of devices, the farthest ones, that are tested
TRIED = 50


def deviations(y, squares):
    """Return the deviation of each of n devices from all others, and its p-value, (n,) each.

    `y` are the values of one parameter and `squares` their variances, (n,) each. The deviation is
    the value of the device minus the mean of the others, over the standard deviation of this
    difference. The standard deviation includes the spread of the others, the error of their mean,
    and the error of the device itself. The p-value is by Student's t. Devices far from the median
    are not counted among the others, because they would hide each other. Only the `TRIED` devices
    that deviate most are tested; the p-value of each remaining device is one.
    """
    count = len(y)
    # distance from the median, in robust standard deviations
    distance = np.abs(y - np.median(y))
    robust = (np.median(distance) / ndtri(0.75)) ** 2 + squares
    distance = distance / np.sqrt(np.maximum(robust, np.finfo(float).tiny))
    # a few far devices are left out of the spread: two odd devices would hide each other
    suspects = np.argsort(distance)[count - int(AT_MOST * count) :]
    is_usual = np.ones(count, dtype=bool)
    is_usual[suspects[distance[suspects] > FAR]] = False
    # the deviation from the mean of all usual devices shows which devices are the farthest
    deviation, _ = fit(y, squares, counted=[is_usual]).deviation(y, squares)
    farthest = np.argsort(-np.abs(deviation))[:TRIED]
    # each of these is compared with its own fit of the other usual devices, and tested
    others = np.repeat(is_usual[None], len(farthest), axis=0)
    others[np.arange(len(farthest)), farthest] = False
    models, p = fit(y, squares, counted=others), np.ones(count)
    deviation[farthest], p[farthest] = models.deviation(y[farthest], squares[farthest])
    return deviation, p
