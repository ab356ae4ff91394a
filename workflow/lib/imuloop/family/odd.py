"""Devices that stand out from those of their type."""

import numpy as np
from scipy.special import ndtri

from imuloop.family.random_effects import fit

# robust standard deviations from the median beyond which a device is no measure for others, and the
# share of the devices that may be so: two odd ones would hide each other
FAR, AT_MOST = 4.0, 0.1
# the farthest devices, which are tried; none of the others is farther
TRIED = 50


def deviations(y, squares):
    """Return how far each device lies from what the others predict, and the p-value of that, (n,).

    The deviation is in standard deviations of the prediction: spread of the others, error of their
    mean, own error. Its p-value is of Student's t, with their degrees of freedom; one where a
    device was not tried.
    """
    count = len(y)
    distance = np.abs(y - np.median(y))
    robust = (np.median(distance) / ndtri(0.75)) ** 2 + squares
    distance = distance / np.sqrt(np.maximum(robust, np.finfo(float).tiny))
    suspects = np.argsort(distance)[count - int(AT_MOST * count) :]
    measure = np.ones(count, dtype=bool)
    measure[suspects[distance[suspects] > FAR]] = False
    whole = fit(y, squares, counted=[measure])
    found, p = whole.deviation(y, squares)[0], np.ones(count)
    tried = np.argsort(-np.abs(found))[:TRIED]
    others = np.repeat(measure[None], len(tried), axis=0)
    others[np.arange(len(tried)), tried] = False
    apart = fit(y, squares, counted=others)
    found[tried], p[tried] = apart.deviation(y[tried], squares[tried])
    return found, p
