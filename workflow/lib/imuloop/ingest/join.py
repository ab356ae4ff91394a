"""Several logs of one recording, each with its own clock, joined to one log."""

import numpy as np
import pandas as pd
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.gaps import gap_limit
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import HELD, STAMP
from imuloop.ingest.even_stamps import RATE_SHARE
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import SENSORS
from imuloop.ingest.stamps import NANOSECONDS, stamp_values

SENSOR_OF = {"acceleration": "accelerometer", "angular_rate": "gyroscope"}


def join(logs):
    """Return one RawLog that joins several logs of one recording.

    `logs` are RawLogs by name; each holds both sensors, one sensor or a temperature. The rows of
    the result are the samples of the faster sensor, or of the gyroscope if both are equally fast.
    Each row also holds the nearest sample of the slower sensor, not an interpolated value, so that
    mean and variance of this sensor do not change. If the nearest sample is farther away than half
    of the shortest gap (`gap_limit`), the row holds not-a-number instead. The column `HELD` has the
    time stamps of the samples of the slower sensor. The temperature comes from the log with the
    rows; if this has none, the temperature of another log is interpolated linearly.

    Raises
    ------
    RejectedLog
        If a log of a sensor has no rows, or the clocks do not fit together.
    ImuloopError
        If only one log has time stamps, or none has and the numbers of rows differ.
    """
    whose = {q: name for name, log in logs.items() for q in SENSORS if q in log.names}
    times = {q: logs[name].names.get("time") for q, name in whose.items()}
    counts = {name: logs[name].batch.num_rows for name in whose.values()}
    merged = RawLog(columns="; ".join(dict.fromkeys(logs[name].columns for name in counts)))
    if empty := [name for name, count in counts.items() if not count]:
        raise RejectedLog(f"{empty[0]} has no rows")
    stamped = None not in times.values()
    if not stamped and (any(times.values()) or len({*counts.values()}) > 1):
        raise ImuloopError(
            f"no time column of a usual name in each table ({merged.columns}), nor as many rows of "
            "one sensor as of the other: name it in columns.time"
        )
    stamps, values, units = {}, {}, {}
    for name, log in logs.items():
        stamps[name], values[name], units[name] = _rows(log)
        merged.lose(log)
        merged.bad_lines += log.batch.num_rows - len(stamps[name])
        merged.notes += [note for note in log.notes if note not in merged.notes]
        merged.simulated |= log.simulated
    if len({unit or "s" for unit in units.values()}) > 1:
        for name, unit in units.items():
            ns = stamps[name] * NANOSECONDS.get(unit, NANOSECONDS["s"])
            stamps[name], units[name] = np.round(ns).astype(np.int64), "ns"
    clock = _faster({whose[q]: stamps[whose[q]] for q in SENSORS if q in whose})
    tick = NANOSECONDS.get(units[clock], NANOSECONDS["s"])
    arrays = {STAMP: stamps[clock]} if stamped else {}
    warm = [name for name in (clock, *logs) if logs[name].temperature]
    whose |= {TEMPERATURE: warm[0]} if warm else {}
    for quantity, name in whose.items():
        columns = SENSORS.get(quantity, (TEMPERATURE,))
        block = np.array([values[name][column] for column in columns])
        if not np.array_equal(stamps[name], stamps[clock]):
            block, nearest, lost = _onto((clock, name), stamps, block, tick, quantity)
            if quantity == TEMPERATURE:
                note = f"temperature of {name} interpolated linearly onto the stamps of {clock}"
            else:
                arrays[HELD], merged.slower = nearest, SENSOR_OF[quantity]
                note = f"{quantity} of {name} has a clock of its own: each row of {clock} holds "
                note += f"its nearest sample{lost}"
            merged.notes.append(note)
        arrays |= dict(zip(columns, block, strict=True))
        merged.names[quantity] = logs[name].names[quantity]
        merged.units |= {q: u for q, u in logs[name].units.items() if q == quantity}
    if stamped:
        first, *others = times.values()
        merged.names["time"] = times if any(time != first for time in others) else first
        merged.units |= {"time": units[clock]} if units[clock] else {}
    merged.batch = pa.RecordBatch.from_pydict(arrays)
    return merged


def _rows(log):
    """Return the time stamps of a log, (n,), its values by name, (n,) each, and the stamps' unit.

    `log` is the RawLog. Without time stamps the numbers of its rows stand in their place. Rows with
    an unreadable stamp are left out. The unit is "ns" for dates; otherwise it is the unit that the
    log states, or None if it states none.
    """
    count = log.batch.num_rows
    stamps, readable, dates = np.arange(count), np.ones(count, dtype=bool), False
    if "time" in log.names:
        stamps, readable, dates = stamp_values(log.batch[STAMP])
    names = [name for name in log.batch.schema.names if name in (*CHANNELS, TEMPERATURE)]
    values = {name: log.batch[name].to_numpy(zero_copy_only=False)[readable] for name in names}
    return stamps[readable], values, "ns" if dates else log.units.get("time")


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _faster(stamps):
    """Return the name of the log with the shortest step between time stamps.

    It is the last log, if the steps are equal within `RATE_SHARE`. `stamps` has the time stamps of
    each log, (n,), by name; the log of the gyroscope is the last.
    """
    steps = {}
    for name, x in stamps.items():
        forward = np.diff(x)
        steps[name] = np.median(forward[forward > 0]) if (forward > 0).any() else np.inf
    *others, last = steps
    return next((name for name in others if steps[name] < (1 - RATE_SHARE) * steps[last]), last)


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _onto(names, stamps, values, tick, quantity):
    """Return the values of a log at the m time stamps of another log, named the clock here.

    `names` are the names of the clock and of the log, `stamps` the time stamps of both by name, in
    units of `tick` ns, and `values` are the columns of the log, (k, n): k columns of n rows. They
    are of `quantity`, its name. Rows of the log that miss a value, repeat a stamp or come late are
    left out. The result has the values of the sample nearest to each stamp of the clock. Exception:
    a temperature is interpolated linearly. In either case the value is not-a-number if the nearest
    sample is farther away than half of the shortest gap (`gap_limit`). A RejectedLog is raised if a
    clock starts again, or if the two clocks share no time.

    Returns
    -------
    values : ndarray, shape (k, m)
        Values at the time stamps of the clock.
    stamps : ndarray, shape (m,)
        Time stamp of the nearest sample.
    lost : str
        Words on the rows that were left out.
    """
    for name in names:
        clock, x = Clock(), stamps[name]
        _, usable = clock.mended(x, np.ones(len(x), dtype=bool), tick)
        if clock.resets or clock.rollovers:
            raise RejectedLog(
                f"the clock of {name} starts again within the log, from where "
                f"{' and '.join(names)} may be apart: make a log of each part"
            )
    at, t = (stamps[name] for name in names)
    rows = np.flatnonzero(usable & np.isfinite(values).all(axis=0))
    rows = rows[np.append(True, np.diff(np.maximum.accumulate(t[rows])) > 0)[: len(rows)]]
    t, values = t[rows], values[:, rows]
    limit = gap_limit(np.median(np.diff(t))) if len(t) > 1 else 0.0
    nearest = pd.Index(t).get_indexer(at, method="nearest", tolerance=limit / 2)
    near, warm = nearest >= 0, quantity == TEMPERATURE
    if len(t) < 2 or not (warm or len(np.unique(nearest[near])) > 1):
        raise RejectedLog(f"{names[1]} and {names[0]} share no time: their clocks differ")
    on_clock = values[:, nearest]
    if warm:
        on_clock = np.interp(at - t[0], t - t[0], values[0], left=np.nan, right=np.nan)[None]
    lost = len(usable) - len(rows)
    lost = f"; {lost} of its rows missing, repeated or out of order are left out" if lost else ""
    return np.where(near, on_clock, np.nan), t[nearest], lost
