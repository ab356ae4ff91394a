"""Factor of a rest: the calibrated angular rate is zero."""

import numpy as np

from imuloop.factors.rows import RestRows


def rest_rate(sensor, w, D):
    """Return the RestRows, residuals of n rests and their derivatives, of the angular rate.

    The residual is ``r = K (y - b) - e``, rad/s, three components on the sensor's axes. The
    misalignment T is left out: it does not change whether a rate is zero. The derivative of the
    residual with respect to y, which only weights the noise, is taken as one, as K is one within a
    few percent.

    Parameters
    ----------
    sensor : Sensor
        The gyroscope at the parameters of the state, with the scale factors K and the bias b.
    w : ndarray, shape (n, 3)
        Mean angular rate y of each rest, rad/s, nominal SI: before any calibration.
    D : ndarray, shape (n, 3, q)
        Derivative of the sum e of the gyroscope's effects with respect to their q parameters.
    """
    # the parameters are the elements of T, then K, b, and those of the effects
    n, axes, T_count = len(w), np.arange(3), len(sensor.entries[0])
    jacobian = np.zeros((n, 3, T_count + 6 + D.shape[-1]))
    jacobian[:, axes, T_count + axes] = w - sensor.b
    jacobian[:, axes, T_count + 3 + axes] = -sensor.K
    jacobian[:, :, T_count + 6 :] = -D
    gain = np.tile(np.eye(3), (n, 1, 1))
    return RestRows(residual=sensor.corrected(w, D), jacobian=jacobian, gain=gain)
