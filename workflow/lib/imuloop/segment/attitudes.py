"""Attitudes of a session, and how well they determine a calibration."""

import numpy as np
from scipy.special import chdtri

from imuloop.core.samples import sums_over

# prior standard deviation of scale and misalignment (of one) and of bias (of g)
PRIOR_SCALE, PRIOR_BIAS = 0.05, 0.1
# standard deviation of a pose's norm, of g, that counts as one observation beside the poses
POSE_NORM = 1e-4
# rests nearer than this, with no turn between, are one attitude, rad: two means that are θ apart
# pool to a norm short by θ²/8, so half a degree costs 1e-5 of g
SAME_ATTITUDE = 0.0087
# of scale and misalignment, then bias
_PRIOR = np.array([PRIOR_SCALE] * 6 + [PRIOR_BIAS] * 3)
# mean of the design's outer product over all directions: E x⁴ = 1/5, E x²y² = 1/15, E x² = 1/3
_MOMENTS = np.diag([2 / 15] * 6 + [1 / 3] * 3)
_MOMENTS[:3, :3] += 1 / 15


def expected_error(f):
    """Return the error that an accelerometer calibrated with these poses would make elsewhere.

    With u the mean specific force in units of its median norm, the 9-parameter model of an
    accelerometer at rest is an ellipsoid, linear in its nine coefficients:

        y = (|u|² − 1)/2 = uᵀ B u + cᵀ u = x(u)ᵀ β,      B symmetric.

    y is the relative error of the norm, to first order. With independent errors of standard
    deviation σ and a weak Gaussian prior on B (0.05) and c (0.1), the same in every direction, β
    has the covariance C = (XᵀX/σ² + P⁻¹)⁻¹. The figure is the root of the mean of xᵀ C x over
    all directions, relative to g, with the upper 95 % limit of σ² from the residual sum S and its
    n − tr H degrees of freedom: σ² = (S + 1e-8) / χ²(0.05; n − tr H + 1). More poses lower C, worse
    poses raise σ; few poses with a small residual by luck are not believed.
    Takes the mean specific force of each attitude, m/s², shape (n, 3); infinite without one.

    References
    ----------
    Atkinson, Donev, Tobias, "Optimum experimental designs, with SAS", 2007, section 10.6
    (V-optimality: the mean variance of prediction).
    """
    if not len(f):
        return np.inf
    u = f / np.median(np.linalg.norm(f, axis=1))
    x, y, z = u.T
    root = np.sqrt(2)
    quadratic = np.column_stack([x * x, y * y, z * z, root * x * y, root * x * z, root * y * z])
    design = np.hstack([quadratic, u]) * _PRIOR
    error = (np.sum(u * u, axis=1) - 1) / 2
    normal = design.T @ design
    # H y and tr H without H, which has a row and a column per attitude
    solution = np.linalg.solve(
        normal + POSE_NORM**2 * np.eye(9), np.column_stack([design.T @ error, normal])
    )
    residual = np.sum((error - design @ solution[:, 0]) ** 2) + POSE_NORM**2
    variance = residual / chdtri(len(f) - np.trace(solution[:, 1:]) + 1, 0.95)
    covariance = np.linalg.inv(normal / variance + np.eye(9))
    return float(np.sqrt(_PRIOR @ (covariance * _MOMENTS) @ _PRIOR))


def attitudes(force, rests):
    """Return the mean specific force of each attitude: neighbouring rests that agree are one.

    Takes specific force, m/s², (3, n), and ranges of samples.
    """
    if not len(rests):
        return np.empty((0, 3))
    sums = sums_over(force.T, rests)
    u = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    angle = 2 * np.arcsin(np.clip(np.linalg.norm(np.diff(u, axis=0), axis=1) / 2, 0, 1))
    group = np.concatenate([[0], np.cumsum(angle > SAME_ATTITUDE)])
    n = np.bincount(group, np.diff(rests, axis=1).ravel())
    return np.column_stack([np.bincount(group, x) for x in sums.T]) / n[:, None]
