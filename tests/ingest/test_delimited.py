"""Text tables, however they are written."""

import gzip

import numpy as np
import pandas as pd
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.ingest import delimited
from imuloop.ingest.delimited import find_layout

SIX = "ax ay az gx gy gz".split()


def same(samples, log):
    """Whether samples hold the log to the last bit."""
    for name in log.columns:
        np.testing.assert_array_equal(samples[name], log[name])
    return True


@pytest.mark.parametrize("separator", [",", "\t", ";", " "])
@pytest.mark.parametrize("header", [True, False])
def test_separators_with_and_without_header(log, run, tmp_path, separator, header):
    path = tmp_path / "log.csv"
    log.to_csv(path, index=False, sep=separator, header=header)
    columns = None if header else {"time": 0, "acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}
    done = run(path, columns=columns)
    assert done.quality["status"] == "ok"
    assert same(done.samples, log)


def test_runs_of_blanks_with_leading_and_trailing_ones(log, run, tmp_path):
    path = tmp_path / "log.txt"
    rows = ["   " + "    ".join(map(repr, row)) + "  \r\n" for row in log.to_numpy().tolist()]
    path.write_text("".join(rows))
    columns = {"time": 0, "acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}
    assert same(run(path, columns=columns).samples, log)


def test_decimal_commas(log, run, tmp_path):
    path = tmp_path / "log.csv"
    log.to_csv(path, index=False, sep=";", decimal=",")
    assert same(run(path).samples, log)


def test_compressed_and_no_newline_at_the_end(log, run, tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(log.to_csv(index=False).rstrip("\n").encode()))
    assert same(run(path).samples, log)


def test_byte_order_mark_preamble_blank_lines_and_other_columns(log, run, tmp_path):
    path = tmp_path / "log.csv"
    log.insert(3, "note", "still")
    log.insert(0, "count", np.arange(len(log)))
    table = log.to_csv(index=False)
    path.write_bytes(b"\xef\xbb\xbfLogger 3, version 2\n\n" + table.encode("utf-8"))
    done = run(path)
    assert same(done.samples, log[["t", *SIX]])
    assert done.quality["bad_lines"] == 0
    assert done.quality["warnings"] == ["1 line(s) before the table skipped"]


def test_header_in_a_comment_as_euroc_writes_it(run, tmp_path):
    path = tmp_path / "data.csv"
    header = (
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
        "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
    )
    start = 1403636579763555584
    rows = [f"{start + 5_000_000 * i},0.1,0.2,0.{i % 3},8.1,-0.3,-{i % 3}.2" for i in range(600)]
    path.write_text("\n".join([header, *rows]) + "\n")
    done = run(path)
    assert done.metadata["units"]["time"] == "ns"
    np.testing.assert_array_equal(done.samples.t, np.arange(600) * 5_000_000 * 1e-9)
    assert done.samples.gy[0] == 0.2
    assert done.samples.ax[0] == 8.1
    # published start of the sequence, 2014-06-24
    assert done.metadata["start"] == "2014-06-24T19:02:59.763555584Z"


def test_unreadable_values_and_lines_are_dropped_and_counted(log, run, tmp_path):
    path = tmp_path / "log.csv"
    lines = log.to_csv(index=False).splitlines()
    lines[5] = "0.04,oops,0,0,0,0,0"
    lines[6] = "0.05,,0,0,0,0,0"
    lines[7] = "0.06,nan,0,0,0,0,0"
    lines[8] = "0.07,inf,0,0,0,0,0"
    lines[9] = "0.08,1,2"
    path.write_text("\n".join(lines) + "\n0.5,1")
    done = run(path)
    assert done.quality["status"] == "ok"
    assert done.quality["non_finite"] == 4
    assert done.quality["missing_values"]["ax"] == 4
    assert done.quality["bad_lines"] == 2
    assert same(done.samples, log.drop(index=range(4, 9)).reset_index(drop=True))


def test_nothing_depends_on_the_size_of_a_batch(log, run, tmp_path):
    path = tmp_path / "log.csv"
    big = pd.concat([log] * 20, ignore_index=True)
    big["t"] = 1_000_000 + 10_000 * np.arange(len(big))
    # whole and decimal numbers in one column, and faults, all over the file
    big["ax"] = big["ax"].where(big.index % 50 != 0, 1)
    big.loc[777::1000, "gy"] = np.nan
    big.loc[500, "t"] = big.loc[499, "t"]
    big.to_csv(path, index=False)
    found = []
    for batch_rows in (1 << 16, 70, 700):
        done = run(path, units={"time": "us"}, batch_rows=batch_rows)
        found.append((done.path.read_bytes(), done.quality))
    assert found[0] == found[1] == found[2]
    assert found[0][1]["non_finite"] == 10


def test_memory_is_bounded(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,ax,ay,az,gx,gy,gz\n" + "0.1,1,2,3,4,5,6\n" * 100_000)
    log = delimited.read({"log": path}, batch_rows=1000)
    rows = [batch.num_rows for batch in log.batches]
    assert sum(rows) == 100_000
    # a block is 64 bytes a row asked for
    assert max(rows) <= 4100


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("", "no rows"),
        ("%PDF-1.4 something\nthat is no table\nat all\n", "not a table"),
        ("t,ax,ay,az,gx,gy,gz\n", "not a table"),
    ],
)
def test_a_file_that_is_no_table_is_rejected(run, tmp_path, content, reason):
    path = tmp_path / "log.csv"
    path.write_text(content)
    done = run(path)
    assert done.quality["status"] == "rejected"
    assert reason in done.quality["reasons"][0]
    assert len(done.samples) == 0


def test_headerless_log_needs_numbers(log, run, tmp_path):
    path = tmp_path / "log.csv"
    log.to_csv(path, index=False, header=False)
    with pytest.raises(ImuloopError, match=r"imu/poses: .*log\.csv: .*by number from 0"):
        run(path)
    with pytest.raises(ImuloopError, match="no header, so 'ax' cannot be found"):
        run(path, columns={"acceleration": ["ax", "ay", "az"], "angular_rate": [4, 5, 6]})
    with pytest.raises(ImuloopError, match="there is no column 7; the log has 7"):
        run(path, columns={"acceleration": [1, 2, 3], "angular_rate": [5, 6, 7]})


def test_layout_of_a_file_longer_than_what_is_looked_at(log, tmp_path):
    path = tmp_path / "log.tsv"
    pd.concat([log] * 10).to_csv(path, index=False, sep="\t")
    layout = find_layout(path)
    assert (layout.separator, layout.headed, layout.names) == ("\t", True, list(log.columns))
