"""Text that is damaged, or read at once: the loss is of the rows that are spoilt, and counted."""

import gzip

import numpy as np
import pyarrow as pa
import pytest

from imuloop.ingest import delimited
from ingest.logs import brief

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
    count = 12_000
    rows = [f"{stamps(i)},{i},0.1,1,2,3,4\n" for i in range(count)]
    for i, odd in enumerate(ODD, 7000):
        rows[i] = rows[i].replace(",1,2,", f",{odd},2,")
    (tmp_path / "log.csv").write_text("t,ax,ay,az,gx,gy,gz\n" + "".join(rows))
    log = delimited.read({"log": tmp_path / "log.csv"})
    kept = [i for i in range(count) if "," not in stamps(i)]
    assert log.bad_lines == count - len(kept)
    assert log.batch["stamp"].to_pylist() == [value(i) for i in kept]
    assert log.batch["ax"].to_pylist() == kept
    az = np.ones(count)
    az[7000 : 7000 + len(ODD)] = [1.5, 1.5, 2, 0.5, 5, 1e-7, -np.inf] + [np.nan] * 6
    np.testing.assert_array_equal(log.batch["az"].to_numpy().astype(float), az[kept])


@pytest.mark.parametrize("separator", [",", " "])
@pytest.mark.parametrize("noise", [bytes(300), np.random.default_rng(5).bytes(300), b'"'])
def test_noise_in_a_text_table_costs_only_its_rows(run, tmp_path, separator, noise):
    log, path = brief(5000), tmp_path / "log.csv"
    content = log.to_csv(index=False, sep=separator).encode()
    path.write_bytes(content[:200_000] + noise + content[200_000 + len(noise) :])
    done = run(path)
    assert done.quality["status"] == "ok" and 4985 <= done.quality["rows"] < 5000
    assert done.quality["bad_lines"] + done.quality["non_finite"] >= 1
    # every row kept is one of the log's
    kept = log.loc[np.round(done.samples.t * 100)]
    np.testing.assert_array_equal(done.samples[[*log]], kept)


def test_a_packed_file_that_is_cut_off_spoilt_or_a_bomb_is_rejected(run, tmp_path):
    # whatever its name
    path = tmp_path / "log.csv"
    content = gzip.compress(brief(20_000).to_csv(index=False).encode())
    path.write_bytes(content)
    assert run(path).quality["status"] == "ok"
    half = len(content) // 2
    for spoilt in (content[:half], content[:half] + bytes(400) + content[half + 400 :]):
        path.write_bytes(spoilt)
        assert "the file cannot be read to its end" in run(path).quality["reasons"][0]
    with pa.output_stream(tmp_path / "log.csv.zst", compression="detect") as stream:
        for _ in range(8):
            stream.write(b"0.1,1,2,3,4,5,6\n" * (1 << 16))
    [reason] = run(tmp_path / "log.csv.zst").quality["reasons"]
    assert "unpacked, the file is more than 200 times its" in reason


def test_a_text_that_is_read_in_blocks_loses_no_row(log, run, same, tmp_path, monkeypatch):
    monkeypatch.setattr(delimited, "_BLOCK", 1000)
    path = tmp_path / "log.csv"
    for end in ("", "# the end\n% of the log", "x" * 1500):
        path.write_text(f"# a logger\n{log.to_csv(index=False)}{end}")
        same(run(path), log)
