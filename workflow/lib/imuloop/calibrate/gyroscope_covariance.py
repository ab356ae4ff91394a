"""Covariance of a gyroscope's residuals: the rates at rest, and gravity after each rotation."""

import numpy as np


def rotation_covariance(model, x, run, directions, noise):
    """Return the covariance of the rotation errors that the noise model predicts.

    Angular rate: white noise is turned by the attitude while it is summed; slow noise acts like
    a bias of each rotation, so it goes through the derivative with respect to the bias. Time
    stamps: what lost samples and scatter add. Gravity:
    the error of a pose's direction enters the rotation before and the one after it.

    Parameters
    ----------
    model : GyroscopeModel
        Model with m rotations and n poses.
    x : array_like, shape (12 + p,)
        Parameters.
    run : array_like of int, shape (n,)
        Run of each pose; noise of different runs is independent.
    directions : array_like, shape (3 n, 3 n)
        Covariance of the poses' directions, ordered pose by pose.
    noise : NoiseModel
        Noise of the device.

    Returns
    -------
    ndarray, shape (2 m, 2 m)
        rad².
    """
    rotations = model.rotations
    m = len(rotations)
    path = model.path(x)
    last, plane = path.last, model.plane
    start = model.directions[rotations.first]
    # error in the plane per rotation vector on the axes at the start: P Cᵀ [u ×]
    carried = plane @ last.swapaxes(1, 2)
    to_error = carried @ cross_matrix(start)
    length = rotations.end_s - rotations.start_s
    mean_attitude = path.mean / length[:, None, None]
    of_run = run[rotations.first]
    covariance = np.zeros((m, 2, m, 2))
    windows = np.column_stack([rotations.start_s, rotations.end_s])
    for each_run in np.unique(of_run):
        index = np.flatnonzero(of_run == each_run)
        angles, own = noise.angle_covariance(windows[index]), np.zeros((len(index), 2) * 2)
        each = np.arange(len(index))
        for axis, name in enumerate(("gx", "gy", "gz")):
            white = noise.axes[name].N.square
            slow = angles[axis] - np.diag(white * length[index])
            column = np.einsum("mij,mj->mi", to_error[index], mean_attitude[index][:, :, axis])
            own += np.einsum("mi,mn,nj->minj", column, slow, column)
            own[each, :, each, :] += white * (
                to_error[index] @ path.spread[index, axis] @ to_error[index].swapaxes(1, 2)
            )
        if path.added is not None:
            own[each, :, each, :] += (
                to_error[index] @ path.added[index] @ to_error[index].swapaxes(1, 2)
            )
        covariance[np.ix_(index, [0, 1], index, [0, 1])] = own
    # of all directions only those of the poses at both ends enter a rotation
    n, ends = len(model.directions), ((rotations.first, carried), (rotations.first + 1, -plane))
    poses = directions.reshape(n, 3, 3 * n)
    half = sum(of_end @ poses[pose] for pose, of_end in ends).reshape(2 * m, n, 3)
    whole = sum(np.einsum("xmk,mjk->xmj", half[:, pose], of_end) for pose, of_end in ends)
    return (covariance.reshape(2 * m, m, 2) + whole).reshape(2 * m, 2 * m)


def residual_covariance(means, errors):
    """Return the covariance of pose rates, (3, n, n), and rotation errors, one after the other."""
    n = means.shape[1]
    covariance = np.zeros((3 * n + len(errors), 3 * n + len(errors)))
    # ordered pose by pose, the three axes of each together
    for axis in range(3):
        covariance[axis : 3 * n : 3, axis : 3 * n : 3] = means[axis]
    covariance[3 * n :, 3 * n :] = errors
    return covariance


def tangents(directions):
    """Return two unit vectors normal to each direction and to each other, shape (n, 2, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def cross_matrix(vectors):
    """Return the matrices of ``v ×``, shape (n, 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    o = np.zeros_like(x)
    rows = [[o, -z, y], [z, o, -x], [-y, x, o]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
