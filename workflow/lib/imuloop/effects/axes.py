"""Parameters and derivatives of effects that have the same parameters on each axis."""

import numpy as np

AXES = "xyz"


def per_axis(units):
    """Return the parameters of three axes, such as ``c1x`` … ``c1z``, a dict of units by name.

    `units` is a dict with the units of the parameters of one axis, by name.
    """
    return {f"{name}{axis}": unit for name, unit in units.items() for axis in AXES}


def on_each_axis(*columns):
    """Return the derivative of ``e_i = Σ_k p_ki c_ki`` with respect to p, (n, 3, 3 k).

    e is the error of a sensor at n points and i an axis. The k `columns` c_k are (n,) if they are
    the same on all axes, else (n, 3). The parameters are ordered by k, then by axis.
    """
    by_column = [(c[:, None] if c.ndim == 1 else c)[:, :, None] * np.eye(3) for c in columns]
    return np.concatenate(by_column, axis=2)


def row_by_row(columns):
    """Return the derivative of ``e_i = Σ_k M_ik c_k`` with respect to M, row by row, (n, 3, 3 k).

    e is the error of a sensor at n points, i an axis, and M a matrix, (3, k). Takes the `columns`
    c, (n, k).
    """
    return np.einsum("ij,nk->nijk", np.eye(3), columns).reshape(len(columns), 3, -1)
