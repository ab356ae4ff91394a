"""Rotation: unit quaternions, scalar first, that take body axes to the axes at the start."""

import numpy as np


def multiply(p, q):
    """Return the quaternion product ``p q``; shapes (..., 4) broadcast."""
    pw, px, py, pz = np.moveaxis(p, -1, 0)
    qw, qx, qy, qz = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ],
        axis=-1,
    )


def exponential(vectors):
    """Return the quaternions of rotation vectors, shape (..., 3), rad."""
    half = np.linalg.norm(vectors, axis=-1, keepdims=True) / 2
    return np.concatenate([np.cos(half), np.sinc(half / np.pi) / 2 * vectors], axis=-1)


def matrix(q):
    """Return the rotation matrices of unit quaternions, shape (..., 4) to (..., 3, 3)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def step_vectors(rates, steps):
    """Return the rotation vector of each sampling step.

    The mean rate of a step is that of the cubic through its two samples and one neighbour on
    either side, evenly spaced; the Magnus series then adds what does not commute:

        φ = (-w₋₁ + 13 w₀ + 13 w₁ - w₂) Δt / 24 + (w₀ × w₁) Δt² / 12

    with an error of fifth order a step, fourth over the whole: the order of a Runge–Kutta
    scheme of four stages, while the exponential of φ keeps the quaternion's norm exactly. The
    first and the last step, in a rest by their choice, take the rate as linear.

    Parameters
    ----------
    rates : array_like, shape (..., n, 3)
        Angular rate in rad/s, on body axes.
    steps : array_like, shape (..., n - 1)
        Time steps in s.

    Returns
    -------
    ndarray, shape (..., n - 1, 3)
        Rotation vectors, rad.

    References
    ----------
    Iserles, Munthe-Kaas, Nørsett, Zanna, "Lie-group methods", Acta Numerica 9 (2000), section 4.
    """
    rates, dt = np.asarray(rates), np.asarray(steps)[..., None]
    first, second = rates[..., :-1, :], rates[..., 1:, :]
    mean = (first + second) / 2
    mean[..., 1:-1, :] += (
        first[..., 1:-1, :] + second[..., 1:-1, :] - rates[..., :-3, :] - rates[..., 3:, :]
    ) / 24
    return mean * dt + np.cross(first, second) * dt**2 / 12


def prefix_product(q):
    """Return ``q₀, q₀q₁, q₀q₁q₂, …`` along the second to last axis, by doubling.

    Parameters
    ----------
    q : array_like, shape (..., n, 4)
        Quaternions of single steps.

    Returns
    -------
    ndarray, shape (..., n, 4)
        Attitude after each step.
    """
    q = np.array(q)
    shift = 1
    while shift < q.shape[-2]:
        q[..., shift:, :] = multiply(q[..., :-shift, :], q[..., shift:, :])
        shift *= 2
    return q
