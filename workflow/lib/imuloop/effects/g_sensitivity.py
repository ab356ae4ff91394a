"""Sensitivity of a gyroscope to specific force."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imuloop.core.effect import Effect


@dataclass(frozen=True)
class GSensitivity(Effect):
    """``e = G f``: the gyroscope's bias follows the specific force in every attitude.

    G_ij is the angular rate (rad/s) that axis i shows for a specific force of 1 m/s^2 along
    axis j. At rest it is linear in the attitude, so the means of the static poses show it; its
    isotropic part looks like the vertical part of the Earth's rate, 7.3e-5 rad/s at the pole.
    """

    name = "g_sensitivity"
    sensors = ("gyroscope",)
    parameters: ClassVar = {f"G{i}{j}": "rad/s per m/s^2" for i in range(3) for j in range(3)}
    equation = "e = G f"
    reference = "IEEE Std 1431-2004, acceleration-sensitive drift rate"
    records = ("poses",)

    def design(self, channels):
        """Return the derivative with respect to G row by row, shape (n, 3, 9)."""
        return np.einsum("ij,nk->nijk", np.eye(3), channels.other).reshape(-1, 3, 9)
