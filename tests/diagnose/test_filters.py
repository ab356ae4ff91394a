"""Filters of a whole log, against closed forms and against plain loops."""

from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuloop.effects.filters import first_order_lag, play, secant

steps = st.floats(1e-3, 1e3)
values = st.floats(-100, 100)
logs = st.lists(st.tuples(steps, values), min_size=1, max_size=60).map(
    lambda rows: (np.cumsum([dt for dt, _ in rows]), np.array([x for _, x in rows]))
)


def lag_step_by_step(t, x, tau):
    """The lag over straight lines, one step after the other, with 28 digits."""
    t, x, tau = [Decimal(v) for v in t.tolist()], [Decimal(v) for v in x.tolist()], Decimal(tau)
    y = [x[0]]
    for start, end, a, b in zip(t, t[1:], x, x[1:], strict=False):
        # particular solution of the differential equation: a line that lags by τ
        slope = (b - a) / (end - start)
        y.append(b - slope * tau + (y[-1] - a + slope * tau) * (-(end - start) / tau).exp())
    return np.array(y, dtype=float)


def play_step_by_step(x, w):
    p = [x[0]]
    for value in x[1:]:
        p.append(min(max(p[-1], value - w), value + w))
    return np.array(p)


@given(logs, st.floats(1e-2, 1e4))
def test_any_stamps_and_any_time_constant(log, tau):
    t, x = log
    np.testing.assert_allclose(first_order_lag(t, x, tau), lag_step_by_step(t, x, tau), atol=1e-11)


@given(logs, st.floats(1e-2, 150))
def test_play_is_the_one_of_its_definition(log, w):
    np.testing.assert_array_equal(play(log[1], w), play_step_by_step(log[1], w))


@pytest.mark.parametrize("seconds", [-9e-3, 9e-3, 23e-3, -0.05])
def test_a_shifted_sine_is_that_sine_but_not_over_a_gap(seconds):
    rng = np.random.default_rng(1)
    t = np.arange(600) / 100 + rng.uniform(-2e-3, 2e-3, 600)
    t[300:] += 0.2
    x = np.sin(2 * np.pi * np.outer(t, [0.5, 1.0, 2.0]))
    rate = np.gradient(x, t, axis=0)
    found, then = secant(t, x, seconds), t + seconds
    lost = ((then > t[299]) & (then < t[300])) | (then < t[0]) | (then > t[-1])
    assert lost.any()
    np.testing.assert_array_equal(found[lost], rate[lost])
    expected = np.sin(2 * np.pi * np.outer(then, [0.5, 1.0, 2.0]))
    left = np.abs(x + seconds * found - expected)
    # slopes lean over the gap, and are of two samples at the ends
    near = np.any([np.abs(then - t[k]) < 0.02 for k in (0, 299, 300, -1)], axis=0)
    assert left[~lost].max() < 3e-3 and left[~lost & ~near].max() < 1e-4
    np.testing.assert_array_equal(secant(t, x, 0.0), rate)
