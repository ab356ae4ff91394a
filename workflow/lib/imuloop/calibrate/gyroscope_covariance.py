"""Covariance of a gyroscope's residuals: the rates at rest, and gravity after each rotation."""

import numpy as np

from imuloop.core.samples import ANGULAR_RATE


def residual_covariance(model, x, poses, directions, noise):
    """Return the covariance of all residuals that the noise model predicts: rates, then rotations.

    Angular rate: white noise is turned by the attitude while it is summed; slow noise acts like
    a bias of each rotation, so it goes through the derivative with respect to the bias, and what a
    rotation has of it the mean rates at the poses beside it have too. Time stamps: what lost
    samples and scatter add. Gravity: the error of a pose's direction enters the rotation before
    and the one after it.

    Parameters
    ----------
    model : GyroscopeModel
        Model with m rotations and n poses.
    x : array_like, shape (12 + p,)
        Parameters.
    poses : Poses
        The n poses; noise of different runs is independent.
    directions : array_like, shape (3 n, 3 n)
        Covariance of the poses' directions, ordered pose by pose.
    noise : NoiseModel
        Noise of the device.

    Returns
    -------
    ndarray, shape (3 n + 2 m, 3 n + 2 m)
        (rad/s)² and rad²; the rates ordered pose by pose, the three axes of each together.
    """
    rotations, path, n, m = model.rotations, model.path(x), len(poses), len(model.rotations)
    plane, length = model.plane, rotations.end_s - rotations.start_s
    # error in the plane per rotation vector on the axes at the start: P Cᵀ [u ×]
    carried = plane @ path.last.swapaxes(1, 2)
    to_error = carried @ cross_matrix(model.directions[rotations.first])
    per_angle = to_error @ (path.mean / length[:, None, None])
    covariance = np.zeros((3 * n + 2 * m, 3 * n + 2 * m))
    means, of_run = poses.mean_covariance(noise)[3:], poses.run[rotations.first]
    ends = np.column_stack([rotations.start_s, rotations.end_s])
    # the two components of each rotation's error
    pairs = 3 * n + 2 * np.arange(m)[:, None] + [0, 1]
    for run in np.unique(poses.run):
        at, turns = np.flatnonzero(poses.run == run), np.flatnonzero(of_run == run)
        seconds = np.concatenate([np.ones(len(at)), length[turns]])
        together = noise.pose_mean_covariance(np.concatenate([poses.windows[at], ends[turns]]))[3:]
        turned = len(at) + np.arange(len(turns))
        for axis, name in enumerate(ANGULAR_RATE):
            # means at the poses, angles of the rotations
            slow = together[axis] * (seconds[:, None] * seconds)
            slow[turned, turned] -= noise.axes[name].N.square * length[turns]
            # what each of them makes of a residual
            gain = np.zeros((len(seconds), len(at) + 2 * len(turns)))
            gain[: len(at), : len(at)] = np.eye(len(at))
            for k in range(2):
                gain[turned, len(at) + 2 * np.arange(len(turns)) + k] = per_angle[turns, k, axis]
            own = 3 * at + axis
            rows = np.concatenate([own, pairs[turns].ravel()])
            covariance[np.ix_(rows, rows)] += gain.T @ slow @ gain
            if not together[axis].any():
                # of an axis without noise the poses' own variance is known
                covariance[np.ix_(own, own)] = means[axis][np.ix_(at, at)]
            elif poses.rounded is not None:
                covariance[own, own] += poses.rounded[at, axis]
    within = sum(
        noise.axes[name].N.square * (to_error @ path.spread[:, axis] @ to_error.swapaxes(1, 2))
        for axis, name in enumerate(ANGULAR_RATE)
    )
    if path.added is not None:
        within = within + to_error @ path.added @ to_error.swapaxes(1, 2)
    covariance[pairs[:, :, None], pairs[:, None]] += within
    # of all directions only those of the poses at both ends enter a rotation
    of_ends = ((rotations.first, carried), (rotations.first + 1, -plane))
    by_pose = directions.reshape(n, 3, 3 * n)
    half = sum(of_end @ by_pose[pose] for pose, of_end in of_ends).reshape(2 * m, n, 3)
    whole = sum(np.einsum("xmk,mjk->xmj", half[:, pose], of_end) for pose, of_end in of_ends)
    covariance[3 * n :, 3 * n :] += whole.reshape(2 * m, 2 * m)
    return covariance


def tangents(directions):
    """Return two unit vectors normal to each direction and to each other, shape (n, 2, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def cross_matrix(vectors):
    """Return the matrices of ``v ×``, shape (n, 3, 3)."""
    return np.cross(np.eye(3), vectors[:, None])
