"""Text tables, however they are written."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.ingest import delimited
from ingest.tables import same

SIX = "ax ay az gx gy gz".split()


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


def test_a_bomb_is_refused(run, tmp_path):
    path = tmp_path / "log.csv.zst"
    with pa.output_stream(path, compression="detect") as stream:
        for _ in range(8):
            stream.write(b"0.1,1,2,3,4,5,6\n" * (1 << 16))
    columns = {"time": 0, "acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}
    [reason] = run(path, columns=columns).quality["reasons"]
    assert reason == (
        f"unpacked, the file is more than 200 times its {path.stat().st_size} bytes: refused, "
        "no log packs so well"
    )


@pytest.mark.parametrize("batch_rows", [1 << 16, 64])
@pytest.mark.parametrize("separator", [" ", ","])
@pytest.mark.parametrize("size", [1 << 16, (1 << 21) + 3])
def test_a_line_that_is_too_long_is_no_row(log, run, tmp_path, separator, size, batch_rows):
    path = tmp_path / "log.txt"
    lines = log.to_csv(index=False, sep=separator).splitlines(keepends=True)
    # the longest line of all that counts has a row's columns
    lines[300] = lines[300].rstrip("\n").ljust(size - 1, "0") + "\n"
    lines.append("0" * size)
    path.write_text("".join(lines))
    read = delimited.read({"log": path}, batch_rows=batch_rows)
    samples = pa.Table.from_batches(read.batches).to_pandas().rename(columns={"stamp": "t"})
    whole = size <= 1 << 16
    assert read.bad_lines == (1 if whole else 2)
    lost = lines[-1] if whole else lines[300] + lines[-1]
    # blanks hold nothing
    assert read.lost_bytes == len(lost.replace(" ", ""))
    assert read.text_bytes == len("".join(lines[1:]).replace(" ", ""))
    kept = log if whole else log.drop(index=299).reset_index(drop=True)
    np.testing.assert_allclose(samples.gz, kept.gz, rtol=1e-4)
    assert same(samples, kept.drop(columns="gz"))
    # most of the file is lost
    [reason] = run(path, batch_rows=batch_rows).quality["reasons"]
    assert "of the log's bytes are in" in reason


@pytest.mark.parametrize("separator", [" ", ","])
def test_an_open_quote_costs_its_own_line(log, run, tmp_path, separator):
    path = tmp_path / "log.csv"
    log = log.astype(object)
    log.loc[7, "ax"] = '"0.1'
    log["note"] = '"as,ever"' if separator == "," else '"ever"'
    text = "\n".join(separator.join(map(str, row)) for row in [list(log.columns), *log.to_numpy()])
    path.write_text(text)
    done = run(path)
    assert done.quality["bad_lines"] == 1
    kept = log.drop(index=7, columns="note").reset_index(drop=True).astype(float)
    assert same(done.samples, kept)


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
    rng = np.random.default_rng(3)
    exact = rng.normal(size=20_000) * 10.0 ** rng.integers(-300, 300, size=20_000)
    rows = [f"{stamps(i)},{x!r},0.1,1,2,3,4\n" for i, x in enumerate(exact.tolist())]
    rows[7000 : 7000 + len(ODD)] = [row.replace(",1,2,", f",{odd},2,") for row, odd in
                                    zip(rows[7000:], ODD, strict=False)]  # fmt: skip
    path = tmp_path / "log.csv"
    path.write_text("t,ax,ay,az,gx,gy,gz\n" + "".join(rows))
    log = delimited.read({"log": path}, batch_rows=5000)
    log.threads = 2
    batches = list(log.batches)
    columns = {
        name: [v for batch in batches for v in batch[name].to_pylist()]
        for name in ("stamp", "ax", "az")
    }
    left_out = [i for i in range(20_000) if "," in stamps(i)]
    kept = [i for i in range(20_000) if i not in left_out]
    assert log.bad_lines == len(left_out)
    assert columns["stamp"] == [value(i) for i in kept]
    assert columns["ax"] == [exact[i] for i in kept]
    odd = [1.5, 1.5, 2, 0.5, 5, 1e-7, -np.inf] + [np.nan] * 6
    az = np.ones(20_000)
    az[7000 : 7000 + len(odd)] = odd
    np.testing.assert_array_equal(np.array(columns["az"], dtype=float), az[len(left_out) :])


def test_headerless_log_needs_numbers(log, run, tmp_path):
    path = tmp_path / "log.csv"
    log.to_csv(path, index=False, header=False)
    with pytest.raises(ImuloopError, match=r"imu/poses: .*log\.csv: .*by number from 0"):
        run(path)
    with pytest.raises(ImuloopError, match="no header, so 'ax' cannot be found"):
        run(path, columns={"acceleration": ["ax", "ay", "az"], "angular_rate": [4, 5, 6]})
    with pytest.raises(ImuloopError, match="there is no column 7; the log has 7"):
        run(path, columns={"acceleration": [1, 2, 3], "angular_rate": [5, 6, 7]})


@pytest.mark.parametrize("filling", [b"\0", b"\xff"])
def test_what_was_never_written_is_not_lost(log, run, tmp_path, filling):
    """The rest of a block of a disk or of a flash memory."""
    path = tmp_path / "log.csv"
    path.write_bytes(log.to_csv(index=False).encode() + filling * 200_000 + b"\n")
    quality = run(path).quality
    assert (quality["status"], quality["bad_lines"], quality["rows"]) == ("ok", 1, len(log))


ORDERS = {
    "swapped": "t,ay,ax,az,gx,gy,gz",
    "comment": "# t, gx, gy, gz, ax, ay, az",
    "other unit": "t,ax [g],ay [g],az [g],gx,gy,gz",
    "more": "t,temp,ax,ay,az,gx,gy,gz",
}


@pytest.mark.parametrize("kind", ORDERS)
def test_a_second_header_of_other_columns(log, run, tmp_path, kind):
    lines = log.to_csv(index=False).splitlines()
    lines.insert(490, ORDERS[kind])
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines))
    [reason] = run(path, batch_rows=64).quality["reasons"]
    named = ", ".join(each.strip(" #") for each in ORDERS[kind].split(","))
    assert reason == (
        f"a second header in the log names other columns ({named}) than the first "
        "(t, ax, ay, az, gx, gy, gz): make a log of each part"
    )


def test_text_that_is_no_header_costs_its_line(log, run, tmp_path):
    lines = log.to_csv(index=False).splitlines()
    lines[200:200] = ["start,of,a,new,part,of,it", "battery low", "mag_x,mag_y,mag_z", "#t 5"]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines))
    quality = run(path).quality
    assert (quality["status"], quality["rows"]) == ("ok", len(log))
    assert quality["bad_lines"] + quality["non_finite"] == 4


@pytest.mark.parametrize("brackets", ["{}", "[{}]"])
def test_a_row_of_units_below_the_header(log, run, tmp_path, brackets):
    units = [brackets.format(u) for u in ("ms", "g", "g", "g", "deg/s", "deg/s", "deg/s")]
    log["t"] = 10 * np.arange(500)
    log[list(ACCELERATION)] /= STANDARD_GRAVITY
    log[list(ANGULAR_RATE)] = np.degrees(log[list(ANGULAR_RATE)])
    lines = log.to_csv(index=False).splitlines()
    path = tmp_path / "log.csv"
    path.write_text("\n".join([lines[0], ",".join(units), *lines[1:]]))
    done = run(path)
    expected = {"time": "ms", "acceleration": "g", "angular_rate": "deg/s"}
    assert done.metadata["units"] == expected
    assert (len(done.samples), done.quality["non_finite"]) == (500, 0)
    path.write_text("\n".join([lines[0], ",".join([*units[:4], *["rph"] * 3]), *lines[1:]]))
    with pytest.raises(ImuloopError, match=r"units\.angular_rate: the log says 'rph'"):
        run(path)


def test_a_unit_with_brackets_in_it_below_the_header(log, run, tmp_path):
    lines = log.to_csv(index=False).splitlines()
    path = tmp_path / "log.csv"
    units = ["s", *["m/(s^2)"] * 3, *["rad/s"] * 3]
    path.write_text("\n".join([lines[0], ",".join(units), *lines[1:]]))
    assert same(run(path).samples, log)


def test_decimal_commas_beside_dates_with_a_point(log, run, tmp_path):
    path = tmp_path / "log.csv"
    stamps = [f"2024-03-05 23:59:{second:06.3f}" for second in 55 + log["t"]]
    stamps = [s.replace("-05 23:59:6", "-06 00:00:0") for s in stamps]
    log.assign(t=stamps).to_csv(path, index=False, sep=";", decimal=",")
    done = run(path)
    np.testing.assert_allclose(done.samples.t, log.t, atol=1e-9)
    assert same(done.samples.assign(t=log.t), log)


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
