"""Effects that have the same parameters on each axis."""

import numpy as np

AXES = "xyz"


def per_axis(units):
    """Return the parameters of three axes, ``c1x`` … ``c1z``, of the names and units of one."""
    return {f"{name}{axis}": unit for name, unit in units.items() for axis in AXES}


def on_each_axis(*columns):
    """Return the derivative of ``e_i = Σ_k p_ki column_ki``, each axis with parameters of its own.

    Parameters
    ----------
    *columns : ndarray, shape (n,) or (n, 3)
        What each parameter multiplies: the same on all axes, or a column an axis.

    Returns
    -------
    ndarray, shape (n, 3, 3 k)
        Three parameters, x, y, z, of the first column, then those of the next.
    """
    parts = [(c[:, None] if c.ndim == 1 else c)[:, :, None] * np.eye(3) for c in columns]
    return np.concatenate(parts, axis=2)
