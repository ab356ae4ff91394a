"""Even directions: unit vectors, no preferred axis, no crowding."""

import numpy as np
import pytest

from imuloop.core.sphere import fibonacci_lattice


@pytest.mark.parametrize("n", [20, 41, 2000])
def test_directions_are_even(n):
    u = fibonacci_lattice(n)
    np.testing.assert_allclose(np.linalg.norm(u, axis=1), 1)
    # second moments of the sphere: a third along each axis
    np.testing.assert_allclose(u.T @ u / n, np.eye(3) / 3, atol=3 / n)
    cosine = u @ u.T - 2 * np.eye(n)
    nearest = np.arccos(cosine.max(axis=1))
    # n caps of equal area, touching, would be this far apart at most
    ideal = np.sqrt(8 * np.pi / np.sqrt(3) / n)
    assert 0.6 * ideal < nearest.min() and nearest.max() < 1.1 * ideal
