"""Second-order cross-coupling of an accelerometer's axes."""

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import AXES

# axis i that is driven, axis j that drives
PAIRS = tuple((i, j) for i in range(3) for j in range(3) if i != j)
COLUMNS = (*(f"K{AXES[i]}{AXES[j]}" for i, j in PAIRS), "Kxyz")


class CrossCoupling(Effect):
    """``e_i = Σ_j K_ij y_i y_j, j ≠ i``, and ``e_i = Kxyz y_j y_k`` alike on all axes.

    Of the 15 products of two outputs beside K2, the norm of gravity at rest shows 7: y_i y_j on
    axis i and y_i² on axis j both leave u_i² u_j, and y_j y_k leaves u_x u_y u_z on any axis. A
    `quadratic` u_i³ is a bias less u_j² u_i and u_k² u_i, a special case. Which product it is, the
    norm does not tell: along gravity the correction is right, across it off by up to the residual.
    Leaves: patterns of degree 3 in the direction u. Imitated by: `quadratic`, `asymmetry`.
    """

    name = "cross_coupling"
    sensors = ("accelerometer",)
    parameters = dict.fromkeys(COLUMNS, "m/s^2 per (m/s^2)^2")
    equation = "e_i = Σ_j K_ij y_i y_j + Kxyz y_j y_k, j, k ≠ i"
    reference = "IEEE Std 1293-1998, 8.3, model equation: Kip, Kio, Kpo"
    records = ("poses",)

    def design(self, channels):
        """Return the products of outputs, shape (n, 3, 7)."""
        y = channels.output
        columns = np.zeros((*y.shape, len(COLUMNS)))
        for k, (i, j) in enumerate(PAIRS):
            columns[:, i, k] = y[:, i] * y[:, j]
        columns[:, :, -1] = np.roll(y, -1, axis=1) * np.roll(y, -2, axis=1)
        return columns
