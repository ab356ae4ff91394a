"""Factor of a rest: the calibrated specific force has the norm of gravity."""

import numpy as np

from imuloop.factors.rows import RestRows


def gravity_norm(sensor, f, gravity, D):
    """Return the RestRows, residuals of n rests and their derivatives, of the norm of gravity.

    The residual is ``r = |x| - g``, m/s^2, one component per rest: x is the calibrated specific
    force, g is gravity.

    Parameters
    ----------
    sensor : Sensor
        The accelerometer at the parameters of the state.
    f : ndarray, shape (n, 3)
        Mean specific force of each rest, m/s^2, nominal SI: before any calibration.
    gravity : float
        Local gravity g, m/s^2.
    D : ndarray, shape (n, 3, q)
        Derivative of the sum of the accelerometer's effects with respect to their q parameters.
    """
    x = sensor.values(f, D)
    norm = np.linalg.norm(x, axis=1, keepdims=True)
    up = (x / norm)[:, None]
    # |x| changes by the component of x along itself
    jacobian = sensor.jacobian(up[:, None], f[:, None], D[:, None])
    return RestRows(residual=norm - gravity, jacobian=jacobian, gain=up @ sensor.gain)
