"""Helpers for effects that have the same parameters on each axis."""

import numpy as np

AXES = "xyz"


def per_axis(units):
    """Return the units of the parameters of all three axes, such as ``c1x`` … ``c1z``, by name.

    The result is a dict. `units` is a dict, too: it has the units of the parameters of one axis,
    such as ``c1``, by names that lack the axis.
    """
    return {f"{name}{axis}": unit for name, unit in units.items() for axis in AXES}


def on_each_axis(*columns):
    """Return the derivative of ``e_i = Σ_k p_ki c_ki`` with respect to p, (n, 3, 3 k).

    e_i is the error of a sensor on its axis i, at n points; each axis has its own k parameters
    p_ki. The k `columns` c_k are (n,) if they are the same on all axes, else (n, 3). The axes of
    the result are: point, axis of the sensor, parameter; the parameters are ordered by k, then by
    axis.
    """
    by_column = [(c[:, None] if c.ndim == 1 else c)[:, :, None] * np.eye(3) for c in columns]
    return np.concatenate(by_column, axis=2)


def row_by_row(columns):
    """Return the derivative of ``e_i = Σ_k M_ik c_k`` with respect to M, row by row, (n, 3, 3 k).

    e_i is the error of a sensor on its axis i, at n points, and M, (3, k), is a matrix of
    parameters. `columns`, (n, k), are the c_k at the points. The axes of the result are: point,
    axis of the sensor, element of M.
    """
    return np.einsum("ij,nk->nijk", np.eye(3), columns).reshape(len(columns), 3, -1)
