"""Damaged files cost their own rows, or the session; never the run."""

import gzip

import netCDF4
import numpy as np
import pandas as pd
import pytest


@pytest.fixture
def long_log():
    rng = np.random.default_rng(0)
    table = pd.DataFrame({"t": np.arange(20_000) / 100})
    for name in "ax ay az gx gy gz".split():
        table[name] = rng.normal(size=20_000) + 9.8 * (name == "az")
    return table


def damaged(content, begin, noise):
    return content[:begin] + noise + content[begin + len(noise) :]


@pytest.mark.parametrize("separator", [",", " "])
@pytest.mark.parametrize("noise", [bytes(300), np.random.default_rng(5).bytes(300), b'"'])
def test_noise_in_a_text_table_costs_only_its_rows(long_log, run, tmp_path, separator, noise):
    path = tmp_path / "log.csv"
    content = long_log.to_csv(index=False, sep=separator).encode()
    path.write_bytes(damaged(content, 1_000_000, noise))
    done = run(path)
    assert done.quality["status"] == "ok"
    assert 19_985 <= done.quality["rows"] < 20_000
    assert done.quality["bad_lines"] + done.quality["non_finite"] >= 1
    # every row kept is one of the log's
    kept = long_log.set_index(np.round(long_log.t * 100)).loc[np.round(done.samples.t * 100)]
    np.testing.assert_array_equal(done.samples.to_numpy(), kept.to_numpy())


def test_a_header_in_another_encoding(long_log, run, tmp_path):
    path = tmp_path / "log.csv"
    header = "Zeit,ax,ay,az,gx [°/s],gy [°/s],gz [°/s]\n".encode("latin-1")
    path.write_bytes(header + long_log.to_csv(index=False, header=False).encode())
    done = run(path, columns={"time": 0})
    assert done.quality["rows"] == 20_000
    assert done.metadata["units"]["angular_rate"] == "deg/s"


@pytest.mark.parametrize("name", ["log.csv.gz", "log.parquet", "log.nc"])
def test_packed_files_are_rejected(long_log, run, tmp_path, name):
    path = tmp_path / name
    if name == "log.nc":
        with netCDF4.Dataset(path, "w") as data:
            data.createDimension("time", len(long_log))
            for column in long_log.columns:
                key = "time" if column == "t" else column
                variable = data.createVariable(key, "f8", ("time",), compression="zlib")
                variable[:] = long_log[column].to_numpy()
    elif name == "log.parquet":
        long_log.to_parquet(path, index=False, compression="gzip", row_group_size=1000)
    else:
        path.write_bytes(gzip.compress(long_log.to_csv(index=False).encode()))
    assert run(path).quality["status"] == "ok"
    content = path.read_bytes()
    half = len(content) // 2
    for spoilt in (content[:half], damaged(content, half, bytes(400))):
        path.write_bytes(spoilt)
        done = run(path)
        assert done.quality["status"] == "rejected"
        assert "file" in done.quality["reasons"][0]
        assert len(done.samples) == 0
