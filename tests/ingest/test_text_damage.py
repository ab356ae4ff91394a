"""Numbers of text, long lines, bombs and damage."""

import gzip

import netCDF4
import numpy as np
import pyarrow as pa
import pytest

from imuloop.ingest import delimited
from ingest.logs import brief
from ingest.text_forms import (
    NUMBERS,
    SIX,
    text,
)

ODD = [" 1.5", "1.5 ", "+2", ".5", "5.", "1e-7", "-inf", " nan", "NULL", "", "oops", "0x1p3", "1_0"]
BIG = 140363657976355584


@pytest.mark.parametrize(
    ("stamps", "value"),
    [
        (lambda i: str(BIG + i), lambda i: BIG + i),
        (lambda i: f" {BIG + i}" if i % 3 else "", lambda i: BIG + i if i % 3 else None),
        # a first line whose stamp is unlike the others
        (lambda i: str(BIG + i) if i else "1.5,2", lambda i: BIG + i if i else None),
        (lambda i: f"{i}.25" if i % 5000 else str(i), lambda i: i + 0.25 if i % 5000 else float(i)),
        (lambda i: f"{i}.25" if i != 9 else "oops", lambda i: i + 0.25 if i != 9 else None),
    ],
)
def test_numbers_read_at_once_are_those_of_the_text(tmp_path, stamps, value):
    rng, count = np.random.default_rng(3), 12_000
    exact = rng.normal(size=count) * 10.0 ** rng.integers(-300, 300, size=count)
    rows = [f"{stamps(i)},{x!r},0.1,1,2,3,4\n" for i, x in enumerate(exact.tolist())]
    for i, odd in enumerate(ODD, 7000):
        rows[i] = rows[i].replace(",1,2,", f",{odd},2,")
    (tmp_path / "log.csv").write_text("t,ax,ay,az,gx,gy,gz\n" + "".join(rows))
    log = delimited.read({"log": tmp_path / "log.csv"})
    table = log.batch
    kept = [i for i in range(count) if "," not in stamps(i)]
    assert log.bad_lines == count - len(kept)
    assert table["stamp"].to_pylist() == [value(i) for i in kept]
    assert table["ax"].to_pylist() == [exact[i] for i in kept]
    az = np.ones(count)
    az[7000 : 7000 + len(ODD)] = [1.5, 1.5, 2, 0.5, 5, 1e-7, -np.inf] + [np.nan] * 6
    np.testing.assert_array_equal(table["az"].to_numpy().astype(float), az[kept])


@pytest.mark.parametrize("separator", [" ", ","])
@pytest.mark.parametrize("size", [1 << 16, (1 << 21) + 3])
def test_a_line_that_is_too_long_is_no_row(log, run, tmp_path, separator, size):
    path = tmp_path / "log.txt"
    every = text(log, sep=separator).splitlines(keepends=True)
    # the longest line of all that counts has a row's columns
    every[300] = every[300].rstrip("\n").ljust(size - 1, "0") + "\n"
    every.append("0" * size)
    path.write_text("".join(every))
    read = delimited.read({"log": path})
    samples, whole = read.batch.to_pandas(), size <= 1 << 16
    assert read.bad_lines == (1 if whole else 2)
    lost = every[-1] if whole else every[300] + every[-1]
    # blanks hold nothing
    assert read.lost_bytes == len(lost.replace(" ", ""))
    assert read.text_bytes == len("".join(every[1:]).replace(" ", ""))
    kept = log if whole else log.drop(index=299)
    np.testing.assert_allclose(samples[SIX], kept[SIX], rtol=1e-4)
    # most of the file is lost
    [reason] = run(path).quality["reasons"]
    assert "of the log's bytes are in" in reason


def test_a_bomb_is_refused(run, tmp_path):
    path = tmp_path / "log.csv.zst"
    with pa.output_stream(path, compression="detect") as stream:
        for _ in range(8):
            stream.write(b"0.1,1,2,3,4,5,6\n" * (1 << 16))
    [reason] = run(path, **NUMBERS).quality["reasons"]
    assert reason == (
        f"unpacked, the file is more than 200 times its {path.stat().st_size} bytes: refused, "
        "no log packs so well"
    )


def damaged(content, begin, noise):
    return content[:begin] + noise + content[begin + len(noise) :]


@pytest.mark.parametrize("separator", [",", " "])
@pytest.mark.parametrize("noise", [bytes(300), np.random.default_rng(5).bytes(300), b'"'])
def test_noise_in_a_text_table_costs_only_its_rows(run, tmp_path, separator, noise):
    log, path = brief(5000), tmp_path / "log.csv"
    path.write_bytes(damaged(text(log, sep=separator).encode(), 200_000, noise))
    done = run(path)
    assert done.quality["status"] == "ok" and 4985 <= done.quality["rows"] < 5000
    assert done.quality["bad_lines"] + done.quality["non_finite"] >= 1
    # every row kept is one of the log's
    kept = log.loc[np.round(done.samples.t * 100)]
    np.testing.assert_array_equal(done.samples[[*log]], kept)


@pytest.mark.parametrize("name", ["log.csv.gz", "log.parquet", "log.nc"])
def test_packed_files_that_are_cut_off_or_spoilt_are_rejected(run, tmp_path, name):
    log, path = brief(20_000), tmp_path / name
    if name == "log.nc":
        with netCDF4.Dataset(path, "w") as data:
            data.createDimension("time", len(log))
            for column in log.columns:
                variable = data.createVariable(column, "f8", ("time",), compression="zlib")
                variable[:] = log[column].to_numpy()
    elif name == "log.parquet":
        log.to_parquet(path, index=False, compression="gzip", row_group_size=1000)
    else:
        path.write_bytes(gzip.compress(text(log).encode()))
    assert run(path).quality["status"] == "ok"
    content = path.read_bytes()
    half = len(content) // 2
    for spoilt in (content[:half], damaged(content, half, bytes(400))):
        path.write_bytes(spoilt)
        done = run(path)
        assert done.quality["status"] == "rejected" and len(done.samples) == 0
        assert "file" in done.quality["reasons"][0]
