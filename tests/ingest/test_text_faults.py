"""Text that is not a log, is damaged, or is declared wrongly: the loss, and one line about it."""

import gzip

import numpy as np
import pyarrow as pa
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.ingest import delimited
from ingest.logs import brief
from ingest.text_forms import NUMBERS, SIX, gyroflow, inserted, text, two_devices

TEXT = "t,ax,ay,az,gx,gy,gz\n" + "0.01,0.1,0.2,9.8,0,0,0\n" * 300
COMMENTS = "\n".join(f"%IMUA,{row}" for row in TEXT.splitlines()[1:])
FAR, BINARY = "time column 't': its stamps, as ", "the file is binary, or UTF-16: save it as UTF-8"
NO_TABLE = "the file is not a table of numbers in rows and columns"
SECOND = "a second header in the log has another column in place of ax"


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (TEXT.encode("utf-16"), BINARY),
        (TEXT.encode("utf-16-le"), BINARY),
        (bytes(9) + b"\n" + bytes(1 << 10), BINARY),
        (TEXT.encode("cp500"), NO_TABLE),
        (b"", "the file has no rows"),
        (b"\n \r\n\n" * 9, "the file has no rows"),
        (b"7" * (1 << 17), NO_TABLE),
        (b"%PDF-1.4 something\nthat is no table\n", NO_TABLE),
        (b"t,ax,ay,az,gx,gy,gz\n", NO_TABLE),
        (COMMENTS, "no rows, or lines alone that begin as comments do"),
        (lambda: text(brief().assign(t=["9" * 400] * 500)), FAR),
        (lambda: text(brief().assign(t=["9999-12-31T23:59:00"] * 500)), FAR),
        (lambda: text(brief().assign(ax="12:00:00 -> 1")), "500 of 500 rows (100.0%) cannot be us"),
        (lambda: gyroflow(brief(), 1 / 400, lambda _: "?"), "look like counts"),
        (lambda: inserted(brief(), 490, "t,ay,ax,az,gx,gy,gz"), SECOND),
        (lambda: inserted(brief(), 490, "# t, gx, gy, gz, ax, ay, az"), SECOND),
        (
            lambda: text(two_devices(brief())),
            "as column 'DeviceName' says (left, right): split the",
        ),
        (lambda: text(brief()) + "0" * (1 << 21), "of the log's bytes are in"),
    ],
)
def test_text_that_is_no_log_is_rejected_in_one_line(run, tmp_path, content, reason):
    content = content() if callable(content) else content
    path, declared = tmp_path / "log.csv", NUMBERS if isinstance(content, bytes) else {}
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    done = run(path, **declared)
    assert done.quality["status"] == "rejected" and len(done.samples) == 0
    assert {p.name for p in done.path.parent.iterdir()} == {"samples.parquet", "quality.json"}
    first = done.quality["reasons"][0]
    assert reason in first and first.isprintable() and len(first) < 400


HEADLESS, SIX_BY_NUMBER = {"header": False}, {"acceleration": [1, 2, 3], "angular_rate": [5, 6, 7]}
DELTA = [f"{name}{axis}" for name in ("dv", "dtheta_") for axis in "xyz"]
MIXED = {"acceleration": ["ax", "ay", "az"], "angular_rate": [4, 5, 6]}


# how the log is written, the declaration, and the line about it
@pytest.mark.parametrize(
    ("how", "declared", "line"),
    [
        ({}, {"units": {"acceleration": "count"}}, r"needs nominal\.acceleration"),
        ({}, {"units": {"acceleration": "mi/h^2"}}, r"'mi/h\^2' is not a unit of acceleration"),
        ({}, {"units": {"time": "sec"}}, r"units\.time: 'sec' is not a unit; did you mean"),
        ({}, {"units": {"time": "ISO 8601"}}, "column 't' holds numbers"),
        ({}, {"columns": {"time": "when"}}, "no column 'when'; there are t, ax"),
        ({}, {"format": "parqet"}, r"'parqet' is not a format; did you mean 'parquet'\?"),
        ({}, {"columns": {"acceleration": ["ax", "ay", "-az2"]}}, "no column 'az2'"),
        (HEADLESS, {}, r"by number from 0.*columns\.acceleration.*s\.angular_rate.*s\.time"),
        (HEADLESS, {"columns": MIXED}, "no header, so 'ax' cannot be found"),
        (HEADLESS, {"columns": SIX_BY_NUMBER}, "there is no column 7; the log has 7"),
        ({"header": ["host", *SIX]}, {}, "no time column of a usual name .*host"),
        ({"header": ["sec", *SIX[:5], "nsec"]}, {"columns": {"angular_rate": None}},
         "sec and nsec are not whole seconds and a part of a s"),
        (inserted(brief(), 1, "s,g,g,g,rph,rph,rph"), {}, r"angular_rate: the log says 'rph'"),
        ({"header": ["t", *DELTA]}, {"columns": {"interval": "step"}},
         r"columns.interval: no column 'step'; there are t, dvx"),
        ({"header": ["t", *DELTA]}, {"columns": {"interval": "dvx"}, "units": {"interval": "usec"}},
         r"units.interval: 'usec' is not a unit; .* 'us'\?"),
        ({"header": ["t [week]", *SIX]}, {}, r"csv: units\.time: the log says 'week'"),
        ({"header": ["t", *(f"{x} [furlong]" for x in SIX[:3]), *SIX[3:]]}, {}, "says 'furlong'"),
        (text(brief().assign(t=[f"31.12.2023 12h{i}" for i in range(500)])), {},
         "column 't' holds neither numbers nor .*; the first stamp is '31.12.2023 12h0'"),
    ],
)  # fmt: skip
def test_a_wrong_declaration_is_one_line(log, run, tmp_path, how, declared, line):
    path = tmp_path / "log.csv"
    path.write_text(how if isinstance(how, str) else text(log.assign(gz=-1.5), **how))
    with pytest.raises(ImuloopError, match=line) as caught:
        run(path, **declared)
    assert str(caught.value).startswith(f"imu/poses: {path}: ")
    assert "\n" not in str(caught.value)
    assert not [*tmp_path.glob("out/*")]


# --- damage

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
    content = text(log, sep=separator).encode()
    path.write_bytes(content[:200_000] + noise + content[200_000 + len(noise) :])
    done = run(path)
    assert done.quality["status"] == "ok" and 4985 <= done.quality["rows"] < 5000
    assert done.quality["bad_lines"] + done.quality["non_finite"] >= 1
    # every row kept is one of the log's
    kept = log.loc[np.round(done.samples.t * 100)]
    np.testing.assert_array_equal(done.samples[[*log]], kept)


@pytest.mark.parametrize("far", ["9999-12-31T23:59:00", "7" * 400])
def test_one_stamp_that_is_too_large_is_a_missing_one(log, run, tmp_path, far):
    near = [f"2024-01-01T00:00:{t:06.3f}" for t in log.t] if "T" in far else log.t.tolist()
    (tmp_path / "log.csv").write_text(text(log.assign(t=[*near[:9], far, *near[10:]])))
    found = run(tmp_path / "log.csv").quality
    assert (found["status"], found["non_finite"]) == ("ok", 1)


def test_a_packed_file_that_is_cut_off_spoilt_or_a_bomb_is_rejected(run, tmp_path):
    # whatever its name
    path = tmp_path / "log.csv"
    content = gzip.compress(text(brief(20_000)).encode())
    path.write_bytes(content)
    assert run(path).quality["status"] == "ok"
    half = len(content) // 2
    for spoilt in (content[:half], content[:half] + bytes(400) + content[half + 400 :]):
        path.write_bytes(spoilt)
        assert "the file cannot be read to its end" in run(path).quality["reasons"][0]
    with pa.output_stream(tmp_path / "log.csv.zst", compression="detect") as stream:
        for _ in range(8):
            stream.write(b"0.1,1,2,3,4,5,6\n" * (1 << 16))
    [reason] = run(tmp_path / "log.csv.zst", **NUMBERS).quality["reasons"]
    assert "unpacked, the file is more than 200 times its" in reason
