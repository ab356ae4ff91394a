"""Second-order cross-coupling of an accelerometer's axes."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import AXES

# axis i that is driven, axis j that drives
PAIRS = tuple((i, j) for i in range(3) for j in range(3) if i != j)


@dataclass(frozen=True)
class CrossCoupling(Effect):
    """``e_i = Σ_j K_ij y_i y_j, j ≠ i``, and ``e_i = Kxyz y_j y_k`` alike on all axes.

    Three axes have 15 products of two outputs besides K2. At rest only the norm of gravity is
    seen, r = u·e, where many are alike. Leaves: patterns of degree 3 in the direction u.

    - ``y_i y_j`` on axis i and ``y_i²`` on axis j both leave u_i² u_j: one parameter K_ij.
    - ``y_j y_k`` on axis i leaves u_x u_y u_z whichever axis: one parameter Kxyz.

    These 7 with the 3 biases span all patterns of degree 3. u_i = u_i (u_i² + u_j² + u_k²), so
    a `quadratic` u_i³ is a bias less u_j² u_i (K_ji) and u_k² u_i (K_ki), a special case of this.
    The norm does not tell which product it is: along gravity the correction is right, across it
    another of the same pattern would turn the direction otherwise, by as much as the residual.
    Imitated by: `quadratic`, `asymmetry`.
    """

    name = "cross_coupling"
    sensors = ("accelerometer",)
    parameters: ClassVar = {
        **{f"K{AXES[i]}{AXES[j]}": "m/s^2 per (m/s^2)^2" for i, j in PAIRS},
        "Kxyz": "m/s^2 per (m/s^2)^2",
    }
    equation = "e_i = Σ_j K_ij y_i y_j + Kxyz y_j y_k, j, k ≠ i"
    reference = "IEEE Std 1293-1998, 8.3, model equation: Kip, Kio, Kpo"
    records = ("poses",)

    def design(self, channels):
        """Return the products of outputs, shape (n, 3, 7)."""
        y = channels.output
        columns = np.zeros((*y.shape, len(PAIRS) + 1))
        for k, (i, j) in enumerate(PAIRS):
            columns[:, i, k] = y[:, i] * y[:, j]
        columns[:, :, -1] = np.roll(y, -1, axis=1) * np.roll(y, -2, axis=1)
        return columns
