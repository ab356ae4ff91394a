"""Samples by column and by range of rows equal the whole table's, from a file and from a table."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.samples import CHANNELS, TEMPERATURE, TIME, Samples


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
    assert samples.interval == np.median(np.diff(table[TIME]))


def test_a_rejected_session_has_no_rows(table, tmp_path):
    path = tmp_path / "samples.parquet"
    table.iloc[:0].to_parquet(path, index=False)
    samples = Samples(path)
    assert len(samples) == len(samples["az"]) == 0 and samples.interval is None
    assert samples.read(CHANNELS, 0, 0).shape == (6, 0)
