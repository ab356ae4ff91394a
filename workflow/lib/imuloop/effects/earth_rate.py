"""The rotation of the Earth."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.gravity import EARTH_RATE


class EarthRate(Effect):
    """``e = w_up f/|f|``: the vertical part of the Earth's rate, along specific force.

    w_up = 7.292115e-5 rad/s · sin(latitude). The horizontal part turns with the heading, which no
    sensor here knows: it stays in the residual. Under acceleration f is not the vertical.
    Leaves: a mean rate that turns with the attitude, 15 °/h at the pole, and an angle that grows
    with the duration of a rotation. Imitated by: a `g_sensitivity` that is a multiple of the unit
    matrix, exactly.
    """

    name = "earth_rate"
    sensors = ("gyroscope",)
    parameters = {"w_up": "rad/s"}
    equation = "e = w_up u, u the direction of f"
    reference = "WGS 84, NIMA TR8350.2, table 3.1"
    records = ("poses",)
    limit = EARTH_RATE

    def design(self, channels):
        """Return the direction of specific force, shape (n, 3, 1); zero in free fall."""
        norm = np.linalg.norm(channels.other, axis=1, keepdims=True)
        return (channels.other / np.where(norm > 0, norm, 1.0))[:, :, None]
