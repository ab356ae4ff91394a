"""The factors: residuals of rests and of the moves between them, with their derivatives.

At a rest the calibrated specific force has the norm of gravity, and the angular rate is zero. The
rotation of a move takes the direction of gravity from one rest to the next, and the velocity is
zero at both ends.
"""

from dataclasses import dataclass

import numpy as np

from imuloop.core.rotation import matrix


@dataclass(frozen=True)
class RestRows:
    """Residuals of one sensor at n rests, with a components each, and their derivatives.

    A row is one component of a residual.

    Attributes
    ----------
    residual : ndarray, shape (n, a)
        Residuals, SI.
    jacobian : ndarray, shape (n, a, p)
        Derivative of the residuals with respect to the p parameters of the sensor: the misalignment
        T, the scale factors K, the bias b, and the parameters of its effects.
    gain : ndarray, shape (n, a, 3)
        Derivative of the residuals with respect to the mean of each of the sensor's three channels,
        nominal SI (before calibration). It says how noise enters.
    """

    residual: np.ndarray
    jacobian: np.ndarray
    gain: np.ndarray


@dataclass(frozen=True)
class MoveRows:
    """Residuals of m moves of k samples, with a components each, and their derivatives.

    A row is one component of a residual.

    Attributes
    ----------
    residual : ndarray, shape (m, a, 1)
        Residuals, SI; the last axis, of length one, makes each a column vector.
    by_start, by_end : ndarray, shape (m, a, 3)
        Derivative of the residuals with respect to the calibrated specific force at the rest before
        the move, and at the rest after it.
    by_turn : ndarray, shape (m, k - 1, a, 3)
        Derivative of the residuals with respect to a small rotation, rad, in the middle of each
        time step, on the body axes there.
    by_force : ndarray, shape (m, k, b, 3), or None
        Derivative of the last b components with respect to the integral of calibrated specific
        force over the time of each sample; None if no residual depends on it.
    """

    residual: np.ndarray
    by_start: np.ndarray
    by_end: np.ndarray
    by_turn: np.ndarray
    by_force: np.ndarray | None = None

    def append_to(self, other, share):
        """Return MoveRows that have the rows R of `other`, then the rows ``S - share R``.

        A row is one component of a residual. S are the rows of this object, with a components per
        move. `other`, MoveRows, has b components per move, and does not depend on the force during
        the move. A suitable `share`, (m, a, b), makes the noise of the two parts independent.
        """

        def stack(name, share):
            """Return the field `name` of the rows R, then of ``S - share R`` with this `share`."""
            first = getattr(other, name)
            return np.concatenate([first, getattr(self, name) - share @ first], axis=-2)

        return MoveRows(
            residual=stack("residual", share),
            by_start=stack("by_start", share),
            by_end=stack("by_end", share),
            by_turn=stack("by_turn", share[:, None]),
            by_force=self.by_force,
        )


def gravity_norm(sensor, f, gravity, D):
    """Return the RestRows of gravity: the norm of specific force minus gravity, at n rests.

    The residual is ``r = |x| - g``, m/s^2, one component per rest: x is the calibrated specific
    force, g is gravity.

    Parameters
    ----------
    sensor : Sensor
        The accelerometer at the parameters of the state.
    f : ndarray, shape (n, 3)
        Mean specific force of each rest, m/s^2, nominal SI: before any calibration.
    gravity : float
        Local gravity g, m/s^2.
    D : ndarray, shape (n, 3, q)
        Derivative of the sum of the accelerometer's effects with respect to their q parameters.
    """
    x = sensor.values(f, D)
    norm = np.linalg.norm(x, axis=1, keepdims=True)
    up = (x / norm)[:, None]
    # the derivative of |x| with respect to x is the unit vector along x; [:, None] adds the axis of
    # the one component
    jacobian = sensor.jacobian(up[:, None], f[:, None], D[:, None])
    return RestRows(residual=norm - gravity, jacobian=jacobian, gain=up @ sensor.gain)


def rest_rate(sensor, w, D):
    """Return the RestRows of the angular rate, which should be zero at n rests.

    The residual is ``r = K (y - b) - e``, rad/s, three components on the sensor's axes. The
    misalignment T is left out: it does not change whether a rate is zero. The derivative of the
    residual with respect to y (`gain`) is taken as one, although it is K: K is one within a few
    percent, and the derivative serves only for the covariance by noise.

    Parameters
    ----------
    sensor : Sensor
        The gyroscope at the parameters of the state, with the scale factors K and the bias b.
    w : ndarray, shape (n, 3)
        Mean angular rate y of each rest, rad/s, nominal SI: before any calibration.
    D : ndarray, shape (n, 3, q)
        Derivative of the sum e of the gyroscope's effects with respect to their q parameters.
    """
    # the parameters are the elements of T, then K, b, and the parameters of the effects
    n, axes, T_count = len(w), np.arange(3), len(sensor.entries[0])
    jacobian = np.zeros((n, 3, T_count + 6 + D.shape[-1]))
    jacobian[:, axes, T_count + axes] = w - sensor.b
    jacobian[:, axes, T_count + 3 + axes] = -sensor.K
    jacobian[:, :, T_count + 6 :] = -D
    gain = np.tile(np.eye(3), (n, 1, 1))
    return RestRows(residual=sensor.corrected(w, D), jacobian=jacobian, gain=gain)


def rotation(linearised):
    """Return the MoveRows of the rotations: the turn by the gyroscope against gravity's directions.

    The residual is ``r = P Cᵀ u``, rad, two components for each of m moves. u is the upward
    direction at the start of the move on body axes there, by the accelerometer. C is the rotation
    by the gyroscope, which takes the body axes at the end to those at the start, so Cᵀ u is the
    upward direction on the body axes at the end. The rows of P are two unit vectors normal to the
    upward direction that the accelerometer measures at the end. A small rotation φ, on the axes at
    the start, changes Cᵀ u by ``Cᵀ (u × φ)``. `linearised` are the Linearised factors.
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


def velocity(linearised, rotation, share=None):
    """Return the MoveRows of the rotations, and then of the velocities at the end of each move.

    The device rests before and after a move, so the velocity at the end of the move, m/s, is a
    residual. In a move of duration L it is

        v = ∫ C f dt - g L u,

    where C takes the body axes to those at the start of the move, f is the calibrated specific
    force, u the upward direction at the rest before, and g gravity. The first component of a
    residual is along u, the other two are horizontal. An error of the attitude changes the vertical
    velocity in second order only, and the horizontal velocity by g times the integral of the error.
    A small rotation φ at some time of the move adds ``φ × v'`` to v, where v' is the velocity that
    the device gains from that time on.

    The residual of the rotation predicts a velocity, `share` times this residual. It is subtracted
    from v, so that the noise of both residuals is independent.

    Parameters
    ----------
    linearised : Linearised
        Attitudes, directions of gravity and calibrated values of the moves.
    rotation : MoveRows
        The rows of the rotations.
    share : ndarray, shape (m, 3, 2), optional
        Velocity that a residual of the rotation predicts for each of m moves, m/s per rad; zero by
        default.
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
    # velocity that the device gains in each step (not a derivative, as `gain` of RestRows is), and
    # v' from the middle of each step to the end
    gain = midpoints(force) * moves.steps[..., None]
    later_gain = gain[:, ::-1].cumsum(axis=1)[:, ::-1] - gain / 2
    v = (linearised.weights[:, None] @ force).swapaxes(1, 2) - gL * u[..., None]
    rows = MoveRows(
        residual=frame @ v,
        # `across`: derivative of the direction of gravity with respect to the force at each rest
        by_start=-gL * frame @ linearised.across[moves.first],
        by_end=np.zeros_like(frame),
        by_turn=-frame[:, None] @ cross_matrix(later_gain) @ linearised.attitude_within,
        by_force=frame[:, None] @ attitude,
    )
    return rows.append_to(rotation, np.zeros((*frame.shape[:2], 2)) if share is None else share)


def midpoints(values):
    """Return the mean of each pair of neighbours along the second axis, (m, k - 1, ...).

    `values` has the shape (m, k, ...), such as k samples of each of m moves.
    """
    return (values[:, 1:] + values[:, :-1]) / 2


def tangents(directions):
    """Return for each of n unit vectors two unit vectors normal to it and to each other, (n, 2, 3).

    `directions`, (n, 3), are the n unit vectors.
    """
    # the axis that is farthest from parallel to the direction
    helper = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def cross_matrix(vectors):
    """Return for each vector v the matrix M, (..., 3, 3), with ``M a = v × a`` for any a.

    `vectors` are the vectors v, (..., 3).
    """
    x, y, z = np.moveaxis(vectors, -1, 0)
    matrices = np.zeros((*vectors.shape, 3))
    matrices[..., 0, 1], matrices[..., 0, 2], matrices[..., 1, 2] = -z, y, -x
    matrices[..., 1, 0], matrices[..., 2, 0], matrices[..., 2, 1] = z, -y, x
    return matrices
