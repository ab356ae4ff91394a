"""Effects that remember the log, against closed forms."""

from itertools import pairwise

import numpy as np
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from imuloop.core.effect import Channels, find_effect
from property.strategies import G


def heated(n=4001, dt=1.0, rate=0.02):
    """Return channels of a chamber: a ramp up, as long a ramp down, then nothing."""
    t = dt * np.arange(n)
    top, end = t[n // 3], t[2 * (n // 3)]
    warm = 20 + rate * np.interp(t, [0, top, end, t[-1]], [0, top, 2 * top - end, 2 * top - end])
    return Channels(t, np.zeros((n, 3)), np.zeros((n, 3)), warm), top, end


@pytest.mark.parametrize("tau", [10.0, 300.0])
def test_the_rate_of_temperature_is_that_of_a_ramp_through_a_lag(tau):
    channels, top, end = heated()
    t, v = channels.t, 0.02
    since_top, since_end = np.maximum(t - top, 0), np.maximum(t - end, 0)
    # three changes of slope: +v at the start, -2v at the top, +v at the end
    expected = v * (
        (1 - np.exp(-t / tau)) - 2 * (1 - np.exp(-since_top / tau)) + (1 - np.exp(-since_end / tau))
    )
    found = find_effect("bias_temperature_rate")(tau).design(channels)
    np.testing.assert_allclose(found, expected[:, None, None] * np.eye(3), atol=1e-12)


def test_minus_c1_tau_is_exactly_a_sensor_that_lags_behind_the_thermometer():
    t, tau, c1, dt = np.arange(0, 60, 0.05), 10.0, 0.3, 0.05
    warm = 22 + 9 * np.sin(t / 7) + 0.1 * t
    channels = Channels(t, *np.zeros((2, len(t), 3)), warm)
    straight = find_effect("bias_temperature")(1, 0.0).design(channels)[:, 0, 0]
    rate = find_effect("bias_temperature_rate")(tau).design(channels)[:, 0, 0]
    lagged, a = [warm[0]], np.exp(-dt / tau)
    for x, y in pairwise(warm):
        slope = (y - x) / dt
        lagged.append(y - slope * tau + (lagged[-1] - x + slope * tau) * a)
    np.testing.assert_allclose(c1 * straight - c1 * tau * rate, c1 * np.array(lagged), rtol=1e-12)


def test_hysteresis_is_one_while_heating_and_minus_one_while_cooling():
    channels, top, _ = heated()
    t, w = channels.t, 2.0
    found = find_effect("thermal_hysteresis")(w).design(channels)[:, 2, 2]
    started, turned = w / 0.02, 2 * w / 0.02
    np.testing.assert_allclose(found[t <= started], t[t <= started] / started, atol=1e-12)
    np.testing.assert_allclose(found[(t >= started) & (t <= top)], 1.0)
    crossing = (t >= top) & (t <= top + turned)
    np.testing.assert_allclose(found[crossing], 1 - (t[crossing] - top) * 0.02 / w, atol=1e-10)
    # at rest the branch is remembered for ever
    np.testing.assert_allclose(found[t >= top + turned], -1.0)


@pytest.mark.parametrize("tau", [3.0, 30.0])
def test_creep_relaxes_after_a_turn(tau):
    t = 0.01 * np.arange(6000)
    y = np.where(t[:, None] < 10, [0, 0, G], [G, 0, 0.0])
    found = find_effect("reorientation")(tau).design(Channels(t, y, y * 0))
    after = t >= 10
    # the turn lies on a line from the sample before: so much of it is left at its end
    left = tau / 0.01 * (1 - np.exp(-0.01 / tau))
    expected = -G * left * np.exp(-(t[after] - 10) / tau)
    np.testing.assert_allclose(found[after, 0, 0], expected, atol=1e-10)
    np.testing.assert_allclose(found[after, 2, 2], -expected, atol=1e-10)
    assert not np.any(found[~after])


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
