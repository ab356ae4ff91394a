"""Directions on the sphere: the largest hole between some of them, and their names."""

import numpy as np

from imuloop.core.sphere import fibonacci_lattice

# least angle from the nearest attitude at which another pose is worthwhile, degrees
WIDE_HOLE = 50.0
# least component of a direction that is part of its name
LEANS = 0.35


def largest_hole(directions):
    """Return the direction farthest from unit vectors, (n, 3), and its angle to them, rad."""
    # directions about 4 degrees apart
    grid = fibonacci_lattice(2000)
    nearest = (grid @ np.asarray(directions).T).max(axis=1)
    worst = nearest.argmin()
    return grid[worst], float(np.arccos(np.clip(nearest[worst], -1, 1)))


def direction_words(vector):
    """Return the name of a direction, (3,): the axes with a large component, such as ``+x −z``."""
    signs = zip(vector, "xyz", strict=True)
    return "\u202f".join(f"{'+' if v > 0 else '−'}{axis}" for v, axis in signs if abs(v) > LEANS)
