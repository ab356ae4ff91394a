"""An accelerometer that sees angular rate."""

from imuloop.core.effect import Effect
from imuloop.effects.axes import row_by_row


class RateSensitivity(Effect):
    """``e = M w``: specific force of axis i for a rate of 1 rad/s about axis j is M_ij.

    Leaves: velocity at the end of a move, M times the angle turned; nothing at rest. Imitated by:
    `lever_arm`, a little, where all turns are equally fast.
    """

    name = "rate_sensitivity"
    sensors = ("accelerometer",)
    parameters = {f"M{i}{j}": "m/s^2 per rad/s" for i in range(3) for j in range(3)}
    equation = "e = M w"
    reference = "Xsens MTi user manual, cross coupling of acceleration and angular rate"
    records = ("motion",)
    unobservable = "it acts only while the device turns, and residuals are taken at rest"
    # 10 mg at 1 rad/s
    limit = 0.1

    def design(self, channels):
        """Return the derivative with respect to M row by row, shape (n, 3, 9)."""
        return row_by_row(channels.other)
