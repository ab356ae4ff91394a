"""Text tables, however loggers write them, and the two sensors of a log apart from each other."""

import gzip
import zipfile
from dataclasses import dataclass, field

import netCDF4
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from imuloop.ingest import delimited
from ingest.injections import check_figures
from ingest.logs import FORCE, RATE, brief

SIX = [*CHANNELS]
NUMBERS = {"columns": {"time": 0, "acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}}


def text(log, **how):
    return log.to_csv(index=False, **how)


def lines(log, separator=",", header=True):
    return text(log, sep=separator, header=header).splitlines()


def inserted(log, at, *more, separator=","):
    """The log's lines with others before line `at`."""
    every = lines(log, separator)
    return "\n".join([*every[:at], *more, *every[at:]])


def clock(log):
    """The time of the day of a serial monitor before each line, from a quarter to midnight on."""
    seconds = 85_500 + log["t"]
    return [f"{s // 3600:02.0f}:{s % 3600 // 60:02.0f}:{s % 60:06.3f} -> " for s in seconds]


def arrows(log, separator, headed):
    first = clock(log)[0]
    rows = lines(log[SIX], separator, header=False)
    head = [f"{first}sensor found", *[first + separator.join(SIX)] * headed]
    return "\n".join([*head, *(a + row for a, row in zip(clock(log), rows, strict=True))])


def named(log, form, separator):
    """A name before each value."""
    names = ["t", "AccelX", "AccelY", "AccelZ", "GyroX", "GyroY", "GyroZ"]
    rows = [separator.join(map(form.format, names, row)) for row in log.itertuples(index=False)]
    before = clock(log)
    return "\n".join([f"{before[0]}ready: go", *(a + r for a, r in zip(before, rows, strict=True))])


def blanks(log):
    rows = ["   " + "    ".join(map(repr, row)) + "  \r\n" for row in log.to_numpy().tolist()]
    return "".join(rows)


def spaced(log):
    """Blanks before quoted names, units in the names, time in us."""
    names = ["time (us)", *SIX[:3], *(f"gyroADC[{i}] (deg/s)" for i in range(3))]
    rows = log.assign(t=(1e6 * log.t).round().astype(int), **log[RATE] / DEGREE)
    head = ", ".join(f'"{name}"' for name in names)
    return "\n".join([head, *(", ".join(map(str, row)) for row in rows.itertuples(index=False))])


def row_of_units(log, brackets="{}"):
    units = ",".join(brackets.format(u) for u in ("ms", *["g"] * 3, *["deg/s"] * 3))
    other = log.assign(t=(1000 * log.t).round(), **log[FORCE] / STANDARD_GRAVITY,
                       **log[RATE] / DEGREE)  # fmt: skip
    return inserted(other, 1, units)


def in_latin_1(log):
    head = ",".join(["Zeit", *FORCE, *(f"{name} [°/s]" for name in RATE)]) + "\n"
    rows = log.assign(**log[RATE] / DEGREE).to_csv(index=False, header=False)
    return (head + rows).encode("latin-1")


def two_columns(log, seconds, part, ns=1, receipt=True):
    """Whole seconds and their part; beside them the time of receipt, late by up to 4 ms."""
    stamps = 1_650_000_123_987_654_000 + 10_000_000 * np.arange(len(log))
    table = log.drop(columns="t")
    table.insert(0, part, stamps % 10**9 // ns)
    table.insert(0, seconds, stamps // 10**9)
    if receipt:
        table.insert(0, "Time", stamps / 1e9 + np.arange(len(log)) % 5 / 1000)
    return table


def dated(log, form):
    moments = pd.Timestamp("2023-02-28T23:59:58.500") + pd.to_timedelta(log.t, unit="s")
    return log.assign(t=moments.dt.strftime(form)).rename(columns={"t": "timestamp"})


def decimal_commas(log):
    stamps = [f"2024-03-05 23:59:{second:06.3f}" for second in 55 + log["t"]]
    stamps = [s.replace("-05 23:59:6", "-06 00:00:0") for s in stamps]
    return text(log.assign(t=stamps), sep=";", decimal=",")


def lpms(log):
    """Force in g with its sign reversed, as LPMS writes it."""
    head = "SensorId, TimeStamp (s), FrameNumber, " + ", ".join(f"Acc{a} (g)" for a in "XYZ")
    head += ", " + ", ".join(f"Gyro{a} (deg/s)" for a in "XYZ")
    one, number = np.ones(len(log)), np.arange(len(log))
    force, rate = -log[FORCE].to_numpy() / STANDARD_GRAVITY, log[RATE].to_numpy() / DEGREE
    table = np.column_stack([one, log.t, number, force, rate]).tolist()
    return "\n".join([head, *(", ".join(map(repr, row)) for row in table)])


def novatel(log):
    """Messages of increments in counts, z first, y with its sign reversed."""
    order = log[["az", "ay", "ax"]] / 1e-6, log[["gz", "gy", "gx"]] / 1e-8
    table = np.round(np.column_stack(order) * [1, -1, 1, 1, -1, 1])
    return "\r\n".join(
        f"%RAWIMUSA,2304,{t + 7:.3f};2304,{t + 7:.6f},00000077,"
        + ",".join(f"{x:.0f}" for x in row) + "*1a2b3c4d"
        for t, row in zip(log.t, table, strict=True)
    )  # fmt: skip


def gyroflow(log, force=1e-6, said=repr):
    """Scales before the table, in ms, 1e-6 rad/s and g; rates first."""
    columns = 1000 * log.t, log[RATE] / 1e-6, log[FORCE] / force
    rows = [",".join(f"{x:.0f}" for x in row) for row in np.column_stack(columns)]
    head = ["GYROFLOW IMU LOG", "version,1.3", "tscale,0.001", "gscale,1e-6"]
    return "\n".join(
        [*head, f"ascale,{said(force / STANDARD_GRAVITY)}", "t,gx,gy,gz,ax,ay,az", *rows]
    )


def quoted(log, separator):
    note = '"as,ever"' if separator == "," else '"ever"'
    table = log.astype(object).assign(note=note)
    table.loc[7, "ax"] = '"0.1'
    return "\n".join(separator.join(map(str, row)) for row in [[*table], *table.to_numpy()])


def unreadable(log):
    every = lines(log)
    every[5:10] = [f"0.0{i},{x}" for i, x in
                   enumerate(("oops,0,0,0,0,0", ",0,0,0,0,0", "nan,0,0,0,0,0", "inf,0,0,0,0,0",
                              "1,2"), 4)]  # fmt: skip
    return "\n".join(every) + "\n0.5,1"


def beside_emg(log):
    """A sensor of 300 Hz beside the IMU, whose columns end before its."""
    emg = pd.DataFrame({"s": np.arange(1500) / 300, "emg": 0.5})
    names = ["X[s]", "EMG1", "X[s]", *(f"{s}1.{a}" for s in ("ACC", "GYRO") for a in "XYZ")]
    return pd.concat([emg, log], axis=1).to_csv(index=False, header=names)


# share by which values that are converted twice may differ
ROUNDED = 1e-12
TWO_ROWS = "Time;Acceleration;;;Rate gyro;;\n;x;y;z;x;y;z\ns;m/s^2;m/s^2;m/s^2;rad/s;rad/s;rad/s\n"
PREAMBLE = "\ufeffLogger 3, version 2\n\n"
MONTH, SLASHES = "%d-%b-%Y %H:%M:%S.%f", "%Y/%m/%d %H:%M:%S.%f"
BRACKETS = "s,m/(s^2),m/(s^2),m/(s^2),rad/s,rad/s,rad/s"
IN_COUNTS = {"nominal": {"acceleration": {"scale": 1e-6}, "angular_rate": {"scale": 1e-8}}}
# lines of text, and whether they count as lines that are no rows, or as rows without numbers
OTHERS = {"start,of,a,new,part,of,it": 0, "battery low": 1, "mag_x,mag_y,mag_z": 1, "#t 5": 1}
AFTER_ARROWS = {"columns": {"acceleration": [0, 1, 2], "angular_rate": [3, 4, 5]}}
TURNED = {"columns": {"acceleration": ["ax", "-ay", "az"], "angular_rate": ["gx", "gy", "-gz"]}}
BY_NUMBER = {"columns": {"time": 0, "acceleration": [1, "-2", 3], "angular_rate": [4, 5, "-6"]}}


@dataclass(frozen=True)
class Way:
    """How a log is written, what is declared, the rows that are lost, figures of quality.json.

    Values come back exactly, or where units are converted within a share.
    """

    write: object
    declared: dict = field(default_factory=dict)
    lost: tuple = ()
    figures: dict = field(default_factory=dict)
    within: float = 0.0


WAYS = {
    **{f"no header, {s!r}": (lambda log, s=s: text(log, sep=s, header=False), NUMBERS)
       for s in ",\t; "},
    "runs of blanks": (blanks, NUMBERS),
    "byte order mark, preamble, blank lines, other columns":
        (lambda log: PREAMBLE + text(log.assign(note="still")[["note", *log]]), {}, (),
         {"bad_lines": 0, "warnings": ["1 line(s) before the table skipped"]}),
    "values and lines that cannot be read":
        (unreadable, {}, range(4, 9), {"non_finite": 4, "missing_values.ax": 4, "bad_lines": 2}),
    **{f"an open quote, {s!r}": (lambda log, s=s: quoted(log, s), {}, [7], {"bad_lines": 1})
       for s in ", "},
    **{f"a block of {b!r} that was never written":
           (lambda log, b=b: text(log).encode() + b * 200_000 + b"\n", {}, (), {"bad_lines": 1})
       for b in (b"\0", b"\xff")},
    **{f"text amid the rows: {other}":
           (lambda log, other=other: inserted(log, 200, other), {}, (),
            {"bad_lines": bad, "non_finite": 1 - bad}) for other, bad in OTHERS.items()},
    "text below the names": (lambda log: inserted(log, 1, "start,of,the,second,log,at,noon"), {},
                             (), {"non_finite": 1}),
    "a row of units": (row_of_units, {}, (), {"units.angular_rate": "deg/s", "units.time": "ms"},
                       ROUNDED),
    "a row of units in brackets": (lambda log: row_of_units(log, "[{}]"), {}, (), {}, ROUNDED),
    "a row of units with brackets in them": (lambda log: inserted(log, 1, BRACKETS), {}),
    "names in two rows": (lambda log: TWO_ROWS + text(log, sep=";", header=False), {}, (),
                          {"columns.angular_rate": [f"Rate gyro {a}" for a in "xyz"]}),
    "decimal commas beside dates with a point": (decimal_commas, {}),
    **{f"dates as {form}": (lambda log, form=form: text(dated(log, form)), {}, (),
                            {"start": "2023-02-28T23:59:58.500000Z"}) for form in (MONTH, SLASHES)},
    "a header in Latin-1": (in_latin_1, {"columns": {"time": 0}}, (),
                            {"units.angular_rate": "deg/s"}, ROUNDED),
    "empty fields between tabs":
        (lambda log: text(log.assign(mag="", note="")[["t", "mag", *FORCE, "note", *RATE]],
                          sep="\t"), {}),
    "blanks before quoted names": (spaced, {}, (), {"units.time": "us"}, ROUNDED),
    **{f"an arrow before each line, {s!r}, headed {h}":
           (lambda log, s=s, h=h: arrows(log, s, h), {} if h else AFTER_ARROWS, (),
            {"bad_lines": 0}) for s in ",\t " for h in (True, False)},
    **{f"a name before each value, {s!r} {f!r}":
           (lambda log, s=s, f=f: named(log, f, s), {"columns": {"time": "t"}}, (),
            {"columns.angular_rate": ["GyroX", "GyroY", "GyroZ"]})
       for s in (",", "\t", ", ") for f in ("{}:{}", "{} = {}")},
    **{f"{a} and {b}": (lambda log, a=a, b=b, ns=ns: text(two_columns(log, a, b, ns)), {}, (),
                        {"columns.time": [a, b], "start": "2022-04-15T05:22:03.987654Z"})
       for a, b, ns in [("header.stamp.sec", "header.stamp.nanosec", 1), ("sec", "nanosec", 1),
                        ("%time.secs", "%time.nsecs", 1), ("tv_sec", "tv_usec", 1000)]},
    "two columns of time, declared":
        (lambda log: text(two_columns(log, "a", "b", receipt=False)),
         {"columns": {"time": ["a", "b"]}}),
    "two columns of time, by number":
        (lambda log: text(two_columns(log, "a", "b", receipt=False), header=False),
         {"columns": {"time": [0, 1], "acceleration": [2, 3, 4], "angular_rate": [5, 6, 7]}}),
    "a time beside whole seconds":
        (lambda log: text(log.rename(columns={"t": "Time"}).assign(
            **{"header.stamp.secs": np.floor(log.t).astype(int)})), {}),
    "signs turned by name": (lambda log: text(log.assign(ay=-log.ay, gz=-log.gz)), TURNED),
    "signs turned by number":
        (lambda log: text(log.assign(ay=-log.ay, gz=-log.gz), header=False), BY_NUMBER),
    # protects from a calibration with every force reversed, which nothing else shows
    "LPMS, whose sign is turned":
        (lpms, {}, (), {"warnings": lambda said: "of its acceleration is turned" in str(said)},
         ROUNDED),
    "NovAtel": (novatel, IN_COUNTS, (), {}, ROUNDED),
    "Gyroflow": (gyroflow, {}, (), {}, ROUNDED),
    "columns that end before those of another sensor":
        (beside_emg, {"columns": {"time": 2}}, (), {"non_finite": 0}),
    **{f"the unit {unit}":
           (lambda log, names=names, on=on, by=by: ",".join(names) + "\n"
            + log.assign(**by * log[on]).to_csv(index=False, header=False), {}, (),
            {f"units.{quantity}": unit}, ROUNDED)
       for names, on, quantity, unit, by in [
           (["t [min]", *SIX], ["t"], "time", "min", 1 / 60),
           (["Timestamp[millisec]", *SIX], ["t"], "time", "ms", 1000),
           (["t", *(f"{a} [ft/s²]" for a in FORCE), *RATE], FORCE, "acceleration", "ft/s^2",
            1 / 0.3048),
           (["t", *FORCE, *(f"{a} [rpm]" for a in RATE)], RATE, "angular_rate", "rpm",
            30 / np.pi)]},
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_the_same_samples_come_from_text_however_it_is_written(log, run, tmp_path, way):
    way = Way(*WAYS[way])
    content = way.write(log)
    path = tmp_path / "log.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    done = run(path, **way.declared)
    kept = log.drop(index=[*way.lost])
    assert done.quality["status"] == "ok", done.quality["reasons"]
    assert len(done.samples) == len(kept)
    np.testing.assert_allclose(done.samples[SIX], kept[SIX], rtol=way.within, atol=way.within)
    np.testing.assert_allclose(done.samples.t, kept.t, rtol=0, atol=1e-9)
    check_figures(done.quality, way.figures)


def test_what_is_declared_goes_before_the_scales_of_a_log(log, run, tmp_path):
    path = tmp_path / "log.gcsv"
    path.write_text(gyroflow(log))
    done = run(path, nominal={"angular_rate": {"scale": 2e-6}})
    np.testing.assert_allclose(done.samples.gx, 2 * log.gx, rtol=1e-9, atol=1e-12)


def test_a_temperature_in_fahrenheit_is_read(log, run, tmp_path):
    log["temp [°F]"] = (22.0 + log.t) * 9 / 5 + 32
    (tmp_path / "log.csv").write_text(text(log), encoding="utf-8")
    done = run(tmp_path / "log.csv")
    np.testing.assert_allclose(done.samples.temperature, 22.0 + log.t, rtol=1e-12)


# --- what cannot be read: the session is rejected, or the declaration is wrong

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
    done = run(path, batch_rows=64, **declared)
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
        (novatel, {}, {}, r"needs nominal\.acceleration\.scale \(increments: ×"),
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


# --- numbers, long lines, bombs, damage

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
    log = delimited.read({"log": tmp_path / "log.csv"}, batch_rows=5000)
    log.threads = 2
    table = pa.Table.from_batches(log.batches)
    kept = [i for i in range(count) if "," not in stamps(i)]
    assert log.bad_lines == count - len(kept)
    assert table["stamp"].to_pylist() == [value(i) for i in kept]
    assert table["ax"].to_pylist() == [exact[i] for i in kept]
    az = np.ones(count)
    az[7000 : 7000 + len(ODD)] = [1.5, 1.5, 2, 0.5, 5, 1e-7, -np.inf] + [np.nan] * 6
    np.testing.assert_array_equal(table["az"].to_numpy().astype(float), az[kept])


@pytest.mark.parametrize(("separator", "rows"), [(" ", 1 << 16), (",", 64)])
@pytest.mark.parametrize("size", [1 << 16, (1 << 21) + 3])
def test_a_line_that_is_too_long_is_no_row(log, run, tmp_path, separator, size, rows):
    path = tmp_path / "log.txt"
    every = text(log, sep=separator).splitlines(keepends=True)
    # the longest line of all that counts has a row's columns
    every[300] = every[300].rstrip("\n").ljust(size - 1, "0") + "\n"
    every.append("0" * size)
    path.write_text("".join(every))
    read = delimited.read({"log": path}, batch_rows=rows)
    samples, whole = pa.Table.from_batches(read.batches).to_pandas(), size <= 1 << 16
    assert read.bad_lines == (1 if whole else 2)
    lost = every[-1] if whole else every[300] + every[-1]
    # blanks hold nothing
    assert read.lost_bytes == len(lost.replace(" ", ""))
    assert read.text_bytes == len("".join(every[1:]).replace(" ", ""))
    kept = log if whole else log.drop(index=299)
    np.testing.assert_allclose(samples[SIX], kept[SIX], rtol=1e-4)
    # most of the file is lost
    [reason] = run(path, batch_rows=rows).quality["reasons"]
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


def test_nothing_depends_on_the_size_of_a_batch(run, tmp_path):
    log = brief(5000)
    log["t"] = 1_000_000 + 10_000 * np.arange(5000)
    # whole and decimal numbers in one column, and faults, all over the file
    log["ax"] = log["ax"].where(log.index % 50 != 0, 1)
    log.loc[777::1000, "gy"] = np.nan
    log.loc[500, "t"] = log.loc[499, "t"]
    (tmp_path / "log.csv").write_text(text(log))
    found = []
    for rows in (1 << 16, 70, 700):
        done = run(tmp_path / "log.csv", units={"time": "us"}, batch_rows=rows)
        found.append((done.path.read_bytes(), done.quality))
    assert found[0] == found[1] == found[2]
    assert found[0][1]["non_finite"] == 5


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


# --- two sensors in one table, in files of their own, or in rows of each


def in_turn(count=3000, rate=250.0, share=3, empty=np.nan, both=False):
    """A table of which each row holds one sensor alone, or of which each so many hold the force."""
    log, force = brief(count), np.arange(count) % share == share - 1
    log["t"] = np.arange(count) / rate
    log.loc[~force, [*ACCELERATION]] = empty
    if not both:
        log.loc[force, [*ANGULAR_RATE]] = empty
    return log


@pytest.mark.parametrize("empty", [0.0, np.nan])
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_rows_of_two_sensors_in_turn_are_two_streams(run, tmp_path, empty, ending):
    table, path = in_turn(empty=empty), tmp_path / f"log.{ending}"
    table.to_parquet(path) if ending == "parquet" else path.write_text(text(table))
    done = run(path)
    assert done.quality["status"] == "ok"
    assert "the rows hold the accelerometer and the gyroscope in turn" in done.quality["warnings"]
    # those of the sensor whose clock is the log's are as they were logged
    assert max(np.isin(done.samples[c], table[c]).mean() for c in ("ax", "gx")) == 1


def test_an_outer_join_of_two_rates_keeps_all_samples_zeros_too(run):
    table = in_turn(2000, 200.0, 4, both=True)
    done = run(table)
    assert done.quality["status"] == "ok"
    assert all(np.isin(done.samples[c], table[c]).all() for c in SIX)
    table = in_turn(1000, 200.0, 2)
    zeros = np.arange(1000)[:, None] // 4 % 2 * [1.0, 2.0, 1.0]
    table[RATE] = np.where(table[RATE].isna(), np.nan, zeros)
    done = run(table, units={"angular_rate": "deg/s"})
    assert done.quality["gaps"]["count"] == 0 and len(done.samples) >= 499


def test_a_gyroscope_of_whole_degrees_at_rest_takes_no_turns(log, run):
    log[RATE] = 0.0
    log.loc[::2, "gz"] = 1.0
    quality = run(log, units={"angular_rate": "deg/s"}).quality
    assert not any("in turn" in line for line in quality["warnings"])


def two_clocks(log):
    """Return tables of an accelerometer at 100 Hz and of a gyroscope that is 1.5 ms later."""
    force = log[["t", *ACCELERATION]].set_axis([*"txyz"], axis=1)
    rate = log[["t", *ANGULAR_RATE]].set_axis([*"txyz"], axis=1)
    return force, rate.assign(t=log.t + 0.0015)


@pytest.fixture
def is_two(log):
    def check(done):
        assert done.quality["status"] == "ok", done.quality["reasons"]
        assert 480 <= len(done.samples) <= len(log) and 4.9 < done.quality["duration_s"] < 5
        # those of the sensor whose clock is the log's are as they were logged
        assert max(np.isin(done.samples[c], log[c]).mean() for c in ("ax", "gx")) == 1

    return check


def written(paths, tables, form):
    for path, table, unit in zip(paths, tables, ("m/s²", "rad/s"), strict=True):
        ms, uvw = (1000 * table.t).round(3), dict(u=1.0, v=2.0, w=3.0)
        if form == "parquet":
            table.to_parquet(path)
            continue
        if form == "axes":
            names = ["elapsed (ms)", *(f"{a}-axis ({unit})" for a in "xyz")]
            table = table.assign(t=ms).set_axis(names, axis=1).assign(pressure=1013.0)
        elif form == "declared":
            table = table.assign(**uvw)
            if unit == "rad/s":
                table = table.assign(t=ms).rename(columns={"t": "t (ms)"})
        elif form == "week":
            table = table.rename(columns={"t": "t (week)"})
        path.write_text(text(table, header=form != "headless", sep=" ,"[form != "headless"]))


@pytest.mark.parametrize(
    ("form", "time", "unit"),
    [("csv", "t", "s"), ("parquet", "t", "s"), ("headless", "0", "s"),
     ("axes", "elapsed (ms)", "ms"), ("declared", None, None), ("week", "t (week)", "s")],
)  # fmt: skip
def test_two_files_of_any_table_are_one_log(log, run, tmp_path, is_two, form, time, unit):
    paths = [tmp_path / f"{name}.{'parquet' if form == 'parquet' else 'txt'}" for name in "ab"]
    written(paths, two_clocks(log), form)
    declared = {}
    if form == "declared":
        declared = {"columns": {"acceleration": [*"xyz"], "angular_rate": [*"xyz"]}}
    elif form == "week":
        with pytest.raises(ImuloopError, match=r"units\.time: the log says 'week'"):
            run(*paths)
        declared = {"units": {"time": "s"}}
    done = run(*paths, **declared)
    is_two(done)
    if unit:
        assert done.metadata["units"]["time"] == unit
        assert done.quality["columns"]["time"] == time


@pytest.mark.parametrize("zipped", ["one", "two"])
def test_tables_in_a_zip_are_read(log, run, tmp_path, is_two, zipped):
    tables = {"rec/imu.csv": log}
    if zipped == "two":
        tables = dict(zip(("rec/Accel.txt", "rec/gyro.txt"), two_clocks(log), strict=True))
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        for name, table in tables.items():
            content = text(table, header=zipped == "one", sep=" ,"[zipped == "one"])
            archive.writestr(name, "# made by a logger\n" + content)
        archive.writestr("rec/notes.md", "at noon")
    done = run(tmp_path / "log.zip")
    is_two(done)
    assert "of the zip" in done.quality["warnings"][0]


@pytest.mark.parametrize("head", ["column", "comments"])
def test_rows_that_begin_with_the_name_of_the_sensor_are_read(log, run, tmp_path, is_two, head):
    every, names = ["sensor,time,x,y,z"], ("accelerometer", "gyroscope")
    tables = two_clocks(log)
    if head == "comments":
        names = ("UncalAccel", "UncalGyro")
        every = ["# Fix,provider,time"]
        every += ["# UncalAccel,elapsedRealtimeNanos,AccelXMps2,AccelYMps2,AccelZMps2,BiasXMps2"]
        every += ["# UncalGyro,elapsedRealtimeNanos,GyroXRadPerSec,GyroYRadPerSec,GyroZRadPerSec"]
        force, rate = (x.assign(t=(1e9 * x.t).round().astype(int)) for x in tables)
        tables = force.assign(bias=0.0), rate
    for pair in zip(*(lines(table, header=False) for table in tables), strict=True):
        every += [f"{name},{row}" for name, row in zip(names, pair, strict=True)]
        every += ["Fix,gps,1"] * (head == "comments")
    (tmp_path / "log.txt").write_text("\n".join(every))
    done = run(tmp_path / "log.txt")
    is_two(done)
    assert done.metadata["units"]["time"] == ("ns" if head == "comments" else "s")


@pytest.mark.parametrize("time", ["t", "host"])
def test_a_table_of_each_sensor_below_the_other_is_read(run, tmp_path, time):
    """Protects the second table: of it nothing is in the first rows."""
    force, rate = two_clocks(brief(3000))
    every = []
    for name, table, step in (("Gyro", rate, 0.0025), ("Accel", force[::2], 0.005)):
        rows = lines(table.assign(t=np.arange(len(table)) * step), header=False)
        every += ["", f"type,{time},3DOF_x,3DOF_y,3DOF_z", *(f"{name},{row}" for row in rows)]
    (tmp_path / "log.csv").write_text("\n".join(every))
    if time == "host":
        with pytest.raises(ImuloopError, match=r"no time column of a usual name .*host.* not as"):
            run(tmp_path / "log.csv")
    done = run(tmp_path / "log.csv", columns={"time": time})
    np.testing.assert_array_equal(done.samples[RATE].iloc[9:99], rate.iloc[9:99, 1:])
    assert np.isin(done.samples.ax, force.x).all()
