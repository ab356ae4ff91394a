"""Attitudes of a session, and the expected error of an accelerometer that is calibrated by them."""

import numpy as np
from scipy.special import chdtri

from imuloop.core.samples import sums_over
from imuloop.core.stretches import lengths

# prior standard deviation of scale factor and misalignment, 1, and of bias, share of gravity
PRIOR_SCALE, PRIOR_BIAS = 0.05, 0.1
# prior standard deviation of the norm of a pose, share of gravity, which has the weight of one pose
POSE_NORM = 1e-4
# largest angle between two rests of one attitude, without a turn between them, rad: the mean of two
# vectors with the angle θ is short by θ²/8, which is 1e-5 of gravity for half a degree
SAME_ATTITUDE = 0.0087
# prior standard deviations of the nine coefficients: scale factor and misalignment, then bias
_PRIOR = np.array([PRIOR_SCALE] * 6 + [PRIOR_BIAS] * 3)
# mean of the design's outer product over all directions: E x⁴ = 1/5, E x²y² = 1/15, E x² = 1/3
_MOMENTS = np.diag([2 / 15] * 6 + [1 / 3] * 3)
_MOMENTS[:3, :3] += 1 / 15


def expected_error(f):
    """Return the error to expect of an accelerometer that is calibrated with n attitudes, a float.

    The segment stage chooses the rests that make this error small. The error is a share of gravity,
    root mean square over all directions of gravity; if n is 0, the error is infinite. `f`, (n, 3),
    is the mean specific force in each attitude, m/s².

    Let u be the mean specific force in units of its median norm. An accelerometer at rest is
    modelled by an ellipsoid that is linear in nine coefficients β, the elements of B and c:

        y = (|u|² − 1)/2 = uᵀ B u + cᵀ u = x(u)ᵀ β,      B symmetric.

    y is the relative error of the norm, to first order; its variance is σ². The prior of β is
    Gaussian with mean zero and the covariance P, so the covariance of β is C = (XᵀX/σ² + P⁻¹)⁻¹. X
    has the row x(u)ᵀ of each attitude. The result is the root of the mean of xᵀ C x over all
    directions.

    For σ² its upper 95 % limit is taken, (S + ε²) / χ²(0.05; ν + 1). S is the sum of the squared
    residuals of a fit with the prior and with σ = ε. ν = n − tr H are its degrees of freedom, with
    the hat matrix H of this fit. χ²(0.05; ν + 1) is the 5 % quantile of χ² with ν + 1 degrees of
    freedom. ε is `POSE_NORM`, an expected σ that counts like the residual of one attitude. So more
    attitudes reduce C, and attitudes that do not fit an ellipsoid increase σ². A residual that is
    small only because there are few attitudes hardly reduces σ².

    References
    ----------
    Atkinson, Donev, Tobias, "Optimum experimental designs, with SAS", 2007, section 10.6
    (V-optimality: the mean variance of prediction).
    """
    if not len(f):
        return np.inf
    u = f / np.median(np.linalg.norm(f, axis=1))
    x, y, z = u.T
    # an element of B off the diagonal occurs twice in uᵀ B u; √2 leaves its prior as for the others
    root = np.sqrt(2)
    quadratic = np.column_stack([x * x, y * y, z * z, root * x * y, root * x * z, root * y * z])
    # in units of the prior's standard deviations, so that P is the unit matrix
    design = np.hstack([quadratic, u]) * _PRIOR
    error = (np.sum(u * u, axis=1) - 1) / 2
    # H is the design times `solver`, and has the trace of `solver` times the design
    normal = design.T @ design
    solver = np.linalg.solve(normal + POSE_NORM**2 * np.eye(9), design.T)
    residual = error - design @ (solver @ error)
    freedom = len(f) - np.trace(solver @ design)
    variance = (residual @ residual + POSE_NORM**2) / chdtri(freedom + 1, 0.95)
    covariance = np.linalg.inv(normal / variance + np.eye(9))
    # the mean of xᵀ C x follows from the mean of x xᵀ, with C in units of the prior
    return float(np.sqrt(_PRIOR @ (covariance * _MOMENTS) @ _PRIOR))


def attitudes(force, rests):
    """Return the mean specific force in each of k attitudes, m/s², (k, 3).

    An attitude is an orientation of the device relative to gravity. Consecutive rests have one
    attitude if their directions of specific force differ by at most `SAME_ATTITUDE`, rad. `force`,
    (3, n), is the specific force at each of n samples, m/s². `rests`, (m, 2), are the half-open
    ranges of samples of the m rests, in which the device does not move.
    """
    if not len(rests):
        return np.empty((0, 3))
    sums = sums_over(force.T, rests)
    u = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    # two unit vectors with the angle θ are 2 sin(θ/2) apart
    apart = np.linalg.norm(np.diff(u, axis=0), axis=1) > 2 * np.sin(SAME_ATTITUDE / 2)
    # index of the attitude of each rest, and sums over the rests of each attitude
    attitude = np.append(0, np.cumsum(apart))
    samples = np.bincount(attitude, lengths(rests))
    return np.column_stack([np.bincount(attitude, x) for x in sums.T]) / samples[:, None]
