"""A gyroscope whose axes see the product of the other two."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis


class Anisoinertia(Effect):
    """``e_i = a_i w_j w_k``: rates about both other axes at once appear as one about this.

    Leaves: errors of rotations about axes between those of the sensor; nothing at rest.
    """

    name = "anisoinertia"
    sensors = ("gyroscope",)
    parameters = per_axis({"a": "rad/s per (rad/s)^2"})
    equation = "e_i = a_i w_j w_k"
    reference = "Titterton and Weston, Strapdown Inertial Navigation Technology, anisoinertia"
    records = ("motion",)
    unobservable = "it acts only while the device turns; the motion between the rests shows it"
    limit = 0.05

    def design(self, channels):
        """Return the product of the other two axes' output, shape (n, 3, 3)."""
        w = channels.output
        return on_each_axis(np.roll(w, -1, axis=1) * np.roll(w, -2, axis=1))
