"""Sensitivity of a gyroscope to specific force."""

from imuloop.core.effect import Effect
from imuloop.effects.axes import row_by_row


class GSensitivity(Effect):
    """``e = G f``: the gyroscope's bias follows the specific force in every attitude.

    G_ij is the rate that axis i shows for a specific force of 1 m/s^2 along axis j.
    Leaves: mean rates of poses that are linear in the attitude. Imitated by: the vertical part of
    the `earth_rate`, for the isotropic part of G.
    """

    name = "g_sensitivity"
    sensors = ("gyroscope",)
    parameters = {f"G{i}{j}": "rad/s per m/s^2" for i in range(3) for j in range(3)}
    equation = "e = G f"
    reference = "IEEE Std 1431-2004, acceleration-sensitive drift rate"
    records = ("poses",)

    def design(self, channels):
        """Return the derivative with respect to G row by row, shape (n, 3, 9)."""
        return row_by_row(channels.other)
