"""Quadratic nonlinearity of an accelerometer."""

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis


class Quadratic(Effect):
    """``e_i = K2_i y_i²``: the scale factor of an axis grows with its output.

    Leaves at rest, u the direction of gravity: ``K2 g² u_i³ = K2 g² (3/5 P1 + 2/5 P3)(u_i)``, 60 %
    of it a bias. Imitated by: `cross_coupling`, of which it is a special case, and `asymmetry`
    where poses are few. Under vibration it is `vibration_rectification`.
    """

    name = "quadratic"
    sensors = ("accelerometer",)
    parameters = per_axis({"K2": "m/s^2 per (m/s^2)^2"})
    equation = "e_i = K2_i y_i²"
    reference = "IEEE Std 1293-1998, 8.3, model equation: K2"
    records = ("poses",)

    def design(self, channels):
        """Return the square of each axis' output, shape (n, 3, 3)."""
        return on_each_axis(channels.output**2)
