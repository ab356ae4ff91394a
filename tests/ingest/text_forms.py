"""Forms in which loggers write a table as text: functions of a path, the log and options.

Each returns what the file holds.
"""

import numpy as np
import pandas as pd

from imuloop.core.samples import CHANNELS
from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from ingest.logs import FORCE, RATE

SIX = [*CHANNELS]


def lines(log, separator=",", header=True):
    return log.to_csv(index=False, sep=separator, header=header).splitlines()


def text(_, log, before="", after="", times=1, more=(), order=None, encoding="utf-8", **how):
    """The log with other columns, in an order, between texts; "rows" numbers the rows."""
    numbers = {
        key: range(len(log)) for key, x in dict(more).items() if isinstance(x, str) and x == "rows"
    }
    table = log.assign(**dict(more) | numbers)
    content = table[order or [*table]].to_csv(index=False, **how)
    return (before + content + after * times).encode(encoding)


def content(_, log, text="", times=1, encoding="latin-1"):
    """A text that is none of a log."""
    return (text * times).encode(encoding)


def inserted(_, log, at, line):
    """The log's lines with another before line `at`."""
    every = lines(log)
    return "\n".join([*every[:at], line, *every[at:]])


def clock(log):
    """The time of the day of a serial monitor before each line, from a quarter to midnight on."""
    seconds = 85_500 + log["t"]
    return [f"{s // 3600:02.0f}:{s % 3600 // 60:02.0f}:{s % 60:06.3f} -> " for s in seconds]


def arrows(_, log, separator, headed):
    first = clock(log)[0]
    rows = lines(log[SIX], separator, header=False)
    head = [f"{first}sensor found", *[first + separator.join(SIX)] * headed]
    return "\n".join([*head, *(a + row for a, row in zip(clock(log), rows, strict=True))])


def named(_, log, form, separator):
    """A name before each value."""
    names = ["t", "AccelX", "AccelY", "AccelZ", "GyroX", "GyroY", "GyroZ"]
    rows = [separator.join(map(form.format, names, row)) for row in log.itertuples(index=False)]
    before = clock(log)
    return "\n".join([f"{before[0]}ready: go", *(a + r for a, r in zip(before, rows, strict=True))])


def blanks(_, log):
    rows = ["   " + "    ".join(map(repr, row)) + "  \r\n" for row in log.to_numpy().tolist()]
    return "".join(rows)


def spaced(_, log):
    """Blanks before quoted names, units in the names, time in us."""
    names = ["time (us)", *SIX[:3], *(f"gyroADC[{i}] (deg/s)" for i in range(3))]
    rows = log.assign(t=(1e6 * log.t).round().astype(int), **log[RATE] / DEGREE)
    head = ", ".join(f'"{name}"' for name in names)
    return "\n".join([head, *(", ".join(map(str, row)) for row in rows.itertuples(index=False))])


def row_of_units(path, log, brackets="{}"):
    units = ",".join(brackets.format(u) for u in ("ms", *["g"] * 3, *["deg/s"] * 3))
    scaled = {**log[FORCE] / STANDARD_GRAVITY, **log[RATE] / DEGREE}
    return inserted(path, log.assign(t=(1000 * log.t).round(), **scaled), 1, units)


def two_columns(path, log, names, ns=1, receipt=True, **how):
    """Whole seconds, their part, and the time of receipt, late by up to 4 ms."""
    stamps = 1_650_000_123_987_654_000 + 10_000_000 * np.arange(len(log))
    table = log.drop(columns="t")
    table.insert(0, names[1], stamps % 10**9 // ns)
    table.insert(0, names[0], stamps // 10**9)
    if receipt:
        table.insert(0, "Time", stamps / 1e9 + np.arange(len(log)) % 5 / 1000)
    return text(path, table, **how)


def beside_seconds(path, log):
    whole = {"header.stamp.secs": np.floor(log.t).astype(int)}
    return text(path, log.rename(columns={"t": "Time"}), more=whole)


def dated(path, log, form, sep=",", decimal="."):
    moments = pd.Timestamp("2023-02-28T23:59:58.500") + pd.to_timedelta(log.t, unit="s")
    dates = log.assign(t=moments.dt.strftime(form)).rename(columns={"t": "timestamp"})
    return text(path, dates, sep=sep, decimal=decimal)


def minutes(path, log, points=False):
    """Times of the day: minutes and seconds, or hours, minutes, seconds and ms between colons."""
    times = [f"9:08:{t:06.3f}".replace(".", ":") if points else f"59:{50 + t:06.3f}" for t in log.t]
    return text(path, log.assign(t=times))


def gyroflow(_, log, force=1e-6, said=None, tick=1e-3, head="GYROFLOW"):
    """Scales before the table, in ticks, 1e-6 rad/s and g; rates first. ms need none."""
    columns = log.t / tick, log[RATE] / 1e-6, log[FORCE] / force
    rows = [",".join(f"{x:.0f}" for x in row) for row in np.column_stack(columns)]
    scales = ["gscale,1e-6", f"ascale,{said or force / STANDARD_GRAVITY}"]
    scales += [f"tscale,{tick}"] * (tick != 1e-3)
    head = [f"{head} IMU LOG", "version,1.3", "orientation,YxZ", *scales]
    return "\n".join([*head, "t,gx,gy,gz,ax,ay,az", *rows])


def quoted(_, log, separator):
    note = '"as,ever"' if separator == "," else '"ever"'
    table = log.astype(object).assign(note=note)
    table.loc[7, "ax"] = '"0.1'
    return "\n".join(separator.join(map(str, row)) for row in [[*table], *table.to_numpy()])


def unreadable(_, log):
    every, odd = lines(log), ("oops,0,0,0,0,0", ",0,0,0,0,0", "nan,0,0,0,0,0", "inf,0,0,0,0,0")
    every[5:10] = [f"0.0{i},{x}" for i, x in enumerate((*odd, "1,2"), 4)]
    return "\n".join(every) + "\n0.5,1"


def two_devices(path, log):
    return text(path, log.assign(DeviceName=["left", "right"] * (len(log) // 2)))


def prefixed(path, log):
    """The same names with a prefix, and another time, of another sensor."""
    return text(path, log.join(log.add_prefix("imu1_") + 1).assign(SampleTimeFine=log.t * 2))


def beside_emg(_, log):
    """A sensor of 300 Hz next to the IMU, whose columns end first."""
    emg = pd.DataFrame({"s": np.arange(1500) / 300, "emg": 0.5})
    names = ["X[s]", "EMG1", "X[s]", *(f"{s}1.{a}" for s in ("ACC", "GYRO") for a in "XYZ")]
    return pd.concat([emg, log], axis=1).to_csv(index=False, header=names)


def json_lines(_, log):
    return log.to_json(orient="records", lines=True)


def json_document(_, log, **how):
    return log.to_json(orient="records", **how)


def json_columns(_, log):
    return log.to_json(orient="columns")


def damaged_json(path, log):
    rows = json_lines(path, log).splitlines()
    rows[7], rows[9], rows[11] = rows[7][:30], "[" * 1200, '{"ax": 1}'
    return "\n".join(rows)


def prefixed_alone(path, log):
    six = log[SIX]
    return text(path, log[["t"]].join(six.add_prefix("imu0_")).join(six.add_prefix("imu1_")))


def far_stamp(path, log):
    """A stamp that no number of 64 bits holds."""
    return text(path, log.assign(t=[*log.t[:9], "7" * 400, *log.t[10:]]))
