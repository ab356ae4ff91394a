"""Twins: effects that these data cannot tell apart, before the data are seen and after."""

import numpy as np
from scipy.linalg import qr

from imuloop.diagnose.trial import log_p_value

# an effect of three detection limits has nine times the noncentrality of one; what a twin leaves of
# it is below the detection limit where the twin takes eight ninths
SHARE = 8 / 9


def imitated(patterns):
    """Return which effects others imitate, from their patterns alone.

    The share of an effect that another imitates is ``cos²`` of the largest principal angle between
    the effect's pattern and the other's: whatever its parameters, the other takes that share of
    its square at least.

    Parameters
    ----------
    patterns : dict of str to list of ndarray, shape (n, q)
        Whitened patterns of each effect, one a shape, that the base model leaves.

    Returns
    -------
    list of dict
        ``effect``, ``with`` and ``share``, where it is at least `SHARE`.
    """
    spaces = {name: [_space(p) for p in shapes] for name, shapes in patterns.items()}
    found = []
    for name, own in spaces.items():
        for other, theirs in spaces.items():
            if other == name:
                continue
            # the middle one of the effect's shapes, the nearest one of the other's
            shares = [max(imitated_share(a, b) for b in theirs) for a in own]
            share = float(np.median(shares))
            if share >= SHARE:
                found.append({"effect": name, "with": other, "share": share})
    return found


def _space(pattern):
    size = np.linalg.norm(pattern, axis=0)
    # a parameter that these data do not show has no direction
    return qr(pattern[:, size > 0] / size[size > 0], mode="economic")[0]


def imitated_share(a, b):
    """Return the share of any pattern in the space of `a` that `b` takes, columns orthonormal."""
    if not 0 < a.shape[1] <= b.shape[1]:
        return 0.0
    return float(np.linalg.svd(b.T @ a, compute_uv=False)[-1] ** 2)


def interchangeable(white, added, values, columns, threshold):
    """Return whether a candidate could stand in for an effect that was added.

    It could if, without the effect, the candidate passes its test, and with the candidate the
    effect does not: neither adds anything to the other.

    Parameters
    ----------
    white : White
        The final model, `added` among its parameters.
    added : slice
        The effect's columns of the model's derivative.
    values : ndarray, shape (q,)
        Its parameters.
    columns : sequence of ndarray, shape (n, k)
        Whitened columns of the candidate, one array a shape.
    threshold : float
        Largest p-value that passes.
    """
    jacobian = white.q @ white.r
    without = white.residual - jacobian[:, added] @ values
    others = np.delete(jacobian, np.r_[added], axis=1)
    alone = _least(without, others)
    for column in columns:
        both = _least(without, np.column_stack([others, column]))
        full = _least(white.residual, np.column_stack([jacobian, column]))
        dof = len(without) - jacobian.shape[1] - column.shape[1]
        if dof < 1:
            continue
        candidate = log_p_value(alone - both, both, column.shape[1], dof) + np.log(len(columns))
        effect = log_p_value(both - full, full, len(values), dof)
        if candidate < np.log(threshold) <= effect:
            return True
    return False


def _least(values, columns):
    """Return the least sum of squares that columns, of any scale, leave of the values."""
    scaled = columns / np.linalg.norm(columns, axis=0)
    left = values - scaled @ np.linalg.lstsq(scaled, values, rcond=1e-9)[0]
    return float(left @ left)
