"""Columns read one at a time are those of the whole table."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.samples import (
    CHANNELS,
    TEMPERATURE,
    TIME,
    Columns,
    read_columns,
    read_samples,
    schema,
)


@pytest.fixture
def path(tmp_path):
    """A samples file of several row groups, temperature with missing values."""
    rng = np.random.default_rng(0)
    table = {name: rng.standard_normal(150_000) for name in (TIME, *CHANNELS, TEMPERATURE)}
    table[TEMPERATURE] = pa.array(table[TEMPERATURE], mask=rng.random(150_000) < 0.9)
    path = tmp_path / "samples.parquet"
    pq.write_table(pa.table(table, schema(True, {})), path, row_group_size=40_000)
    return path


def test_each_column_is_that_of_the_table(path):
    columns, table = Columns(path), read_samples(path)
    assert len(columns) == len(table)
    for name in table:
        assert name in columns
        np.testing.assert_array_equal(np.asarray(columns[name]), np.asarray(table[name]))


def test_an_unknown_column_is_a_key_error(path):
    columns = Columns(path)
    assert "gyro" not in columns
    with pytest.raises(KeyError, match="gyro"):
        columns["gyro"]


def test_only_one_column_takes_memory(path):
    column = Columns(path)["gx"]
    # neither a view of a larger buffer nor kept in the object
    assert column.base is None and column.nbytes == 8 * 150_000
    assert all(not isinstance(kept, np.ndarray) for kept in vars(Columns(path)).values())


def test_a_rejected_session_has_no_rows(tmp_path):
    path = tmp_path / "samples.parquet"
    empty = pd.DataFrame({name: np.empty(0) for name in (TIME, *CHANNELS)})
    empty.to_parquet(path, index=False)
    columns = Columns(path)
    assert len(columns) == 0 and len(columns["az"]) == 0 and TEMPERATURE not in columns


def test_arrays_are_the_columns_of_the_table(path):
    arrays, table = read_columns(path), read_samples(path)
    assert list(arrays) == list(table)
    for name in table:
        np.testing.assert_array_equal(arrays[name], table[name])
    # what a file does not hold is left out: a log without temperature
    assert set(read_columns(path, ("ay", TIME, "t_logged"))) == {TIME, "ay"}
