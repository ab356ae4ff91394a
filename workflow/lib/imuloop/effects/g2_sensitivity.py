"""Sensitivity of a gyroscope to the square of specific force."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import AXES, row_by_row

TERMS = ("xx", "yy", "xy", "xz", "yz")


class G2Sensitivity(Effect):
    """``e_i = Σ_jk D_ijk f_j f_k``: the anisoelastic bias of a gyroscope.

    Five terms an axis: D_ixx (f_x² - f_z²), D_iyy (f_y² - f_z²), D_ixy f_x f_y, D_ixz f_x f_z,
    D_iyz f_y f_z. The sixth, |f|², is the same in all attitudes at rest: a bias.
    Leaves: a pattern of degree 2 in the mean rates of poses, where `g_sensitivity` is of degree 1.
    Imitated by: nothing else of degree 2.
    """

    name = "g2_sensitivity"
    sensors = ("gyroscope",)
    parameters = {f"D{i}{jk}": "rad/s per (m/s^2)^2" for i in AXES for jk in TERMS}
    equation = "e_i = Σ_jk D_ijk f_j f_k"
    reference = "IEEE Std 528-2001, 2.4, acceleration-squared-sensitive drift rate"
    records = ("poses",)

    def design(self, channels):
        """Return the products on each axis, shape (n, 3, 15)."""
        x, y, z = channels.other.T
        return row_by_row(np.column_stack([x**2 - z**2, y**2 - z**2, x * y, x * z, y * z]))
