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
    residual : ndarray, shape (m, a)
        Residuals, SI.
    by_start, by_end : ndarray, shape (m, a, 3)
        By calibrated specific force at the rests before and after.
    by_turn : ndarray, shape (m, k - 1, a, 3)
        By a small turn on the axes of the body, in the middle of each step.
    by_force : ndarray, shape (m, k, b, 3)
        By the integral of calibrated specific force about each sample, of the last b of a.
    """

    residual: np.ndarray
    by_start: np.ndarray
    by_end: np.ndarray
    by_turn: np.ndarray
    by_force: np.ndarray

    def minus(self, share, other):
        """Return these rows less a share, (m, a, b), of b other rows, which no force enters."""
        return MoveRows(
            self.residual - (share @ other.residual[..., None])[..., 0],
            self.by_start - share @ other.by_start,
            self.by_end - share @ other.by_end,
            self.by_turn - share[:, None] @ other.by_turn,
            self.by_force,
        )

    def after(self, other):
        """Return b other rows of each move, which no force enters, then these."""
        names, axes = ("residual", "by_start", "by_end", "by_turn"), (1, 1, 1, 2)
        pairs = [(getattr(other, name), getattr(self, name)) for name in names]
        both = (np.concatenate(pair, axis) for pair, axis in zip(pairs, axes, strict=True))
        return MoveRows(*both, self.by_force)
