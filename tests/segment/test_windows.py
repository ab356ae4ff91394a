"""Sliding statistics and ranges of samples against a direct computation."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuloop.core.samples import Samples
from imuloop.segment.stretches import merged, runs, unbroken, without
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


def test_runs_and_stretches():
    assert runs([1, 1, 0, 1]).tolist() == [[0, 2], [3, 4]]
    assert runs([0, 0]).tolist() == [] and runs([1]).tolist() == [[0, 1]]
    stretches, step = unbroken(Samples(pd.DataFrame({"t": [0.0, 1.0, 2.0, 4.0, 5.0, 6.4]})), 1.5)
    assert stretches.tolist() == [[0, 3], [3, 6]]
    assert step == 1.0
    assert unbroken(Samples(pd.DataFrame({"t": []})), 1.5)[0].shape == (0, 2)


@given(
    st.lists(st.tuples(st.integers(0, 60), st.integers(1, 9)), min_size=1, max_size=12), st.data()
)
def test_cuts_leave_what_a_mask_leaves(cuts, data):
    edges = sorted(data.draw(st.sets(st.integers(0, 60), min_size=2, max_size=8)))
    ranges = np.array(list(pairwise(edges))[::2])
    cuts = merged(np.array([(i, i + n) for i, n in cuts], dtype=int).reshape(-1, 2))
    assert np.all(cuts[1:, 0] > cuts[:-1, 1])
    left = []
    for i, j in ranges:
        mask = np.ones(j - i, dtype=bool)
        for first, last in cuts:
            mask[max(first - i, 0) : max(last - i, 0)] = False
        left += (runs(mask) + i).tolist()
    assert without(ranges, cuts).tolist() == left
