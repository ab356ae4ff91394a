"""Asymmetry of an accelerometer's scale factor."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis


class Asymmetry(Effect):
    """``e_i = (K1'_i/2) |y_i|``: the scale factor of an axis differs with the sign of its output.

    Leaves at rest ``(K1'/2) g u_i |u_i|``, a bias (3/4 P1) and odd patterns from degree 3 on.
    Imitated by: `quadratic`, but for degree 5 and a kink at u_i = 0, which take over 30 poses.
    """

    name = "asymmetry"
    sensors = ("accelerometer",)
    parameters = per_axis({"Ka": "1"})
    equation = "e_i = (Ka_i/2) abs(y_i)"
    reference = "IEEE Std 1293-1998, 8.3, model equation: K1' (here Ka)"
    records = ("poses",)

    def design(self, channels):
        """Return half the size of each axis' output, shape (n, 3, 3)."""
        return on_each_axis(np.abs(channels.output) / 2)
