"""Rows of a factor: residuals and what they depend on, from which Jacobian and noise follow."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RestRows:
    """Residuals of one sensor at n rests, a at each.

    Attributes
    ----------
    residual : ndarray, shape (n, a)
        Residuals, SI.
    jacobian : ndarray, shape (n, a, p)
        Their derivative with respect to the parameters of the sensor.
    gain : ndarray, shape (n, a, 3)
        Their derivative with respect to the mean of each channel, as logged.
    """

    residual: np.ndarray
    jacobian: np.ndarray
    gain: np.ndarray


@dataclass(frozen=True)
class MoveRows:
    """Residuals of m moves of k samples, a of each, and their derivatives.

    Attributes
    ----------
    residual : ndarray, shape (m, a, 1)
        Residuals, SI.
    by_start, by_end : ndarray, shape (m, a, 3)
        By calibrated specific force at the rests before and after.
    by_turn : ndarray, shape (m, k - 1, a, 3)
        By a small turn on the axes of the body, in the middle of each step.
    by_force : ndarray, shape (m, k, b, 3), or None
        By the integral of calibrated specific force about each sample, of the last b of a; None
        where it enters none.
    """

    residual: np.ndarray
    by_start: np.ndarray
    by_end: np.ndarray
    by_turn: np.ndarray
    by_force: np.ndarray | None = None

    def after(self, other, share):
        """Return b other rows, without a force, then these less a share, (m, a, b), of them."""

        def both(name, share):
            first = getattr(other, name)
            return np.concatenate([first, getattr(self, name) - share @ first], axis=-2)

        ends = (both(name, share) for name in ("residual", "by_start", "by_end"))
        return MoveRows(*ends, both("by_turn", share[:, None]), self.by_force)
