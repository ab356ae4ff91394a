"""Nonlinearity of a gyroscope's scale factor."""

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis


class ScaleNonlinearity(Effect):
    """``e_i = s2_i y_i² + s3_i y_i³``: the scale factor of an axis changes with the rate.

    Leaves: errors of rotations that grow with their speed, the even part with the sign of the
    turn; nothing at rest. Imitated by: the scale factor and `scale_asymmetry` (s2) where all turns
    are equally fast, or nearly.
    """

    name = "scale_nonlinearity"
    sensors = ("gyroscope",)
    parameters = per_axis({"s2": "rad/s per (rad/s)^2", "s3": "rad/s per (rad/s)^3"})
    equation = "e_i = s2_i y_i² + s3_i y_i³"
    reference = "IEEE Std 528-2001, nonlinearity"
    records = ("poses", "motion")

    def design(self, channels):
        """Return the powers of each axis' output, shape (n, 3, 6)."""
        return on_each_axis(channels.output**2, channels.output**3)
