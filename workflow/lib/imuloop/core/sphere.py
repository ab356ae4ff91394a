"""Directions on the sphere: evenly spread, the largest hole between some, in words."""

import numpy as np

# a hole in the attitudes covered that is worth another pose, degrees
WIDE_HOLE = 50.0
# a component of a direction that is worth a word
LEANS = 0.35


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


def largest_hole(directions):
    """Return the direction farthest from unit vectors, (n, 3), and how far the nearest is, rad."""
    # some 4 degrees apart
    grid = fibonacci_lattice(2000)
    nearest = (grid @ np.asarray(directions).T).max(axis=1)
    worst = nearest.argmin()
    return grid[worst], float(np.arccos(np.clip(nearest[worst], -1, 1)))


def count_attitudes(vectors, apart):
    """Return how many directions of vectors, (n, 3), lie farther than an angle, rad, from others.

    In the order given; each that lies farther from all counted before is one more. A vector
    without a direction, zero or not a number, does not count.
    """
    counted, sizes = np.empty((0, 3)), np.linalg.norm(vectors, axis=1)
    for u in vectors[sizes > 0] / sizes[sizes > 0, None]:
        if not np.any(counted @ u >= np.cos(apart)):
            counted = np.vstack([counted, u])
    return len(counted)


def direction_words(vector):
    """Return a direction in words: the axes it leans on, as ``+x −z``."""
    signs = zip(vector, "xyz", strict=True)
    return "\u202f".join(f"{'+' if v > 0 else '−'}{axis}" for v, axis in signs if abs(v) > LEANS)
