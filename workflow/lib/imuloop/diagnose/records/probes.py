"""What the residual at the poses may go with: patterns that tell where to look, no effects."""

import numpy as np
from scipy.special import sph_harm_y

# attitude patterns below degree 3 are those of bias, scale factor and misalignment
DEGREES = (3, 4, 5)


def harmonics(directions, degree):
    """Return the real spherical harmonics of one degree, shape (n, 2 degree + 1)."""
    x, y, z = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).T
    theta, phi = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    values = [sph_harm_y(degree, m, theta, phi) for m in range(degree + 1)]
    return np.column_stack([v.real for v in values] + [v.imag for v in values[1:]])


def pose_probes(recording, sensor):
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
