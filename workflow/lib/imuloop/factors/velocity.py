"""Factor of a move: the velocity is zero at its start and at its end."""

import numpy as np

from imuloop.core.rotation import matrix
from imuloop.factors.directions import cross_matrix, tangents
from imuloop.factors.rows import MoveRows


def velocity(at, rotation, share=None):
    """Return the MoveRows of the rotations, followed by those of the velocity at the end, m/s.

    The residual is the velocity at the end of a move of duration L,

        v = ∫ C f dt - g L u,

    where C is the attitude relative to the start, f the specific force, u the direction of gravity
    at the rest before, and g gravity. The first component of a residual is along u, the other two
    are horizontal. An error of the attitude changes the vertical velocity in second order only, and
    the horizontal velocity by g times the integral of the error. A small rotation φ during the move
    adds ``φ × v'``, with v' the velocity that the move gains afterwards.

    The velocity that the residual of the rotation predicts is subtracted, so that the noise of both
    is independent.

    Parameters
    ----------
    at : Linearised
        Attitudes, directions of gravity and calibrated values of the moves.
    rotation : MoveRows
        The rows of the rotations.
    share : ndarray, shape (m, 3, 2), optional
        Velocity that a residual of the rotation predicts, m/s per rad; zero by default.
    """
    measured, u = at.measured, at.leaving
    moves, (_, design) = measured.moves, measured.designs["accelerometer"]
    frame = np.concatenate([u[:, None], tangents(u)], axis=1)
    pull = measured.factors.gravity * at.weights.sum(axis=1)[:, None, None]
    attitude = np.concatenate([np.tile(np.eye(3), (len(u), 1, 1, 1)), matrix(at.after)], axis=1)
    force = (attitude @ at.force.values(moves.f, design)[..., None])[..., 0]
    gained = midpoints(force) * moves.steps[..., None]
    to_come = gained[:, ::-1].cumsum(axis=1)[:, ::-1] - gained / 2
    v = (at.weights[:, None] @ force).swapaxes(1, 2) - pull * u[..., None]
    rows = MoveRows(
        frame @ v,
        -pull * frame @ at.across[moves.first],
        np.zeros_like(frame),
        -frame[:, None] @ cross_matrix(to_come) @ at.attitude_within,
        frame[:, None] @ attitude,
    )
    return rows.after(rotation, np.zeros((*frame.shape[:2], 2)) if share is None else share)


def midpoints(values):
    """Return the means of neighbours along the second axis, (m, k - 1, ...), of (m, k, ...)."""
    return (values[:, 1:] + values[:, :-1]) / 2
