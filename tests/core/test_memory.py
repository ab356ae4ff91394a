"""Functions of a log that remember its past, against closed forms and against plain loops."""

from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuloop.core.memory import fast_part, filled, first_order_lag, moving_mean, play, secant

TAU = 4.0
steps = st.floats(1e-3, 1e3)
values = st.floats(-100, 100)
logs = st.lists(st.tuples(steps, values), min_size=1, max_size=60).map(
    lambda rows: (np.cumsum([dt for dt, _ in rows]), np.array([x for _, x in rows]))
)


def irregular(end, n, seed=0):
    """Return stamps from zero to `end` at random distances, one stretch of them lost."""
    t = np.sort(np.random.default_rng(seed).uniform(0, end, n))
    return np.concatenate([[0.0], t[(t < 0.3 * end) | (t > 0.5 * end)], [end]])


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


def test_a_moving_mean_is_that_of_the_samples_in_the_window():
    t = irregular(20.0, 400)
    x = np.random.default_rng(5).normal(3, 0.3, (len(t), 2))
    found = moving_mean(t, x, 1.5)
    for k in range(0, len(t), 17):
        inside = (t >= t[k] - 1.5) & (t <= t[k])
        np.testing.assert_allclose(found[k], x[inside].mean(axis=0), rtol=1e-12)


@pytest.mark.parametrize(
    ("frequency", "left"), [(1.0, 0.033), (4.43, 0.5), (10.0, 1.0), (13.0, 0.96)]
)
def test_the_fast_part_of_a_sine_is_one_less_the_square_of_sinc(frequency, left):
    t = np.arange(20_000) / 1000
    x = np.sin(2 * np.pi * frequency * t)[:, None]
    inner = slice(1000, -1000)
    share = 1 - np.sinc(0.1 * frequency) ** 2
    assert share == pytest.approx(left, rel=0.02)
    np.testing.assert_allclose(fast_part(t, x, 0.1)[inner], share * x[inner], atol=0.01)


@pytest.mark.parametrize("rate", [1.0, 100.0])
def test_nothing_of_an_even_motion_is_fast(rate):
    t = np.arange(300) / rate
    x = np.column_stack([np.full(300, 9.8), 5 * t])
    found = fast_part(t, x, 0.1)
    np.testing.assert_allclose(found[15:-15], 0, atol=1e-9)
    np.testing.assert_allclose(fast_part(t[:1], x[:1], 0.1), 0, atol=1e-12)


def test_gaps_lie_on_a_line_and_ends_are_held():
    t = np.array([0.0, 1, 2, 4, 5, 6])
    known = np.array([np.nan, 3, np.nan, 9, 1, np.nan])
    np.testing.assert_allclose(filled(t, known), [3, 3, 5, 9, 1, 1])
    whole = np.arange(6.0)
    assert filled(t, whole) is whole
    assert np.isnan(filled(t, np.full(6, np.nan))).all()


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
