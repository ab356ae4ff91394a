"""At rest a gyroscope's output is its bias."""

import numpy as np

from imuloop.factors.rows import RestRows


def rest_rate(sensor, w, D):
    """Return the RestRows ``r = K (y - b) - e``, rad/s, on the sensor's own axes.

    Takes the Sensor, mean angular rate as logged, (n, 3), and D, (n, 3, q), as in `Sensor`. The
    gain is one: K is, but for percents.
    """
    n, axes, T = len(w), np.arange(3), len(sensor.entries[0])
    jacobian = np.zeros((n, 3, T + 6 + D.shape[-1]))
    jacobian[:, axes, T + axes] = w - sensor.b
    jacobian[:, axes, T + 3 + axes] = -sensor.K
    jacobian[:, :, T + 6 :] = -D
    return RestRows(sensor.corrected(w, D), jacobian, np.tile(np.eye(3), (n, 1, 1)))
