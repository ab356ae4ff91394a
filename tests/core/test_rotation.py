"""Rotation against an independent integrator and the standard library of the field."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from imuloop.core.rotation import exponential, matrix, mean_rates, prefix_product, step_vectors


def rate(t):
    """A rate that turns its axis, so that steps do not commute."""
    return np.array([1.5 * np.sin(3 * t), 2.0 * np.cos(2 * t), 1.0 + 0.5 * np.sin(5 * t)])


def attitude_after(step, end=2.0):
    # a rest before and after, as between poses: the first and last step are cruder
    t = np.arange(round(end / step) + 1) * step
    window = np.sin(np.pi * t / end) ** 4
    return matrix(prefix_product(exponential(step_vectors((rate(t) * window).T, np.diff(t))))[-1])


def test_integration_is_of_fourth_order():
    # an ODE solver on the matrix equation C' = C [w x] knows nothing of quaternions
    def derivative(t, c):
        x, y, z = rate(t) * np.sin(np.pi * t / 2) ** 4
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return (c.reshape(3, 3) @ skew).ravel()

    exact = solve_ivp(derivative, (0, 2), np.eye(3).ravel(), rtol=1e-13, atol=1e-14)
    exact = exact.y[:, -1].reshape(3, 3)
    errors = [np.abs(attitude_after(step) - exact).max() for step in (0.04, 0.02)]
    assert errors[1] < 1e-5
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.2)


def test_over_a_gap_the_rate_is_the_cubic_through_its_neighbours():
    t = np.array([0.0, 0.1, 0.2, 0.5, 0.6, 0.7, 0.8])
    rates = np.column_stack([t**3, 1 - t**2, t])
    step = np.diff(t)
    exact = np.diff(np.column_stack([t**4 / 4, t - t**3 / 3, t**2 / 2]), axis=0) / step[:, None]
    rate_means = mean_rates(rates, step, step > 0.15)
    np.testing.assert_allclose(rate_means[2], exact[2], rtol=1e-12)
    # elsewhere as without
    np.testing.assert_array_equal(
        np.delete(rate_means, 2, 0), np.delete(mean_rates(rates, step), 2, 0)
    )
    # a stamp next to the one before it does not blow up
    t[1] = 0.2 - 1e-9
    rates += np.random.default_rng(0).normal(0, 0.01, rates.shape)
    assert np.abs(mean_rates(rates, np.diff(t), step > 0.15)[2] - exact[2]).max() < 0.1
