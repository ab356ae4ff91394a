"""Text tables, however loggers write them: the same samples."""

from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pytest

from imuloop.ingest import delimited
from ingest.figures import check_figures
from ingest.logs import FORCE, RATE
from ingest.text_forms import (
    NUMBERS,
    SIX,
    arrows,
    beside_emg,
    blanks,
    dated,
    decimal_commas,
    gyroflow,
    in_latin_1,
    inserted,
    named,
    quoted,
    row_of_units,
    spaced,
    text,
    two_columns,
    unreadable,
)

# share by which values that are converted twice may differ
ROUNDED = 1e-12
PREAMBLE = "\ufeffLogger 3, version 2\n\n"
MONTH, SLASHES = "%d-%b-%Y %H:%M:%S.%f", "%Y/%m/%d %H:%M:%S.%f"
AMERICAN = "%m/%d/%Y %I:%M:%S.%f %p"
BRACKETS = "s,m/(s^2),m/(s^2),m/(s^2),rad/s,rad/s,rad/s"
# lines of text, and whether they count as bad lines, or as rows without numbers
OTHERS = {"start,of,a,new,part,of,it": 0, "battery low": 1, "mag_x,mag_y,mag_z": 1, "#t 5": 1}
IN_MDPS = [*SIX[:3], *(f"gyr_{a}_mdps" for a in "xyz")]
AFTER_ARROWS = {"columns": {"acceleration": [0, 1, 2], "angular_rate": [3, 4, 5]}}
TURNED = {"columns": {"acceleration": ["ax", "-ay", "az"], "angular_rate": ["gx", "gy", "-gz"]}}
BY_NUMBER = {"columns": {"time": 0, "acceleration": [1, "-2", 3], "angular_rate": [4, 5, "-6"]}}


@dataclass(frozen=True)
class Way:
    """How a log is written, the declaration, the rows that are lost, figures of quality.json.

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
    "several blanks": (blanks, NUMBERS),
    "byte order mark, preamble, blank lines, other columns":
        (lambda log: PREAMBLE + text(log.assign(note="still")[["note", *log]]), {}, (),
         {"bad_lines": 0, "warnings": ["1 line(s) before the table skipped"]}),
    "values and lines that cannot be read":
        (unreadable, {}, range(4, 9), {"non_finite": 4, "missing_values.ax": 4, "bad_lines": 2}),
    **{f"an open quote, {s!r}": (lambda log, s=s: quoted(log, s), {}, [7], {"bad_lines": s == ","})
       for s in ", "},
    **{f"a block of {b!r} that was never written":
           (lambda log, b=b: text(log).encode() + b * 200_000 + b"\n", {}, (), {"bad_lines": 1})
       for b in (b"\0", b"\xff")},
    **{f"text amid the rows: {other}":
           (lambda log, other=other: inserted(log, 200, other), {}, (),
            {"bad_lines": bad, "non_finite": 1 - bad}) for other, bad in OTHERS.items()},
    "text below the names": (lambda log: inserted(log, 1, "start,of,the,second,log,at,noon"), {},
                             ()),
    "a row of units": (row_of_units, {}, (), {"units.angular_rate": "deg/s", "units.time": "ms"},
                       ROUNDED),
    "a row of units in brackets": (lambda log: row_of_units(log, "[{}]"), {}, (), {}, ROUNDED),
    "a row of units with brackets in them": (lambda log: inserted(log, 1, BRACKETS), {}),
    "decimal commas with dates that have a point": (decimal_commas, {}),
    **{f"dates as {form}": (lambda log, form=form: text(dated(log, form)), {}, (),
                            {"start": "2023-02-28T23:59:58.500000Z"})
       for form in (MONTH, SLASHES, AMERICAN)},
    **{f"a time as {stamp(0.25)}":
           (lambda log, stamp=stamp: text(log.assign(t=[*map(stamp, log.t)])), {})
       for stamp in (lambda t: f"59:{50 + t:06.3f}",
                     lambda t: f"9:08:{t:06.3f}".replace(".", ":"))},
    "no stamp in the column of time": (lambda log: text(log.assign(t="")), {"rate": 100}, (),
                                       {"columns": lambda found: "time" not in found}),
    **{f"a column {name} of one device":
           (lambda log, name=name, values=values: text(log.assign(**{name: values})), {})
       for name, values in (("SensorId", 7), ("address", range(500)))},
    "comments at the end": (lambda log: text(log) + "# 500 rows\n#\n", {}, (), {"bad_lines": 0}),
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
                        ("%time.secs", "%time.nsecs", 1), ("tv_sec", "tv_usec", 1000),
                       ("seconds", "nanoseconds", 1), ("seconds", "microseconds", 1000)]},
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
    **{f"Gyroflow, {how}": (partial(gyroflow, **how), {}, (), {}, ROUNDED)
       for how in ({}, {"tick": 0.0025}, {"tick": 1e-4}, {"tick": 1e-6}, {"head": "CAMERA"})},
    **{f"lines before a table: {line}":
           (lambda log, line=line: f"{line}\n{text(log)}", {})
       for line in ('{"device": "imu"}', "[INFO] started", "{", "a | b", "t|ax")},
    "names with a prefix next to the usual ones":
        (lambda log: text(log.join(log.add_prefix("imu1_") + 1).assign(SampleTimeFine=log.t * 2)),
         {}),
    "columns that end before another sensor's":
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
           # of a unit that the table of names says
           (["t", *IN_MDPS], RATE, "angular_rate", "count", 180_000 / np.pi),
           (["t", *FORCE, *(f"{a} [rpm]" for a in RATE)], RATE, "angular_rate", "rpm",
            30 / np.pi)]},
}  # fmt: skip


@pytest.mark.filterwarnings("error")
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
    samples = run(tmp_path / "log.csv").samples
    np.testing.assert_allclose(samples.temperature, 22.0 + log.t, rtol=1e-12)


def test_a_text_that_is_read_in_blocks_loses_no_row(log, run, same, tmp_path, monkeypatch):
    monkeypatch.setattr(delimited, "_BLOCK", 1000)
    path = tmp_path / "log.csv"
    for end in ("", "# the end\n% of the log", "x" * 1500):
        path.write_text(f"# a logger\n{log.to_csv(index=False)}{end}")
        same(run(path), log)
