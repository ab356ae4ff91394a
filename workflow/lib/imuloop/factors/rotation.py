"""Factor of a move: its rotation carries the direction of gravity from one rest to the next."""

import numpy as np

from imuloop.core.rotation import matrix
from imuloop.factors.directions import cross_matrix, tangents
from imuloop.factors.rows import MoveRows


def rotation(linearised):
    """Return the MoveRows, residuals of m moves and their derivatives, of the rotations.

    The residual is ``r = P Cᵀ u``, rad, two components per move. u is the upward direction at the
    start of the move on body axes there, by the accelerometer. C is the rotation by the gyroscope,
    which takes the body axes at the end to those at the start, so Cᵀ u is the upward direction on
    the body axes at the end. The rows of P are two unit vectors normal to the upward direction that
    the accelerometer measures at the end. A small rotation φ, on the axes at the start, changes
    Cᵀ u by ``Cᵀ (u × φ)``. Takes the Linearised factors.
    """
    P, u, first = tangents(linearised.arriving), linearised.leaving, linearised.measured.moves.first
    PCt = P @ matrix(linearised.after[:, -1]).swapaxes(1, 2)
    by_turn = np.einsum("mai,mkij->mkaj", PCt @ cross_matrix(u), linearised.attitude_within)
    return MoveRows(
        residual=PCt @ u[..., None],
        by_start=PCt @ linearised.across[first],
        # P follows the measured direction at the end, and the residual is relative to it
        by_end=-P @ linearised.across[first + 1],
        by_turn=by_turn,
    )
