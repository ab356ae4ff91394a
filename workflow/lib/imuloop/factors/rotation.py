"""Factor of a move: its rotation carries the direction of gravity from one rest to the next."""

import numpy as np

from imuloop.core.rotation import matrix
from imuloop.factors.directions import cross_matrix, tangents
from imuloop.factors.rows import MoveRows


def rotation(at):
    """Return the MoveRows with the residual ``r = P Cᵀ u``, rad, two components per move.

    C is the attitude at the end of the move relative to its start, u the direction of gravity at
    its start. The rows of P are two unit vectors normal to the direction of gravity at its end. A
    small rotation φ, on the axes at the start, changes Cᵀ u by ``Cᵀ (u × φ)``. Takes the Linearised
    factors.
    """
    P, u, first = tangents(at.arriving), at.leaving, at.measured.moves.first
    carried = P @ matrix(at.after[:, -1]).swapaxes(1, 2)
    by_turn = np.einsum("mai,mkij->mkaj", carried @ cross_matrix(u), at.attitude_within)
    ends = carried @ at.across[first], -P @ at.across[first + 1]
    return MoveRows(carried @ u[..., None], *ends, by_turn)
