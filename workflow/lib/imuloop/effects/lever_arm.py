"""Accelerometers that do not sit in one point."""

from imuloop.core.effect import Effect
from imuloop.effects.axes import AXES


class LeverArm(Effect):
    """``e_i = (dw/dt × r_i + w × (w × r_i))_i``: axis i sits at r_i, not at the origin.

    Leaves: errors of the norm while it turns, as the square of the rate; 1 cm at 5 rad/s gives
    0.25 m/s². Needs specific force during motion, which calibration from rest to rest never uses.
    """

    name = "lever_arm"
    sensors = ("accelerometer",)
    parameters = {f"r{i}{j}": "m" for i in AXES for j in AXES}
    equation = "e_i = (dw/dt × r_i + w × (w × r_i))_i"
    reference = "Titterton and Weston, Strapdown Inertial Navigation Technology, size effect"
    records = ("poses",)
    unobservable = "it acts only while the device turns, and residuals are taken at rest"
