"""Cubic nonlinearity of an accelerometer."""

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis


class Cubic(Effect):
    """``e_i = K3_i y_i³``: the scale factor of an axis differs between small and large outputs.

    Leaves at rest ``K3 g³ u_i⁴ = K3 g³ (1/5 P0 + 4/7 P2 + 8/35 P4)(u_i)``: 77 % is a scale factor,
    23 % a pattern of degree 4. Imitated by: the scale factor, in six positions wholly.
    """

    name = "cubic"
    sensors = ("accelerometer",)
    parameters = per_axis({"K3": "m/s^2 per (m/s^2)^3"})
    equation = "e_i = K3_i y_i³"
    reference = "IEEE Std 1293-1998, 8.3, model equation: K3"
    records = ("poses",)

    def design(self, channels):
        """Return the cube of each axis' output, shape (n, 3, 3)."""
        return on_each_axis(channels.output**3)
