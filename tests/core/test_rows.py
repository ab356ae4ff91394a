"""Ranges of rows are those of the table, and the median step is that of all."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuloop.core import rows as module
from imuloop.core.rows import Rows, median_step, sums_over
from imuloop.core.samples import CHANNELS, TIME, Columns


@pytest.fixture
def table():
    rng = np.random.default_rng(0)
    return pd.DataFrame(rng.normal(size=(1000, 7)), columns=[TIME, *CHANNELS])


@pytest.mark.parametrize("size", [1, 64, 333, 1000, 5000])
def test_a_range_is_that_of_the_table(table, tmp_path, size):
    table.to_parquet(tmp_path / "s.parquet", index=False, row_group_size=size)
    for rows in (Rows(table), Rows(Columns(tmp_path / "s.parquet"))):
        assert len(rows) == 1000 and rows.names == (TIME, *CHANNELS)
        for names in (("gx",), ("az", TIME)):
            for first, last in ((0, 1000), (0, 1), (63, 65), (332, 999), (5, 5), (400, 500)):
                expected = table[list(names)].to_numpy()[first:last].T
                np.testing.assert_array_equal(rows.read(names, first, last), expected)
        places = [0, 998, 64, 64, 999]
        np.testing.assert_array_equal(rows.at("gy", places), table["gy"].to_numpy()[places])
        parts = list(rows.pieces(CHANNELS, 128))
        assert [first for first, _ in parts] == list(range(0, 1000, 128))
        np.testing.assert_array_equal(np.hstack([x for _, x in parts]), table[[*CHANNELS]].T)
        steps = np.concatenate([s for _, s in rows.time_steps(77)])
        np.testing.assert_array_equal(steps, np.diff(table[TIME]))


def test_few_row_groups_are_held(table, tmp_path):
    table.to_parquet(tmp_path / "s.parquet", index=False, row_group_size=10)
    rows = Rows(Columns(tmp_path / "s.parquet"))
    rows.read(CHANNELS, 0, 1000)
    held = [x for x in vars(rows).values() if isinstance(x, dict)]
    assert sum(array.size for each in held for array in each.values()) <= 3 * 10 * len(CHANNELS)


@given(st.lists(st.sampled_from([0.0, 1.0, 1.5, 2.0, 1e-9]) | st.floats(0, 1e6), max_size=60))
def test_the_median_step_is_exact_however_few_steps_tell_where_it_lies(steps):
    t = np.concatenate([[0.0], np.cumsum(steps)])
    rows = Rows(pd.DataFrame({TIME: t}))
    told, module._TOLD = module._TOLD, 5
    try:
        found = median_step(rows)
    finally:
        module._TOLD = told
    assert found == (np.median(np.diff(t)) if len(steps) else None)


def test_a_bracket_that_misses_the_median_is_widened(monkeypatch):
    """Every other step is long: the part that tells sees those alone."""
    monkeypatch.setattr(module, "_TOLD", 500)
    steps = np.tile([3.0, 1.0, 1.0], 1000) + np.random.default_rng(1).normal(size=3000) * 1e-3
    t = np.concatenate([[0.0], np.cumsum(steps)])
    monkeypatch.setattr(module.Rows, "time_steps", lambda self: [(0, np.diff(t))])
    assert median_step(Rows(pd.DataFrame({TIME: t}))) == np.median(np.diff(t))


def test_sums_take_the_last_sample_each_column_and_what_lies_inside():
    values = np.random.default_rng(3).normal(size=(10, 2))
    at = np.array([[-3, -1], [-1, 4], [4, 7], [6, 10], [8, 10], [10, 12]])
    expected = [values[max(i, 0) : max(j, 0)].sum(axis=0) for i, j in at]
    np.testing.assert_allclose(sums_over(values, at), expected, rtol=1e-12)
    np.testing.assert_allclose(sums_over(values[:, 0], at), np.array(expected)[:, 0], rtol=1e-12)
    np.testing.assert_array_equal(sums_over(values[:6], at[4:]), np.zeros((2, 2)))
