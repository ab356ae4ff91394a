"""Text that is no log, and declarations of it that are wrong: one line each."""

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError
from ingest.logs import brief
from ingest.text_forms import (
    NUMBERS,
    SIX,
    gyroflow,
    inserted,
    lines,
    text,
)

TEXT = "t,ax,ay,az,gx,gy,gz\n" + "0.01,0.1,0.2,9.8,0,0,0\n" * 300
COMMENTS = "\n".join(f"%IMUA,{row}" for row in TEXT.splitlines()[1:])
FAR = "time column 't': its stamps, as "


def second_header(head):
    names = ", ".join(each.strip(" #") for each in head.split(","))
    line = (
        f"a second header in the log names other columns ({names}) than the first (t, ax, ay, az,"
    )
    return lambda: inserted(brief(), 490, head), line


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (TEXT.encode("utf-16"), "the text is UTF-16 or UTF-32: save it as UTF-8"),
        (TEXT.encode("utf-16-le"), "the file is binary, or text in UTF-16: save it as UTF-8"),
        (TEXT.encode("cp500"), "the file is not a table of numbers in rows and columns"),
        (b"", "the file has no rows"),
        (b"\n \r\n\n" * 9, "the file has no rows"),
        (bytes(9) + b"\n" + bytes(1 << 10), "the file is binary, or text in UTF-16"),
        (b"7" * (1 << 17), "the first line is longer than 64 kB: no table"),
        (b"%PDF-1.4 something\nthat is no table\n", "the file is not a table"),
        (b"t,ax,ay,az,gx,gy,gz\n", "the file is not a table"),
        (COMMENTS, "the file has no rows but lines that begin as comments do: '%IMUA,0.01"),
        (lambda: text(brief().assign(t=["9" * 400] * 500)), FAR),
        (lambda: text(brief().assign(t=["9999-12-31T23:59:00"] * 500)), FAR),
        (
            lambda: text(brief().assign(ax="12:00:00 -> 1")),
            "500 of 500 rows (100.0%) cannot be used",
        ),
        (lambda: gyroflow(brief(), 1 / 400, lambda _: "?"), "look like counts"),
        second_header("t,ay,ax,az,gx,gy,gz"),
        second_header("# t, gx, gy, gz, ax, ay, az"),
        second_header("t,ax [g],ay [g],az [g],gx,gy,gz"),
        second_header("t,temp,ax,ay,az,gx,gy,gz"),
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


def test_one_stamp_that_is_too_large_is_a_missing_one(log, run, tmp_path):
    for far, near in (
        ("9999-12-31T23:59:00", [f"2024-01-01T00:00:{t:06.3f}" for t in log.t]),
        ("7" * 400, log.t.tolist()),
    ):
        log["t"] = [*near[:9], far, *near[10:]]
        (tmp_path / "log.csv").write_text(text(log))
        found = run(tmp_path / "log.csv").quality
        assert (found["status"], found["non_finite"]) == ("ok", 1)


HEADLESS, SIX_BY_NUMBER = {"header": False}, {"acceleration": [1, 2, 3], "angular_rate": [5, 6, 7]}
MIXED = {"acceleration": ["ax", "ay", "az"], "angular_rate": [4, 5, 6]}
JOINED = {"nsec": 10**9 + np.arange(500)}


# what the log is changed to; how it is written; what is declared; what is said of that
@pytest.mark.parametrize(
    ("change", "how", "declared", "line"),
    [
        (None, {}, {"units": {"acceleration": "count"}}, r"needs nominal\.acceleration"),
        (None, {}, {"units": {"acceleration": "mi/h^2"}}, r"'mi/h\^2' is not a unit of accelera"),
        (None, {}, {"units": {"time": "sec"}}, r"units\.time: 'sec' is not a unit; did you mean"),
        (None, {}, {"units": {"time": "ISO 8601"}}, "column 't' holds numbers"),
        (None, {}, {"columns": {"time": "when"}}, "no column 'when'; there are t, ax"),
        (None, {}, {"format": "parqet"}, r"'parqet' is not a format; did you mean 'parquet'\?"),
        (None, {}, {"columns": {"acceleration": ["ax", "ay", "-az2"]}}, "no column 'az2'"),
        (None, HEADLESS, {}, "by number from 0"),
        (None, HEADLESS, {"columns": MIXED}, "no header, so 'ax' cannot be found"),
        (None, HEADLESS, {"columns": SIX_BY_NUMBER}, "there is no column 7; the log has 7"),
        (None, {"header": ["host", *SIX]}, {}, "no time column of a usual name .*host"),
        (lambda log: log.assign(t=[f"31.12.2023 12h{i}" for i in range(500)]), {}, {},
         r"column 't': '31\.12\.2023 12h0' is neither a number"),
        (lambda log: log.assign(**JOINED).rename(columns={"t": "sec"}), {}, {},
         "sec and nsec are not whole seconds and a part of a s"),
        (lambda log: inserted(log, 1, "s,g,g,g,rph,rph,rph"), {}, {},
         r"units\.angular_rate: the log says 'rph'"),
    ],
)  # fmt: skip
def test_a_wrong_declaration_is_one_line(log, run, tmp_path, change, how, declared, line):
    changed, path = change(log) if change else log, tmp_path / "log.csv"
    path.write_text(changed if isinstance(changed, str) else text(changed, **how))
    with pytest.raises(ImuloopError, match=line) as caught:
        run(path, **declared)
    assert str(caught.value).startswith(f"imu/poses: {path}: ")
    assert "\n" not in str(caught.value)
    assert not [*tmp_path.glob("out/*")]


@pytest.mark.parametrize(
    ("header", "units", "logged"),
    [
        ("t,ax [furlong],ay [furlong],az [furlong],gx,gy,gz", {"acceleration": "m/s^2"}, "furlong"),
        ("t,ax,ay,az,gx [rph],gy [rph],gz [rph]", {"angular_rate": "rad/s"}, "rph"),
        ("t [week],ax,ay,az,gx,gy,gz", {"time": "s"}, "week"),
        ("t [UTC],ax,ay,az,gx,gy,gz", {"time": "s"}, "UTC"),
    ],
)
def test_a_unit_that_is_not_known_is_an_error_unless_declared(
    log, run, tmp_path, header, units, logged
):
    [(quantity, unit)] = units.items()
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, *lines(log)[1:]]))
    with pytest.raises(ImuloopError, match=rf"csv: units\.{quantity}: the log says '{logged}'"):
        run(path)
    warnings = run(path, units=units).quality["warnings"]
    assert f"units.{quantity} is {unit}, the log says {logged}; {unit} used" in warnings
