"""Factor of a rest: the calibrated angular rate is zero."""

import numpy as np

from imuloop.factors.rows import RestRows


def rest_rate(sensor, w, D):
    """Return the RestRows with the residual ``r = K (y - b) - e``, rad/s, on the sensor's axes.

    The misalignment T is left out: it does not change whether a rate is zero. The derivative of the
    residual with respect to y, which only weights the noise, is taken as one, as K is one within a
    few percent.

    Parameters
    ----------
    sensor : Sensor
        The gyroscope, with the scale factors K and the bias b.
    w : ndarray, shape (n, 3)
        Mean angular rate y of each rest, rad/s, nominal SI.
    D : ndarray, shape (n, 3, q)
        Derivative of the sum e of the effects with respect to their parameters.
    """
    n, axes, T = len(w), np.arange(3), len(sensor.entries[0])
    jacobian = np.zeros((n, 3, T + 6 + D.shape[-1]))
    jacobian[:, axes, T + axes] = w - sensor.b
    jacobian[:, axes, T + 3 + axes] = -sensor.K
    jacobian[:, :, T + 6 :] = -D
    return RestRows(sensor.corrected(w, D), jacobian, np.tile(np.eye(3), (n, 1, 1)))
