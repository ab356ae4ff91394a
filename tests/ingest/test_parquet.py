"""What Parquet files hold beside one table of columns, and which are rejected."""

import json

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import METADATA_KEY


@pytest.fixture
def parquet(tmp_path):
    def call(columns, names=None, metadata=None):
        if names:
            table = pa.Table.from_arrays(columns, names=names)
        else:
            table = pa.table({name: pa.array(x) for name, x in dict(columns).items()})
        pq.write_table(table.replace_schema_metadata(metadata), tmp_path / "log.parquet")
        return tmp_path / "log.parquet"

    return call


def test_what_a_simulated_log_says_of_itself_is_passed_on(log, run, parquet):
    said = {"simulated": True, "units": {"acceleration": "m/s^2", "angular_rate": "deg/s"}}
    path = parquet(log, metadata={b"imuloop": json.dumps(said).encode()})
    done = run(path)
    assert done.metadata["simulated"] is done.quality["simulated"] is True
    np.testing.assert_allclose(done.samples.gz, np.deg2rad(log.gz), rtol=1e-15)
    declared = run(path, units={"angular_rate": "rad/s"})
    assert declared.samples.gz.equals(log.gz)
    line = "units.angular_rate is rad/s, the log says deg/s; rad/s used"
    assert declared.quality["warnings"][0] == line


@pytest.mark.parametrize(("unit", "zone"), [("ms", None), ("us", "Europe/Rome"), ("ns", None)])
def test_dates_are_stamps(log, run, tmp_path, unit, zone):
    moments = pd.Timestamp("2024-03-01T12:00:00", tz="UTC") + pd.to_timedelta(log.t, unit="s")
    moments = pd.Series(moments).dt.round("ms").dt.as_unit(unit)
    log["t"] = moments.dt.tz_convert(zone) if zone else moments.dt.tz_localize(None)
    done = run(log)
    np.testing.assert_array_equal(done.samples.t, np.arange(500) * 10_000_000 * 1e-9)
    assert done.metadata["start"] == "2024-03-01T12:00:00Z"
    assert done.metadata["units"]["time"] == "ISO 8601"


@pytest.mark.parametrize(
    ("column", "values", "words"),
    [("ax", ["text"] * 500, "string, not numbers"), ("t", [[0.0]] * 500, "stamps")],
)
def test_columns_that_hold_no_numbers_are_named(log, run, column, values, words):
    with pytest.raises(ImuloopError, match=rf"column '{column}' holds .*{words}"):
        run(log.assign(**{column: values}))


def test_a_name_that_repeats_is_chosen_by_number(log, run, parquet):
    columns = [pa.array(-log.ax), *(pa.array(log[name]) for name in log)]
    path = parquet(columns, ["ax", *log.columns])
    with pytest.raises(ImuloopError, match=r"both look like acceleration; .* number from 0 to 7"):
        run(path)
    for number, sign in ((0, -1), (2, 1)):
        done = run(path, columns={"acceleration": [number, 3, 4]})
        np.testing.assert_array_equal(done.samples.ax, sign * log.ax)


def test_text_of_numbers_in_a_dictionary_is_stamps(log, run, parquet):
    text = pa.array([f"{t:.2f}" for t in log.t]).dictionary_encode()
    np.testing.assert_array_equal(run(parquet({**log, "t": text})).samples.t, log.t)


def test_damaged_metadata_and_stamps_beyond_64_bits_reject_a_parquet_file(log, run, parquet):
    [reason] = run(parquet(log, metadata={METADATA_KEY: b"[]"})).quality["reasons"]
    assert reason == "the project's metadata in the Parquet file are damaged"
    large = np.uint64(2**63) + np.arange(500, dtype=np.uint64)
    [reason] = run(parquet({**log, "t": large})).quality["reasons"]
    assert reason == "stamps of 2^63 and more are not read"
