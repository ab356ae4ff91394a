"""Parquet logs."""

import json

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import METADATA_KEY
from imuloop.ingest.tables import read_parquet


@pytest.mark.parametrize("kind", ["f4", "f8"])
@pytest.mark.parametrize("packing", ["none", "snappy", "zstd", "brotli"])
def test_every_bit(hard, hard_stamps, every_bit, tmp_path, kind, packing):
    path = tmp_path / "log.parquet"
    values = hard.astype(kind)
    columns = dict(zip(["ax", "ay", "az", "gx", "gy", "gz"], values.T, strict=True))
    pq.write_table(pa.table({"t": hard_stamps, **columns}), path, compression=packing)
    every_bit(path, values, hard_stamps)


def test_what_a_simulated_log_says_is_passed_on(log, run, tmp_path):
    path = tmp_path / "log.parquet"
    said = {"simulated": True, "units": {"acceleration": "m/s^2", "angular_rate": "deg/s"}}
    table = pa.Table.from_pandas(log, preserve_index=False)
    pq.write_table(table.replace_schema_metadata({b"imuloop": json.dumps(said).encode()}), path)
    done = run(path)
    assert done.metadata["simulated"] is True
    assert done.quality["simulated"] is True
    np.testing.assert_allclose(done.samples.gz, np.deg2rad(log.gz), rtol=1e-15)
    declared = run(path, units={"angular_rate": "rad/s"})
    assert declared.samples.gz.equals(log.gz)
    assert declared.quality["warnings"][0] == (
        "units.angular_rate is rad/s, the log says deg/s; rad/s used"
    )


@pytest.mark.parametrize(("unit", "zone"), [("ms", None), ("us", "Europe/Rome"), ("ns", None)])
def test_dates_as_stamps(log, run, tmp_path, unit, zone):
    path = tmp_path / "log.parquet"
    moments = pd.Timestamp("2024-03-01T12:00:00", tz="UTC") + pd.to_timedelta(log.t, unit="s")
    moments = pd.Series(moments).dt.round("ms").dt.as_unit(unit)
    log["t"] = moments.dt.tz_convert(zone) if zone else moments.dt.tz_localize(None)
    log.to_parquet(path, index=False)
    done = run(path)
    np.testing.assert_array_equal(done.samples.t, np.arange(500) * 10_000_000 * 1e-9)
    assert done.metadata["start"] == "2024-03-01T12:00:00Z"
    assert done.metadata["units"]["time"] == "ISO 8601"


def test_wrong_files_and_columns(log, run, tmp_path):
    path = tmp_path / "log.parquet"
    path.write_bytes(b"PAR1 and then nothing")
    done = run(path)
    assert done.quality["status"] == "rejected"
    assert done.quality["reasons"] == ["the file is not a whole Parquet file"]
    for column, values, words in (("ax", "text", "string, not numbers"), ("t", [[0.0]], "stamps")):
        log.assign(**{column: values * 500 if column == "t" else values}).to_parquet(path)
        with pytest.raises(ImuloopError, match=rf"column '{column}' holds .*{words}"):
            run(path)
    table = pa.Table.from_pandas(log, preserve_index=False)
    pq.write_table(table.replace_schema_metadata({METADATA_KEY: b"[]"}), path)
    [reason] = run(path).quality["reasons"]
    assert reason == "the project's metadata in the Parquet file are damaged"


def test_a_name_that_repeats(log, run, tmp_path):
    path = tmp_path / "log.parquet"
    columns = [pa.array(log[name]) for name in log.columns]
    table = pa.Table.from_arrays([pa.array(-log.ax), *columns], names=["ax", *log.columns])
    pq.write_table(table, path)
    with pytest.raises(ImuloopError, match=r"both look like acceleration; .* number from 0 to 7"):
        run(path)
    for number, sign in ((0, -1), (2, 1)):
        done = run(path, columns={"acceleration": [number, 3, 4]})
        np.testing.assert_array_equal(done.samples.ax, sign * log.ax)
        np.testing.assert_array_equal(done.samples.ay, log.ay)


def test_numbers_and_stamps_of_other_types(log, run, tmp_path):
    path = tmp_path / "log.parquet"
    columns = {name: pa.array(log[name]) for name in log.columns}
    columns["t"] = pa.array([f"{t:.2f}" for t in log.t]).dictionary_encode()
    # more than 53 bits
    counts = 2**60 + 1 + 1000 * np.arange(500)
    columns["gx"] = pa.array(counts)
    pq.write_table(pa.table(columns), path)
    read = pa.Table.from_batches(read_parquet({"log": path}).batches)
    np.testing.assert_array_equal(read["gx"], counts.astype(float))
    columns["gx"] = pa.array(log.gx)
    pq.write_table(pa.table(columns), path)
    np.testing.assert_array_equal(run(path).samples.t, log.t)
    columns["t"] = pa.array(np.uint64(2**63) + np.arange(500, dtype=np.uint64))
    pq.write_table(pa.table(columns), path)
    assert run(path).quality["reasons"] == ["stamps of 2^63 and more are not read"]
