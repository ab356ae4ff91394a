"""Rows of a factor: its residuals and their derivatives, from which Jacobian and noise follow."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RestRows:
    """Residuals of one sensor at n rests, with a components each.

    Attributes
    ----------
    residual : ndarray, shape (n, a)
        Residuals, SI.
    jacobian : ndarray, shape (n, a, p)
        Their derivative with respect to the parameters of the sensor.
    gain : ndarray, shape (n, a, 3)
        Their derivative with respect to the mean of each channel, nominal SI.
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
        Derivative with respect to calibrated specific force at the rests before and after.
    by_turn : ndarray, shape (m, k - 1, a, 3)
        Derivative with respect to a small rotation, on body axes, in the middle of each step.
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
        """Return the rows R of `other`, followed by the rows S of these less ``share @ R``.

        R has b components and does not depend on the force during the move; share is (m, a, b).
        """

        def stack(name, share):
            first = getattr(other, name)
            return np.concatenate([first, getattr(self, name) - share @ first], axis=-2)

        ends = (stack(name, share) for name in ("residual", "by_start", "by_end"))
        return MoveRows(*ends, stack("by_turn", share[:, None]), self.by_force)
