"""Asymmetry of a gyroscope's scale factor."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis


class ScaleAsymmetry(Effect):
    """``e_i = sa_i |y_i|``: the scale factor of an axis differs between left and right turns.

    The asymmetry of the standard, one side less the other, is 2 sa. Leaves: errors of rotations
    that keep their sign when the turn is reversed; nothing at rest. Imitated by: the scale factor
    if each axis is turned one way only; the even part of `scale_nonlinearity` at one speed.
    """

    name = "scale_asymmetry"
    sensors = ("gyroscope",)
    parameters = per_axis({"sa": "1"})
    equation = "e_i = sa_i abs(y_i)"
    reference = "IEEE Std 528-2001, asymmetry error"
    records = ("poses", "motion")

    def design(self, channels):
        """Return the size of each axis' output, shape (n, 3, 3)."""
        return on_each_axis(np.abs(channels.output))
