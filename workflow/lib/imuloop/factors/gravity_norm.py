"""At rest calibrated specific force has the length of gravity."""

import numpy as np

from imuloop.factors.rows import RestRows


def gravity_norm(sensor, f, gravity, D):
    """Return the RestRows ``r = |x| - g``, m/s^2.

    Takes the Sensor, mean specific force as logged, (n, 3), and D, (n, 3, q), as in `Sensor`.
    """
    x = sensor.values(f, D)
    norm = np.linalg.norm(x, axis=1, keepdims=True)
    up = (x / norm)[:, None]
    jacobian = sensor.jacobian(up[:, None], f[:, None], D[:, None])
    return RestRows(norm - gravity, jacobian, up @ sensor.gain)
