"""Vectors normal to directions, and matrices of cross products."""

import numpy as np


def tangents(directions):
    """Return two unit vectors, (n, 2, 3), normal to each unit vector, (n, 3), and to each other."""
    # the axis that is farthest from parallel to the direction
    helper = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def cross_matrix(vectors):
    """Return the matrices M, (..., 3, 3), with ``M a = v × a``, of vectors v, (..., 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    matrices = np.zeros((*vectors.shape, 3))
    matrices[..., 0, 1], matrices[..., 0, 2], matrices[..., 1, 2] = -z, y, -x
    matrices[..., 1, 0], matrices[..., 2, 0], matrices[..., 2, 1] = z, -y, x
    return matrices
