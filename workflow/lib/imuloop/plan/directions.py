"""Directions of space: their names, and the direction farthest from all of a set."""

import numpy as np

from imuloop.core.sphere import fibonacci_lattice

# another pose is worthwhile if its angle to the nearest attitude is at least this, degrees
WIDE_HOLE = 50.0
# an axis is part of the name of a direction if its component exceeds this
LEANS = 0.35


def largest_hole(directions):
    """Return the direction farthest from n given ones, (3,), and its angle to the nearest, rad.

    It is the middle of the largest hole that the given directions leave on the sphere. `directions`
    are the n given directions, unit vectors, (n, 3).
    """
    # directions about 4 degrees apart
    grid = fibonacci_lattice(2000)
    nearest = (grid @ np.asarray(directions).T).max(axis=1)
    worst = nearest.argmin()
    return grid[worst], float(np.arccos(np.clip(nearest[worst], -1, 1)))


def direction_words(vector):
    """Return the name of a direction: its axes with a large component, such as ``+x −z``.

    `vector` is a unit vector along the direction, (3,).
    """
    signs = zip(vector, "xyz", strict=True)
    return "\u202f".join(f"{'+' if v > 0 else '−'}{axis}" for v, axis in signs if abs(v) > LEANS)
