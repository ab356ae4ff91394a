"""Directions on the sphere: a lattice of even density, and the number of distinct directions."""

import numpy as np


def fibonacci_lattice(n):
    """Return `n` unit vectors that lie about evenly on the sphere, (n, 3).

    Vector k = 0 … n - 1 has the height, the third component, ``1 - (2 k + 1)/n``. Consecutive
    longitudes differ by the golden angle, ``(3 - √5) π``.

    References
    ----------
    González, "Measurement of areas on a sphere using Fibonacci and latitude-longitude lattices",
    Mathematical Geosciences 42 (2010), section 2.
    """
    k = np.arange(n) + 0.5
    z, longitude = 1 - 2 * k / n, k * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(longitude), radius * np.sin(longitude), z], axis=1)


def count_attitudes(vectors, apart):
    """Return the number of attitudes, distinct directions on body axes, among n vectors, an int.

    `vectors`, (n, 3), are taken in order. A vector counts if it is farther than the angle `apart`,
    rad, from all vectors counted before. Vectors that are zero or not-a-number do not count.
    """
    counted, sizes = np.empty((0, 3)), np.linalg.norm(vectors, axis=1)
    for u in vectors[sizes > 0] / sizes[sizes > 0, None]:
        if not np.any(counted @ u >= np.cos(apart)):
            counted = np.vstack([counted, u])
    return len(counted)
