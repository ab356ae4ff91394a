"""Directions evenly spread over the sphere."""

import numpy as np


def fibonacci_lattice(n):
    """Return `n` unit vectors of nearly equal distance, shape (n, 3).

    Heights ``1 - (2 k + 1)/n`` at longitudes a golden angle apart, ``(3 - √5) π``.

    References
    ----------
    González, "Measurement of areas on a sphere using Fibonacci and latitude-longitude lattices",
    Mathematical Geosciences 42 (2010), section 2.
    """
    k = np.arange(n) + 0.5
    z, longitude = 1 - 2 * k / n, k * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(longitude), radius * np.sin(longitude), z], axis=1)
