"""Rotation: unit quaternions, scalar first, that take body axes to the axes at the start.

What every step of a fit takes of batches; of these `scipy.spatial.transform.Rotation` is 2 to 100
times as slow.
"""

import numpy as np


def multiply(p, q):
    """Return the quaternion product ``p q``; shapes (..., 4) broadcast."""
    return _product(_pairs(p), _pairs(q)).view(float)


def _pairs(q):
    """Return the quaternions ``a + b j`` as complex a = w + x i and b = y + z i, (..., 2)."""
    return np.ascontiguousarray(q, dtype=float).view(complex)


def _product(p, q):
    # j c is c* j
    a, b, c, d = p[..., 0], p[..., 1], q[..., 0], q[..., 1]
    return np.stack([a * c - b * d.conj(), a * d + b * c.conj()], axis=-1)


def exponential(vectors):
    """Return the quaternions of rotation vectors, shape (..., 3), rad."""
    x, y, z = np.moveaxis(np.asarray(vectors), -1, 0)
    half = np.sqrt(x * x + y * y + z * z) / 2
    scale = np.divide(np.sin(half), 2 * half, out=np.full_like(half, 0.5), where=half > 0)
    return np.stack([np.cos(half), scale * x, scale * y, scale * z], axis=-1)


def matrix(q):
    """Return the rotation matrices of unit quaternions, shape (..., 4) to (..., 3, 3)."""
    w, x, y, z = np.sqrt(2) * np.moveaxis(np.asarray(q), -1, 0)
    rows = np.empty((3, 3, *np.shape(w)))
    rows[0, 0], rows[0, 1], rows[0, 2] = 1 - y * y - z * z, x * y - w * z, x * z + w * y
    rows[1, 0], rows[1, 1], rows[1, 2] = x * y + w * z, 1 - x * x - z * z, y * z - w * x
    rows[2, 0], rows[2, 1], rows[2, 2] = x * z - w * y, y * z + w * x, 1 - x * x - y * y
    return np.moveaxis(rows, (0, 1), (-2, -1))


def step_vectors(rates, steps, uneven=None):
    """Return the rotation vector of each sampling step.

    The mean rate of a step is that of the cubic through its two samples and one neighbour on
    either side, evenly spaced; the Magnus series then adds what does not commute:

        φ = (-w₋₁ + 13 w₀ + 13 w₁ - w₂) Δt / 24 + (w₀ × w₁) Δt² / 12

    with an error of fifth order a step, fourth over the whole: the order of a Runge–Kutta
    scheme of four stages, while the exponential of φ keeps the quaternion's norm exactly. The
    first and the last step, in a rest by their choice, take the rate as linear. Over a gap the
    cubic is that through the four samples as they lie. Takes angular rate on body axes, rad/s,
    (..., n, 3), time steps, s, and over which of these samples are missing, (..., n - 1).

    References
    ----------
    Iserles, Munthe-Kaas, Nørsett, Zanna, "Lie-group methods", Acta Numerica 9 (2000), section 4.
    """
    # an axis after the other: sums along the samples are then of neighbours in memory
    rates, dt = np.moveaxis(np.asarray(rates), -1, 0), np.asarray(steps)
    first, second = rates[..., :-1], rates[..., 1:]
    vectors = np.moveaxis(mean_rates(np.moveaxis(rates, 0, -1), dt, uneven), -1, 0) * dt
    square = dt**2 / 12
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        vectors[i] += (first[j] * second[k] - first[k] * second[j]) * square
    return np.moveaxis(vectors, 0, -1)


def mean_rates(rates, steps, uneven=None):
    """Return the mean rate of each step that `step_vectors` takes, rad/s; arguments are its own."""
    rates, steps = np.moveaxis(np.asarray(rates), -1, 0), np.asarray(steps)
    total = rates[..., :-1] + rates[..., 1:]
    means = total / 2
    means[..., 1:-1] += (total[..., 1:-1] - rates[..., :-3] - rates[..., 3:]) / 24
    if uneven is not None:
        *row, at = np.nonzero(uneven[..., 1:-1])
        w = [rates[(slice(None), *row, at + i)] for i in range(4)]
        before, step, after = (steps[(*row, at + i)] for i in range(3))
        # stamps that all but meet would only add their noise
        before, after = (np.maximum(side, step / 10) for side in (before, after))
        slope = (w[2] - w[1]) / step
        left = (slope - (w[1] - w[0]) / before) / (before + step)
        right = ((w[3] - w[2]) / after - slope) / (step + after)
        share = (before + step / 2) / (before + step + after)
        bend = left + share * (right - left)
        means[(slice(None), *row, at + 1)] = (w[1] + w[2]) / 2 - step**2 / 6 * bend
    return np.moveaxis(means, 0, -1)


def prefix_product(q):
    """Return ``q₀, q₀q₁, q₀q₁q₂, …`` along the second to last axis.

    The products of neighbours, their prefix products by the same rule, and what lies between: two
    multiplications a quaternion in all.

    References
    ----------
    Blelloch, "Prefix sums and their applications", CMU-CS-90-190 (1990).
    """
    return _prefixes(_pairs(q)).view(float)


def _prefixes(q):
    n = q.shape[-2]
    if n < 2:
        return q
    pairs = _prefixes(_product(q[..., 0 : n - 1 : 2, :], q[..., 1::2, :]))
    prefixes = q.copy()
    prefixes[..., 1::2, :] = pairs
    prefixes[..., 2::2, :] = _product(pairs[..., : (n - 1) // 2, :], q[..., 2::2, :])
    return prefixes


def shortest_turn(before, after):
    """Return the rotation vector that brings direction `after` of the body where `before` was."""
    before, after = (np.asarray(v) / np.linalg.norm(v) for v in (before, after))
    axis = np.cross(after, before)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        axis = np.cross(before, np.eye(3)[np.argmin(np.abs(before))])
    return axis / np.linalg.norm(axis) * np.arctan2(sine, before @ after)
