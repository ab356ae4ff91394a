"""Parameters and derivatives of effects that have the same parameters on each axis."""

import numpy as np

AXES = "xyz"


def per_axis(units):
    """Return the parameters of three axes, ``c1x`` … ``c1z``, of the names and units of one."""
    return {f"{name}{axis}": unit for name, unit in units.items() for axis in AXES}


def on_each_axis(*columns):
    """Return the derivative of ``e_i = Σ_k p_ki c_ki``, x, y, z of each column, (n, 3, 3 k).

    Columns, (n,) or (n, 3), are what each parameter multiplies: the same on all axes, or each own.
    """
    parts = [(c[:, None] if c.ndim == 1 else c)[:, :, None] * np.eye(3) for c in columns]
    return np.concatenate(parts, axis=2)


def row_by_row(columns):
    """Return the derivative of ``e_i = Σ_k M_ik c_k`` by M, row by row, (n, k) to (n, 3, 3 k)."""
    return np.einsum("ij,nk->nijk", np.eye(3), columns).reshape(len(columns), 3, -1)
