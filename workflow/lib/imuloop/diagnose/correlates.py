"""What a residual goes with: probes that tell a person where to look, no effects."""

import numpy as np
from scipy.special import sph_harm_y

from imuloop.diagnose.trial import log_p_value

# attitude patterns below degree 3 are those of bias, scale factor and misalignment
DEGREES = (3, 4, 5)


def harmonics(directions, degree):
    """Return the real spherical harmonics of one degree, shape (n, 2 degree + 1)."""
    x, y, z = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).T
    theta, phi = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    values = [sph_harm_y(degree, m, theta, phi) for m in range(degree + 1)]
    return np.column_stack([v.real for v in values] + [v.imag for v in values[1:]])


def probes(recording, sensor):
    """Return the probes of each kind of residual.

    Returns
    -------
    dict of str to dict of str to ndarray, shape (n, c)
        For poses and, under ``rotation``, for rotations.
    """
    poses = recording.poses
    span = poses.mid_s.max() - poses.mid_s.min()
    time = (poses.mid_s / span)[:, None] ** [1, 2]
    own = slice(0, 3) if sensor == "accelerometer" else slice(3, 6)
    previous = np.vstack([np.zeros((1, 3)), poses.f[:-1]])
    previous[np.diff(poses.session, prepend=-1) != 0] = 0
    found = {f"harmonics_{d}": harmonics(poses.f, d) for d in DEGREES}
    found |= {"time": time, "pose_variance": poses.variance[:, own], "previous_pose": previous}
    if poses.temperature is not None:
        rate = np.gradient(poses.temperature, poses.mid_s) if len(poses) > 1 else time[:, :1]
        found |= {"temperature": poses.temperature[:, None], "temperature_rate": rate[:, None]}
    rotations = recording.rotations
    at = rotations.first
    turns = {
        "time": time[at],
        "previous_pose": poses.f[at],
        # the mean rate over a rotation, with its sign
        "rotation_speed": np.einsum("mki,mk->mi", rotations.w[:, 1:], rotations.steps)
        / (rotations.end_s - rotations.start_s)[:, None],
    }
    turns |= {k: found[k][at] for k in ("temperature", "temperature_rate") if k in found}
    return {"pose": found, "rotation": turns}


def correlates(white, linear, probed):
    """Return what share of the residual each probe takes, the most telling first.

    ``share = 1 - (χ²₁/ν₁)/(χ²₀/ν₀)`` of the whitened residual of one kind, not below 0, with the
    p-value of the same F test that effects have.

    Parameters
    ----------
    white : White
        The final model.
    linear : Linear
        The residuals behind it.
    probed : dict
        From `probes`.

    Returns
    -------
    list of dict
        ``name``, ``residual``, ``columns``, ``share``, ``p_value``.
    """
    residual = white.left(white.residual)
    total, p = residual @ residual, white.q.shape[1]
    found = []
    for kind in linear.kinds:
        k = linear.components[kind]
        rows = linear.rows_of(kind)
        for name, values in probed["rotation" if kind == "rotation" else "pose"].items():
            columns = np.zeros((len(residual), k * values.shape[1]))
            columns[rows] = np.kron(values - values.mean(axis=0), np.eye(k))
            columns = white.left(white.whiten(columns))
            size = np.linalg.norm(columns, axis=0)
            columns = columns[:, size > 0] / size[size > 0]
            q = np.linalg.matrix_rank(columns, tol=1e-6) if columns.size else 0
            dof = len(residual) - p - q
            if not q or dof < 3:
                continue
            left = residual - columns @ np.linalg.lstsq(columns, residual, rcond=1e-6)[0]
            after = left @ left
            own, own_after = (float(v[rows] @ v[rows]) for v in (residual, left))
            freedom = rows.sum() - p * rows.mean()
            share = 1 - own_after / own * freedom / max(freedom - q, 1)
            found.append(
                {
                    "name": name,
                    "residual": kind,
                    "columns": int(q),
                    "share": float(np.clip(share, 0, 1)),
                    "p_value": float(np.exp(log_p_value(total - after, after, q, dof))),
                }
            )
    return sorted(found, key=lambda c: (c["p_value"], -c["share"]))
