"""A move begins and ends at rest."""

import numpy as np

from imuloop.core.rotation import matrix
from imuloop.factors.directions import cross_matrix, tangents
from imuloop.factors.rows import MoveRows


def velocity(at, rotation, share=None):
    """Return the MoveRows of rotations, and then of the velocity at the end, m/s.

    With C the attitude, one at the start of a move of length L, f specific force and u gravity's
    direction at the rest before,

        v = ∫ C f dt - g L u,

    along gravity, then two across. Its vertical component feels an error of attitude to second
    order alone; of the horizontal ones g times that error is the integrand. A turn φ amid the move
    adds ``φ × v'``, with v' the velocity still to come. What the move's own error of rotation lets
    expect is taken away.

    Parameters
    ----------
    at : Linearised
        What factors share.
    rotation : MoveRows
        Those of `rotation`.
    share : ndarray, shape (m, 3, 2), optional
        Velocity that an error of rotation lets expect, m/s per rad; none by default.
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
    own = MoveRows(
        frame @ v,
        -pull * frame @ at.across[moves.first],
        np.zeros_like(frame),
        -frame[:, None] @ cross_matrix(to_come) @ at.attitude_within,
        frame[:, None] @ attitude,
    )
    return own.after(rotation, np.zeros((*frame.shape[:2], 2)) if share is None else share)


def midpoints(values):
    """Return the means of neighbours along the second axis: of (m, k, ...), (m, k - 1, ...)."""
    return (values[:, 1:] + values[:, :-1]) / 2
