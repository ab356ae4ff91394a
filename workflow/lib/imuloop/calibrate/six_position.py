"""Six-position calibration of an accelerometer: each axis once up and once down."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SixPositionFit:
    """Result of the six-position calibration, ``x = T (K (y - b))``, SI as logged.

    Nine parameters in the order of `imuloop.calibrate.accelerometer.NAMES` with their covariance,
    and the rotation from the body axes to those of the faces, (3, 3).
    """

    x: np.ndarray
    covariance: np.ndarray
    case: np.ndarray


def find_faces(f, tolerance):
    """Return the face of each pose: +1 … +3 for the axis up, -1 … -3 for down, 0 for none.

    Takes mean specific force, m/s^2, (n, 3), and the degrees that it may lie from an axis.
    """
    f = np.asarray(f, dtype=float)
    axis = np.argmax(np.abs(f), axis=1)
    along = np.take_along_axis(f, axis[:, None], axis=1)[:, 0]
    near = np.abs(along) >= np.cos(np.radians(tolerance)) * np.linalg.norm(f, axis=1)
    return np.where(near, np.sign(along) * (axis + 1), 0).astype(int)


def untestable_faces(faces):
    """Return which of the `faces` are missing, text, or None if all six were found."""
    wanted = {1: "+x", -1: "-x", 2: "+y", -2: "-y", 3: "+z", -3: "-z"}
    missing = [name for face, name in wanted.items() if face not in faces]
    if not missing:
        return None
    return f"{6 - len(missing)} of 6 faces found; missing: {', '.join(missing)}"


def decompose(A, c):
    """Return the parameters of ``T K (y - b)`` and the rotation Q of ``A y + c = Q T K (y - b)``.

    ``A = Q U`` with Q orthonormal and U upper triangular with a positive diagonal; the diagonal
    of U is the scale factor and ``U K⁻¹`` the misalignment.
    """
    Q, U = np.linalg.qr(A)
    signs = np.sign(np.diag(U))
    Q, U = Q * signs, U * signs[:, None]
    K = np.diag(U)
    T = U / K
    return np.concatenate([T[np.triu_indices(3, 1)], K, -np.linalg.solve(A, c)]), Q


def fit_six_position(f, faces, gravity, noise=0.0):
    """Fit the twelve-parameter model to faces of known direction.

    Least squares of ``A y + c = g d`` over the 3 × 3 matrix A and the vector c, where d is the
    unit vector of the face that points up; then the decomposition into T, K, b. A face tilted by
    small angles θ moves specific force by g θ across d and shortens it along d by g θ²/2 for each.
    So the components across have a variance s², estimated from what a first fit with equal weights
    leaves; the one along d is expected at ``g - s²/g`` and has the variance of the noise and
    ``(s²/g)²``.

    Takes mean specific force of each pose, m/s^2, (n, 3), its face as `find_faces` has it, none 0,
    local gravity, m/s^2, and the variance of a pose's mean, (m/s^2)^2.

    References
    ----------
    STMicroelectronics AN3182, "Tilt measurement using a low-g 3-axis accelerometer", section 4.
    """
    f, faces = np.asarray(f, dtype=float), np.asarray(faces)
    up = np.sign(faces)[:, None] * np.eye(3)[np.abs(faces) - 1]
    wanted = gravity * up
    design = np.column_stack([f, np.ones(len(f))])
    along = up != 0
    solution = np.linalg.lstsq(design, wanted, rcond=None)[0]
    # the pairs along d settle c and the diagonal of A; what lies across settles six numbers more
    across_dof = 2 * len(f) - 6
    for _ in range(2):
        residuals = design @ solution - wanted
        across = max((residuals[~along] ** 2).sum() / across_dof, noise, (1e-9 * gravity) ** 2)
        wanted = (gravity - across / gravity) * up
        # nothing is known a thousand times better along than across: the fit stays well-posed
        shortened = max(noise + across**2 / gravity**2, 1e-6 * across)
        variance = np.where(along, shortened, across)
        # each row of [A c] is a linear fit of its own
        cofactor = np.array([np.linalg.inv((design.T / v) @ design) for v in variance.T])
        rows = zip(cofactor, variance.T, wanted.T, strict=True)
        solution = np.column_stack([c @ (design.T / v) @ w for c, v, w in rows])
    x, case = decompose(solution[:3].T, solution[3])
    jacobian = np.empty((9, 4, 3))
    for i, j in np.ndindex(4, 3):
        step = np.zeros((4, 3))
        step[i, j] = 1e-6
        changed = [solution + step, solution - step]
        plus, minus = (decompose(each[:3].T, each[3])[0] for each in changed)
        jacobian[:, i, j] = (plus - minus) / 2e-6
    covariance = np.einsum("aij,jik,bkj->ab", jacobian, cofactor, jacobian)
    return SixPositionFit(x, covariance, case)
