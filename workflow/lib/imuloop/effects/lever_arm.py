"""Accelerometers that do not sit in one point, or not where a reference's marker is."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import AXES
from imuloop.effects.derivatives import REACH, other_slope


@dataclass(frozen=True)
class LeverArm(Effect):
    """``e_i = (dw/dt × r_i + w × (w × r_i))_i``: axis i sits at r_i, not at the origin.

    Where the device turns about is not known, so that an arm which all axes share is none: the
    origin is where the accelerometer's z axis sits, and r_x and r_y are from there.
    Leaves: velocity at the end of a move, as the angle turned and as the square of the rate; 1 cm
    at 5 rad/s gives 0.25 m/s². Nothing at rest. Imitated by: `rate_sensitivity`, a little.

    From a `marker` whose position a reference gives the common arm is seen: all axes sit at r.
    """

    # 1: from a reference's marker
    marker: int = 0

    name = "lever_arm"
    sensors = ("accelerometer",)
    parameters = {f"r{i}{j}": "m" for i in AXES[:2] for j in AXES}
    equation = "e_i = (dw/dt × r_i + w × (w × r_i))_i, r_z = 0"
    reference = "Titterton and Weston, Strapdown Inertial Navigation Technology, size effect"
    records = ("motion", "reference")
    unobservable = "it acts only while the device turns, and residuals are taken at rest"
    # of what is called one sensor
    limit = 0.1
    bounds: ClassVar = {"marker": (0, 1)}
    reach = REACH
    of_place = "e = dw/dt × r + w × (w × r)"
    of_marker: ClassVar[dict[str, str]] = {f"r{i}": "m" for i in AXES}

    def __post_init__(self):
        if self.marker:
            object.__setattr__(self, "parameters", self.of_marker)

    def design(self, channels):
        """Return the derivative with respect to the arms of x and y, shape (n, 3, 6 or 3)."""
        w, change = channels.other, channels.remembered(other_slope)
        # (dw/dt × r + w × (w × r))_i = Σ_j A_ij r_j
        own = w[:, :, None] * w[:, None] - (w**2).sum(axis=1)[:, None, None] * np.eye(3)
        own = own + np.cross(change[:, None], np.eye(3)).swapaxes(1, 2)
        if self.marker:
            return own
        found = np.zeros((len(w), 3, 6))
        found[:, 0, :3], found[:, 1, 3:] = own[:, 0], own[:, 1]
        return found
