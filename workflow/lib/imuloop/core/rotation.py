"""Rotations as unit quaternions, scalar first.

The quaternion of an attitude rotates from its body axes to the body axes at the start of the
motion. Each step of a fit uses these functions on large arrays, for which scipy's `Rotation` is 2
to 100 times slower.
"""

import numpy as np
from scipy.spatial.transform import Rotation


def multiply(p, q):
    """Return the quaternion products ``p q``, (..., 4).

    `p` and `q`, (..., 4), are quaternions, which are broadcast against each other.
    """
    return _product(_pairs(p), _pairs(q)).view(float)


def _pairs(q):
    """Return quaternions as pairs of complex numbers, (..., 2).

    `q`, (..., 4), has w, x, y and z of each quaternion ``w + x i + y j + z k``, whose pair is w + x
    i and y + z i.
    """
    return np.ascontiguousarray(q, dtype=float).view(complex)


def _product(p, q):
    """Return the products ``p q`` of quaternions `p` and `q` in complex form, (..., 2).

    In this form a quaternion ``a + b j`` is the pair a = w + x i and b = y + z i (`_pairs`).
    """
    # j c is c* j
    a, b, c, d = p[..., 0], p[..., 1], q[..., 0], q[..., 1]
    return np.stack([a * c - b * d.conj(), a * d + b * c.conj()], axis=-1)


def exponential(vectors):
    """Return the unit quaternions of rotation vectors, scalar first, (..., 4).

    `vectors`, (..., 3), have the direction of the axis of rotation and the length of the angle,
    rad.
    """
    x, y, z = np.moveaxis(np.asarray(vectors), -1, 0)
    half = np.sqrt(x * x + y * y + z * z) / 2
    # sine of half the angle over the length of the vector, and its limit for the vector zero
    scale = np.divide(np.sin(half), 2 * half, out=np.full_like(half, 0.5), where=half > 0)
    return np.stack([np.cos(half), scale * x, scale * y, scale * z], axis=-1)


def matrix(q):
    """Return the rotation matrices of unit quaternions, (..., 3, 3).

    `q`, (..., 4), are the quaternions, scalar first. Each matrix makes the same rotation of a
    column vector as its quaternion.
    """
    # times √2, so that each product below has the factor 2 of the formula of a rotation matrix
    w, x, y, z = np.sqrt(2) * np.moveaxis(np.asarray(q), -1, 0)
    rows = np.empty((3, 3, *np.shape(w)))
    rows[0, 0], rows[0, 1], rows[0, 2] = 1 - y * y - z * z, x * y - w * z, x * z + w * y
    rows[1, 0], rows[1, 1], rows[1, 2] = x * y + w * z, 1 - x * x - z * z, y * z - w * x
    rows[2, 0], rows[2, 1], rows[2, 2] = x * z - w * y, y * z + w * x, 1 - x * x - y * y
    return np.moveaxis(rows, (0, 1), (-2, -1))


def step_vectors(rates, steps, uneven=None):
    """Return the rotation vector φ of each of n - 1 time steps, rad, (..., n - 1, 3).

    φ rotates from the body axes at the end of the step to the body axes at its start.

        φ = (-w₋₁ + 13 w₀ + 13 w₁ - w₂) Δt / 24 + (w₀ × w₁) Δt² / 12

    w₀ and w₁ are the angular rates at both ends of the step Δt; w₋₁ and w₂ are those of the samples
    before and after. The first term is Δt times the mean rate in the step, by a cubic through the
    four samples. The second term is the first term of the Magnus series, which corrects for
    rotations that do not commute. The error is of fifth order in a step, and so of fourth order
    over all steps, the order of a Runge–Kutta scheme with four stages.

    Parameters
    ----------
    rates : ndarray, shape (..., n, 3)
        Angular rate on body axes at n samples, rad/s.
    steps : ndarray, shape (..., n - 1)
        Time steps, s.
    uneven : ndarray of bool, shape (..., n - 1), optional
        For each step, whether samples are missing in it; by default in none.

    References
    ----------
    Iserles, Munthe-Kaas, Nørsett, Zanna, "Lie-group methods", Acta Numerica 9 (2000), section 4.
    """
    rates, dt = np.asarray(rates), np.asarray(steps)
    vectors = mean_rates(rates, dt, uneven) * dt[..., None]
    # the cross product, axis by axis, takes half the time of numpy's
    first, second, square = rates[..., :-1, :], rates[..., 1:, :], dt**2 / 12
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross = first[..., j] * second[..., k] - first[..., k] * second[..., j]
        vectors[..., i] += cross * square
    return vectors


def mean_rates(rates, steps, uneven=None):
    """Return the mean angular rate in each of n - 1 time steps, rad/s, (..., n - 1, 3).

    Each is the mean of the cubic through both samples of the step and one neighbour on either side.
    The four samples are taken as evenly spaced. Exception: in a step in which samples are missing,
    the cubic goes through the samples at their true times. The first and the last step have a
    neighbour on one side only; the rate is taken as linear there, which suffices if the device
    rests.

    Parameters
    ----------
    rates : ndarray, shape (..., n, 3)
        Angular rate on body axes at n samples, rad/s.
    steps : ndarray, shape (..., n - 1)
        Time steps, s.
    uneven : ndarray of bool, shape (..., n - 1), optional
        For each step, whether samples are missing in it; by default in none.
    """
    rates, steps = np.moveaxis(np.asarray(rates), -1, 0), np.asarray(steps)
    total = rates[..., :-1] + rates[..., 1:]
    means = total / 2
    means[..., 1:-1] += (total[..., 1:-1] - rates[..., :-3] - rates[..., 3:]) / 24
    if uneven is not None:
        # for each such step, the samples w before, at both ends and after, and the three steps
        *row, k = np.nonzero(uneven[..., 1:-1])
        w = [rates[(slice(None), *row, k + i)] for i in range(4)]
        before, step, after = (steps[(*row, k + i)] for i in range(3))
        # a much shorter step next to the gap would only add the jitter of its time stamps
        before, after = (np.maximum(side, step / 10) for side in (before, after))
        # half the second derivative of the parabola through the first three samples, and through
        # the last three; the one of the cubic is between them, and linear in time
        slope = (w[2] - w[1]) / step
        first_bend = (slope - (w[1] - w[0]) / before) / (before + step)
        last_bend = ((w[3] - w[2]) / after - slope) / (step + after)
        share = (before + step / 2) / (before + step + after)
        bend = first_bend + share * (last_bend - first_bend)
        # the mean of a parabola with this bend in the middle of the step
        means[(slice(None), *row, k + 1)] = (w[1] + w[2]) / 2 - step**2 / 6 * bend
    return np.moveaxis(means, 0, -1)


def prefix_product(q):
    """Return the prefix products ``q₀, q₀q₁, q₀q₁q₂, …`` of n unit quaternions, (..., n, 4).

    If `q`, (..., n, 4), are the rotations of n steps, the products are the rotations since the
    start. A recursion multiplies neighbours, computes the prefix products of the results, and fills
    in every other product. It needs two multiplications per quaternion.

    References
    ----------
    Blelloch, "Prefix sums and their applications", CMU-CS-90-190 (1990).
    """
    return _prefixes(_pairs(q)).view(float)


def _prefixes(q):
    """Return the prefix products ``q₀, q₀q₁, …`` of n quaternions in complex form, (..., n, 2).

    `q`, (..., n, 2), are the n quaternions in complex form. In this form a quaternion ``a + b j``
    is the pair a = w + x i and b = y + z i (`_pairs`).
    """
    n = q.shape[-2]
    if n < 2:
        return q
    # the products of pairs are every other result; one factor more gives the ones between
    pairs = _prefixes(_product(q[..., 0 : n - 1 : 2, :], q[..., 1::2, :]))
    prefixes = q.copy()
    prefixes[..., 1::2, :] = pairs
    prefixes[..., 2::2, :] = _product(pairs[..., : (n - 1) // 2, :], q[..., 2::2, :])
    return prefixes


def shortest_turn(before, after):
    """Return the rotation vector of the shortest turn between two directions, rad, (3,).

    The vector is on body axes. If a device makes this turn, its body axis `after` ends where its
    body axis `before` was at the start: the turn rotates direction `after` to `before`. `before`
    and `after`, (3,), are vectors of any length on body axes.
    """
    return Rotation.align_vectors(before, after)[0].as_rotvec()
