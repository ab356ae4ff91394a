"""Rows of a factor: its residuals and their derivatives, from which Jacobian and noise follow."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RestRows:
    """Residuals of one sensor at n rests, with a components each, and their derivatives.

    Attributes
    ----------
    residual : ndarray, shape (n, a)
        Residuals, SI.
    jacobian : ndarray, shape (n, a, p)
        Their derivative with respect to the p parameters of the sensor: T, K, b, and those of its
        effects.
    gain : ndarray, shape (n, a, 3)
        Their derivative with respect to the mean of each channel, nominal SI (before calibration).
    """

    residual: np.ndarray
    jacobian: np.ndarray
    gain: np.ndarray


@dataclass(frozen=True)
class MoveRows:
    """Residuals of m moves of k samples, with a components each, and their derivatives.

    Attributes
    ----------
    residual : ndarray, shape (m, a, 1)
        Residuals, SI.
    by_start, by_end : ndarray, shape (m, a, 3)
        Derivative with respect to the calibrated specific force at the rests before and after.
    by_turn : ndarray, shape (m, k - 1, a, 3)
        Derivative with respect to a small rotation, rad, in the middle of each time step, on the
        body axes there.
    by_force : ndarray, shape (m, k, b, 3), or None
        Derivative of the last b components with respect to the integral of calibrated specific
        force over the time of each sample; None if no residual depends on it.
    """

    residual: np.ndarray
    by_start: np.ndarray
    by_end: np.ndarray
    by_turn: np.ndarray
    by_force: np.ndarray | None = None

    def after(self, other, share):
        """Return MoveRows with the rows R of `other`, followed by the rows S of these less share R.

        The subtraction can make the noise of both independent. `other`, MoveRows, has b components
        per move and does not depend on the force during the move. `share` has the shape (m, a, b).
        """

        def stack(name, share):
            """Return the field with a name, of R and of S less share R, stacked by component."""
            first = getattr(other, name)
            return np.concatenate([first, getattr(self, name) - share @ first], axis=-2)

        return MoveRows(
            residual=stack("residual", share),
            by_start=stack("by_start", share),
            by_end=stack("by_end", share),
            by_turn=stack("by_turn", share[:, None]),
            by_force=self.by_force,
        )
