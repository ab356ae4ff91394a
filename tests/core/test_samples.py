"""Samples by column and by range of rows are those of the whole table, of a file and of a table."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.samples import (
    CHANNELS,
    TEMPERATURE,
    TIME,
    Samples,
    read_columns,
    read_samples,
    sums_over,
)


@pytest.fixture
def table():
    rng = np.random.default_rng(0)
    table = pd.DataFrame(rng.normal(size=(1000, 8)), columns=[TIME, *CHANNELS, TEMPERATURE])
    return table.assign(temperature=table[TEMPERATURE].where(table[TEMPERATURE] > 1))


@pytest.mark.parametrize("size", [None, 7, 333, 5000])
def test_columns_and_ranges_are_those_of_the_table(table, tmp_path, size):
    if size:
        # missing values as Arrow has them
        arrow = pa.Table.from_pandas(table, preserve_index=False)
        pq.write_table(arrow, tmp_path / "s.parquet", row_group_size=size)
    samples = Samples(tmp_path / "s.parquet" if size else table)
    assert len(samples) == 1000 and samples.names == tuple(table)
    for name in table:
        assert name in samples
        np.testing.assert_array_equal(samples[name], table[name])
    for names in (("gx",), (TEMPERATURE, TIME)):
        for first, last in ((0, 1000), (0, 1), (63, 65), (332, 999), (5, 5)):
            expected = table[list(names)].to_numpy()[first:last].T
            np.testing.assert_array_equal(samples.read(names, first, last), expected)
    parts = list(samples.pieces(CHANNELS, 128))
    assert [first for first, _ in parts] == list(range(0, 1000, 128))
    np.testing.assert_array_equal(np.hstack([x for _, x in parts]), table[[*CHANNELS]].T)
    assert samples.interval == np.median(np.diff(table[TIME]))


def test_few_row_groups_are_held(table, tmp_path):
    table.to_parquet(tmp_path / "s.parquet", index=False, row_group_size=10)
    before = pa.total_allocated_bytes()
    samples = Samples(tmp_path / "s.parquet")
    samples.read(CHANNELS, 0, 1000)
    assert samples._group.cache_info().currsize == 3
    assert pa.total_allocated_bytes() < before + 100_000


def test_an_unknown_column_is_a_key_error(table):
    samples = Samples(table)
    assert "gyro" not in samples
    with pytest.raises(KeyError, match="gyro"):
        samples["gyro"]


def test_a_rejected_session_has_no_rows(table, tmp_path):
    path = tmp_path / "samples.parquet"
    table.iloc[:0].to_parquet(path, index=False)
    samples = Samples(path)
    assert len(samples) == len(samples["az"]) == 0 and samples.interval is None
    assert samples.read(CHANNELS, 0, 0).shape == (6, 0)


def test_arrays_are_the_columns_of_the_table(table, tmp_path):
    path = tmp_path / "samples.parquet"
    table.to_parquet(path, index=False)
    pd.testing.assert_frame_equal(read_samples(path), table)
    assert list(read_columns(path)) == list(table)
    for name, values in read_columns(path).items():
        np.testing.assert_array_equal(values, table[name])
    # what a file does not hold is left out: a log without temperature
    assert set(read_columns(path, ("ay", TIME, "t_logged"))) == {TIME, "ay"}


def test_sums_take_the_last_sample_each_column_and_what_lies_inside():
    values = np.random.default_rng(3).normal(size=(10, 2))
    at = np.array([[-3, -1], [-1, 4], [4, 7], [6, 10], [8, 10], [10, 12]])
    expected = [values[max(i, 0) : max(j, 0)].sum(axis=0) for i, j in at]
    np.testing.assert_allclose(sums_over(values, at), expected, rtol=1e-12)
    np.testing.assert_allclose(sums_over(values[:, 0], at), np.array(expected)[:, 0], rtol=1e-12)
