"""Vibration rectification against a simulated turn and a shaken rest."""

import numpy as np
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from imuloop.core.effect import Channels, find_effect
from property.strategies import G


def test_vibration_is_counted_and_the_turn_beside_it_is_not():
    rng = np.random.default_rng(2)
    t = 0.01 * np.arange(4000)
    y = np.zeros((4000, 3))
    angle = np.clip((t - 19) / 2, 0, 1) * np.pi
    y[:, 2] = G * np.cos(angle - np.sin(2 * angle) / 2)
    turning = (t > 19) & (t < 21)
    y[turning] += rng.normal(scale=1.0, size=(turning.sum(), 3))
    y[:, 0] += np.where(t > 21, np.sqrt(2) * 0.5 * np.sin(2 * np.pi * 17.3 * t), 0)
    y += 0.01 * rng.normal(size=y.shape)
    found = find_effect("vibration_rectification")().design(Channels(t, y, y))
    # all but the tenth of a second beside the turn
    still = (t < 18.9) | (t > 21.1)
    assert found[still, 2, 2].mean() == pytest.approx(1e-4, rel=0.25)
    assert found[still, 2, 2].max() < 2e-4
    np.testing.assert_allclose(found[t > 22, 0, 0], 0.25, rtol=0.06)
