"""Factor of a rest: the calibrated specific force has the norm of gravity."""

import numpy as np

from imuloop.factors.rows import RestRows


def gravity_norm(sensor, f, gravity, D):
    """Return the RestRows with the residual ``r = |x| - g``, m/s^2.

    x is the calibrated specific force, g is gravity.

    Parameters
    ----------
    sensor : Sensor
        The accelerometer.
    f : ndarray, shape (n, 3)
        Mean specific force of each rest, m/s^2, nominal SI.
    gravity : float
        Local gravity g, m/s^2.
    D : ndarray, shape (n, 3, q)
        Derivative of the sum of the effects with respect to their parameters.
    """
    x = sensor.values(f, D)
    norm = np.linalg.norm(x, axis=1, keepdims=True)
    up = (x / norm)[:, None]
    jacobian = sensor.jacobian(up[:, None], f[:, None], D[:, None])
    return RestRows(norm - gravity, jacobian, up @ sensor.gain)
