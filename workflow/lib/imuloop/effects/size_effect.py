"""Axes of an accelerometer that do not sit in one point, beside the arm to a reference's marker."""

from imuloop.effects.lever_arm import LeverArm


class SizeEffect(LeverArm):
    """``e_i = (dw/dt × r_i + w × (w × r_i))_i``: axis i sits at r_i from the z axis.

    It is the `lever_arm` of the moves between rests, and that in a calibration. Beside a reference
    `lever_arm` is the arm from the marker, to the z axis where both are there.
    """

    name = "size_effect"
    equation = "that of `lever_arm`"
    records = ("reference",)
    # elsewhere `lever_arm` says it
    unobservable = None
