"""Gravity's direction carried through a stretch of rests and rotations, by gyroscope and filter."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.rotation import exponential, matrix, prefix_product

try:
    from vqf import VQF
except ImportError:  # there are Pythons and processors without a wheel
    VQF = None

# s of the rest before a stretch in which the filter settles, and of the rest after it
SETTLE = 30.0


@dataclass(frozen=True)
class Stretch:
    """A stretch of a log from a rest, through rotations and rests, to a rest.

    Its poses, (p,); the time of its samples, s, (k,), which are that piece of the log; first and
    last sample of each pose, (p,), counted from the first of the stretch.
    """

    poses: np.ndarray
    t: np.ndarray
    piece: slice
    arrive: np.ndarray
    leave: np.ndarray


def stretches(recording, block):
    """Return the longest stretches whose rotations follow each other within a block, in order.

    A rotation belongs to the block (ndarray of int, shape (n,), of each pose) that it starts from.
    """
    first, poses, found = recording.rotations.first, recording.poses, []
    cuts = np.flatnonzero((np.diff(first) != 1) | (np.diff(block[first]) != 0)) + 1
    for group in np.split(first, cuts) if len(first) else ():
        index = np.append(group, group[-1] + 1)
        t = recording.logs[poses.session[index[0]]].t
        start, end = poses.start_s[index], poses.end_s[index]
        # `end_s` is open: the pose's last sample is the one before it
        arrive, leave = np.searchsorted(t, start), np.searchsorted(t, end) - 1
        arrive[0] = max(arrive[0], np.searchsorted(t, end[0] - SETTLE))
        leave[-1] = min(leave[-1], np.searchsorted(t, start[-1] + SETTLE))
        piece = slice(arrive[0], leave[-1] + 1)
        found.append(Stretch(index, t[piece], piece, arrive - piece.start, leave - piece.start))
    return found


def angle(a, b):
    """Return the angle between directions, shape (..., 3), rad."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))


def rotation_errors(turns, f, stretch, u):
    """Return the error of gravity's direction that the gyroscope alone carries to the next rest.

    From the last sample of a rest to the first of the next, ``u(t) = C(t)ᵀ C(t₀) u(t₀)`` with the
    attitude C. Takes what `filter_errors` does; gives the angles, rad, (p - 1, 1).
    """
    q = np.concatenate([[[1.0, 0, 0, 0]], prefix_product(exponential(turns))])
    leave, arrive = matrix(q[stretch.leave[:-1]]), matrix(q[stretch.arrive[1:]])
    carried = np.einsum("pji,pjk,pk->pi", arrive, leave, u[:-1])
    return angle(carried, u[1:])[:, None]


def filter_errors(turns, f, stretch, u):
    """Return the error of gravity's direction by the filter VQF, as its users run it.

    Without magnetometer, all its parameters as they come, its estimate of the gyroscope's bias on.
    Takes the rotation vector of each step, rad, (k - 1, 3), specific force, m/s^2, (k, 3), and the
    direction u at the p rests, (p, 3). Gives the angles at the first and the last sample of each
    rest but the first, rad, (p - 1, 2).

    References
    ----------
    Laidig, Seel, "VQF: Highly accurate IMU orientation estimation with bias estimation and magnetic
    disturbance rejection", Information Fusion 91 (2023).
    """
    # its step is constant: the rate that makes the whole turn in it, where stamps are late or lost
    step = np.median(np.diff(stretch.t))
    rates, forces = np.ascontiguousarray(turns / step), np.ascontiguousarray(f[1:])
    q = VQF(step).updateBatch(rates, forces)["quat6D"]
    at = np.column_stack([stretch.arrive, stretch.leave])[1:] - 1
    # q leads to axes whose third points up: up in the sensor's frame is Cᵀ e_z, the third row of C
    return angle(matrix(q[at])[..., 2, :], u[1:, None])


# what carries gravity's direction, and its errors
METHODS = {"rotation": rotation_errors} | ({"filter": filter_errors} if VQF else {})
