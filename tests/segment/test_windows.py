"""Sliding statistics against a direct computation."""

import numpy as np
import pytest

from imuloop.segment.windows import rounding_variance, sliding_statistics


@pytest.mark.parametrize("n", [2, 7, 60])
def test_sliding_statistics_are_those_of_each_window(n):
    x = 1e4 + np.random.default_rng(1).normal(size=(60, 3))
    mean, variance = sliding_statistics(x, n)
    for i in range(60):
        first = min(max(i - n // 2, 0), 60 - n)
        window = x[first : first + n]
        np.testing.assert_allclose(mean[i], window.mean(axis=0), rtol=1e-13)
        np.testing.assert_allclose(variance[i], window.var(axis=0), rtol=1e-9)


def test_a_value_that_is_far_too_large_spoils_its_own_windows_alone():
    x = np.random.default_rng(4).normal(size=(5000, 3))
    spoiled = x.copy()
    spoiled[1000, 1] = 1e9
    away = np.abs(np.arange(5000) - 1000) > 100
    for found, sound in zip(*map(sliding_statistics, (spoiled, x), (100, 100)), strict=True):
        np.testing.assert_allclose(found[away], sound[away], rtol=1e-9, atol=1e-12)


def test_a_rest_after_fast_turns_has_its_own_variance():
    x = 1e-5 * np.random.default_rng(5).normal(size=(3000, 1))
    turned = x + 35 * np.sin(np.arange(3000) / 20)[:, None] * (np.arange(3000) < 1500)[:, None]
    for found, alone in zip(*map(sliding_statistics, (turned, x), (100, 100)), strict=True):
        np.testing.assert_allclose(found[1600:], alone[1600:], rtol=1e-9, atol=1e-18)


def test_rounding_variance_is_that_of_the_resolution():
    rng = np.random.default_rng(3)
    x = np.round(rng.normal(size=(1000, 3)) / 0.25) * 0.25 * 9.80665
    x[500, 1] = 1e10
    assert rounding_variance(x) == pytest.approx((0.25 * 9.80665) ** 2 / 12)
    assert rounding_variance(np.full((10, 3), 9.8)) > 0
