"""Six-position calibration of an accelerometer: each axis once up and once down."""

from dataclasses import dataclass

import numpy as np

# parameters, as in the multi-position calibration
NAMES = ("T01", "T02", "T12", "K0", "K1", "K2", "b0", "b1", "b2")


@dataclass(frozen=True)
class SixPositionFit:
    """Result of the six-position calibration, ``x = T (K (y - b))``, SI as logged.

    Attributes
    ----------
    x : ndarray, shape (9,)
        Parameters in the order of `NAMES`.
    covariance : ndarray, shape (9, 9)
        From the scatter of the residuals.
    case : ndarray, shape (3, 3)
        Rotation from the body axes to the axes of the faces.
    residuals : ndarray, shape (n, 3)
        ``A y + c - g d``, m/s^2: placement errors of the faces above all.
    """

    x: np.ndarray
    covariance: np.ndarray
    case: np.ndarray
    residuals: np.ndarray


def find_faces(f, tolerance):
    """Return the face of each pose: +1 … +3 for the axis up, -1 … -3 for down, 0 for none.

    Parameters
    ----------
    f : array_like, shape (n, 3)
        Mean specific force, m/s^2.
    tolerance : float
        Degrees between specific force and the axis.
    """
    f = np.asarray(f, dtype=float)
    axis = np.argmax(np.abs(f), axis=1)
    along = np.take_along_axis(f, axis[:, None], axis=1)[:, 0]
    near = np.abs(along) >= np.cos(np.radians(tolerance)) * np.linalg.norm(f, axis=1)
    return np.where(near, np.sign(along) * (axis + 1), 0).astype(int)


def untestable_faces(faces):
    """Return which faces are missing, or None if all six were found."""
    wanted = {1: "+x", -1: "-x", 2: "+y", -2: "-y", 3: "+z", -3: "-z"}
    missing = [name for face, name in wanted.items() if face not in faces]
    if not missing:
        return None
    return f"{6 - len(missing)} faces found, 6 needed; missing: {', '.join(missing)}"


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


def fit_six_position(f, faces, gravity):
    """Fit the twelve-parameter model to faces of known direction.

    Least squares of ``A y + c = g d`` over the 3 × 3 matrix A and the vector c, where d is the
    unit vector of the face that points up; then the decomposition into T, K, b. The frame of the
    faces is not the sensor's: the rotation between the two is reported beside them.

    Parameters
    ----------
    f : array_like, shape (n, 3)
        Mean specific force of each pose, m/s^2.
    faces : array_like of int, shape (n,)
        As `find_faces` gives them, none 0.
    gravity : float
        Local gravity, m/s^2.

    Returns
    -------
    SixPositionFit
        The parameters and their covariance; tilts of the faces are the error that counts.

    References
    ----------
    STMicroelectronics AN3182, "Tilt measurement using a low-g 3-axis accelerometer", section 4.
    """
    f, faces = np.asarray(f, dtype=float), np.asarray(faces)
    wanted = np.sign(faces)[:, None] * gravity * np.eye(3)[np.abs(faces) - 1]
    design = np.column_stack([f, np.ones(len(f))])
    solution = np.linalg.lstsq(design, wanted, rcond=None)[0]
    residuals = design @ solution - wanted
    variance = (residuals**2).sum() / (residuals.size - solution.size)
    x, case = decompose(solution[:3].T, solution[3])
    # each of the three rows of [A c] has the covariance of one linear fit
    cofactor = np.linalg.inv(design.T @ design)
    jacobian = np.empty((9, 12))
    for i in range(12):
        step = np.zeros(12)
        step[i] = 1e-6
        changed = [solution + s * step.reshape(4, 3) for s in (1, -1)]
        plus, minus = (decompose(each[:3].T, each[3])[0] for each in changed)
        jacobian[:, i] = (plus - minus) / 2e-6
    covariance = jacobian @ np.kron(cofactor, np.eye(3)) @ jacobian.T * variance
    return SixPositionFit(x, covariance, case, residuals)
