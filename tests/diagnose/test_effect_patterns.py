"""What effects of attitude leave at rest, and which of them leave the same."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import legendre

import imuloop.effects  # noqa: F401  the library of effects
from imuloop.core.effect import Channels, FittedEffect, find_effect
from property.strategies import G, directions


def norms(name, u, **values):
    """Return what an effect adds to the norm of gravity at attitudes u: r = u·e."""
    shape = find_effect(name)()
    channels = Channels(np.arange(len(u)), G * u, 0 * u)
    columns = np.einsum("ni,nip->np", u, shape.design(channels))
    return columns if not values else columns @ [values.get(p, 0.0) for p in shape.parameters]


def test_of_a_square_40_percent_and_of_a_cube_23_percent_are_left():
    u = directions(400, 8)
    for name, scale, degree, share in (("quadratic", G**2, 3, 2 / 5), ("cubic", G**3, 4, 8 / 35)):
        pattern = norms(name, u)[:, 2] / scale
        series = legendre.legfit(u[:, 2], pattern, 4)
        assert series[degree] == pytest.approx(share, abs=1e-9)
        # what is left once the base model took its share: degrees 0, 1, 2
        left = legendre.legval(u[:, 2], series * (np.arange(5) > 2))
        assert np.abs(left).max() <= share + 1e-9


def test_cross_coupling_spans_all_of_degree_three_and_quadratic_is_a_case_of_it():
    u = directions(300, 9)
    coupling, bias = norms("cross_coupling", u) / G**2, u
    both = np.hstack([coupling, bias])
    # all polynomials of degree 3 on the sphere, less those of degree 1: 10 monomials
    x, y, z = u.T
    powers = [(i, j, 3 - i - j) for i in range(4) for j in range(4 - i)]
    monomials = np.column_stack([x**i * y**j * z**k for i, j, k in powers])
    assert np.linalg.matrix_rank(both, tol=1e-9) == np.linalg.matrix_rank(monomials) == 10
    assert np.linalg.matrix_rank(np.hstack([both, monomials]), tol=1e-9) == 10
    # u_x³ = u_x - u_y² u_x - u_z² u_x
    square = norms("quadratic", u, K2x=1.0)
    same = G**2 * u[:, 0] - norms("cross_coupling", u, Kyx=1.0, Kzx=1.0)
    np.testing.assert_allclose(square, same, atol=1e-10)


def test_products_of_one_pattern_share_a_parameter():
    u = directions(50, 10)
    x, y, z = u.T
    # y_x y_y on axis x leaves what y_x² on axis y does
    found = norms("cross_coupling", u, Kxy=1.0)
    np.testing.assert_allclose(found, y * (G * x) ** 2, atol=1e-10)
    # y_y y_z on axis x, y_z y_x on axis y, y_x y_y on axis z: three times the same
    found = norms("cross_coupling", u, Kxyz=1.0)
    np.testing.assert_allclose(found, 3 * G**2 * x * y * z, atol=1e-10)


def test_earth_rate_is_an_isotropic_g_sensitivity_at_rest():
    poses = Channels(np.arange(20.0), np.zeros((20, 3)), G * directions(20, 11))
    isotropic = {f"G{i}{j}": 5e-5 / G * (i == j) for i in range(3) for j in range(3)}
    np.testing.assert_allclose(
        FittedEffect(find_effect("earth_rate")(), {"w_up": 5e-5}, {}).output(poses),
        FittedEffect(find_effect("g_sensitivity")(), isotropic, {}).output(poses),
        atol=1e-18,
    )
    falling = replace(poses, other=np.zeros((20, 3)))
    assert not np.any(find_effect("earth_rate")().design(falling))


def test_g2_is_no_bias_and_no_g_sensitivity_in_well_spread_poses():
    u = directions(400, 12)
    poses = Channels(np.arange(400.0), np.zeros((400, 3)), G * u)
    columns = find_effect("g2_sensitivity")().design(poses)[:, 0, :5] / G**2
    base = np.column_stack([np.ones(400), u])
    assert np.linalg.matrix_rank(np.hstack([columns, base]), tol=1e-6) == 9
    # the sixth product, |f|², is the same everywhere
    assert np.ptp((poses.other**2).sum(axis=1)) < 1e-10
