"""Factor of a move: the velocity is zero at its start and at its end."""

import numpy as np

from imuloop.core.rotation import matrix
from imuloop.factors.directions import cross_matrix, tangents
from imuloop.factors.rows import MoveRows


def velocity(linearised, rotation, share=None):
    """Return the MoveRows of the rotations, followed by those of the velocity at the end, m/s.

    MoveRows are residuals of m moves and their derivatives. The device rests before and after a
    move, so the residual is the velocity at the end of a move of duration L,

        v = ∫ C f dt - g L u,

    where C takes the body axes to those at the start of the move, f is the calibrated specific
    force, u the upward direction at the rest before, and g gravity. The first component of a
    residual is along u, the other two are horizontal. An error of the attitude changes the vertical
    velocity in second order only, and the horizontal velocity by g times the integral of the error.
    A small rotation φ during the move adds ``φ × v'``, with v' the velocity gained afterwards.

    The velocity that the residual of the rotation predicts is subtracted, so that the noise of both
    residuals is independent.

    Parameters
    ----------
    linearised : Linearised
        Attitudes, directions of gravity and calibrated values of the moves.
    rotation : MoveRows
        The rows of the rotations.
    share : ndarray, shape (m, 3, 2), optional
        Velocity that a residual of the rotation predicts, m/s per rad; zero by default.
    """
    measured, u, after = linearised.measured, linearised.leaving, matrix(linearised.after)
    # derivative of the accelerometer's effects along the moves with respect to their parameters
    moves, (_, design) = measured.moves, measured.designs["accelerometer"]
    # the rows of each matrix are the axes of the residual's components
    frame = np.concatenate([u[:, None], tangents(u)], axis=1)
    gL = measured.factors.gravity * linearised.weights.sum(axis=1)[:, None, None]
    # C and C f at each sample, (m, k, 3, 3) and (m, k, 3)
    attitude = np.concatenate([np.tile(np.eye(3), (len(u), 1, 1, 1)), after], axis=1)
    force = (attitude @ linearised.force.values(moves.f, design)[..., None])[..., 0]
    # velocity that each step gains, and v' from the middle of each step to the end
    gained = midpoints(force) * moves.steps[..., None]
    to_come = gained[:, ::-1].cumsum(axis=1)[:, ::-1] - gained / 2
    v = (linearised.weights[:, None] @ force).swapaxes(1, 2) - gL * u[..., None]
    rows = MoveRows(
        residual=frame @ v,
        # `across` is the derivative of the direction of gravity by the force at each rest
        by_start=-gL * frame @ linearised.across[moves.first],
        by_end=np.zeros_like(frame),
        by_turn=-frame[:, None] @ cross_matrix(to_come) @ linearised.attitude_within,
        by_force=frame[:, None] @ attitude,
    )
    return rows.after(rotation, np.zeros((*frame.shape[:2], 2)) if share is None else share)


def midpoints(values):
    """Return the means, (m, k - 1, ...), of neighbours along the second axis of (m, k, ...)."""
    return (values[:, 1:] + values[:, :-1]) / 2
