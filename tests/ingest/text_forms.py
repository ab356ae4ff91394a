"""Forms in which loggers write a table as text."""

import numpy as np
import pandas as pd

from imuloop.core.samples import CHANNELS
from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from ingest.logs import FORCE, RATE

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
    """Whole seconds, their part, and the time of receipt, late by up to 4 ms."""
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


def gyroflow(log, force=1e-6, said=repr, tick=1e-3, head="GYROFLOW"):
    """Scales before the table, in ticks, 1e-6 rad/s and g; rates first. ms need none."""
    columns = log.t / tick, log[RATE] / 1e-6, log[FORCE] / force
    rows = [",".join(f"{x:.0f}" for x in row) for row in np.column_stack(columns)]
    scales = ["gscale,1e-6", f"ascale,{said(force / STANDARD_GRAVITY)}"]
    scales += [f"tscale,{tick}"] * (tick != 1e-3)
    head = [f"{head} IMU LOG", "version,1.3", "orientation,YxZ", *scales]
    return "\n".join([*head, "t,gx,gy,gz,ax,ay,az", *rows])


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


def two_devices(log):
    return log.assign(DeviceName=["left", "right"] * (len(log) // 2))


def beside_emg(log):
    """A sensor of 300 Hz next to the IMU, whose columns end first."""
    emg = pd.DataFrame({"s": np.arange(1500) / 300, "emg": 0.5})
    names = ["X[s]", "EMG1", "X[s]", *(f"{s}1.{a}" for s in ("ACC", "GYRO") for a in "XYZ")]
    return pd.concat([emg, log], axis=1).to_csv(index=False, header=names)
