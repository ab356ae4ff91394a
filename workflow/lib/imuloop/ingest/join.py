"""Logs of which each has a clock of its own: joined onto one clock."""

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.gaps import gap_limit
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import HELD, STAMP
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import SENSORS
from imuloop.ingest.stamps import NANOSECONDS, stamp_values

SENSOR_OF = {"acceleration": "accelerometer", "angular_rate": "gyroscope"}
# two clocks count as equally fast if their steps differ by less than this share: crystals of
# sensors with the same nominal rate differ by a few percent
_AS_FAST = 0.05


def join(logs):
    """Return the RawLog of logs by name: of both sensors, of one each, or of a thermometer.

    The rows are those of the faster sensor, or of the gyroscope if both are equally fast. Each
    holds the sample of the slower sensor that is nearest in time and within half a gap
    (`gap_limit`), or not-a-number, so that mean and variance of the slower sensor stay its own. The
    column `HELD` has the stamps of the held samples. The temperature is that of the log whose rows
    these are; without one, another's is interpolated linearly.
    """
    whose = {q: name for name, log in logs.items() for q in SENSORS if q in log.found}
    times = {q: logs[name].found.get("time") for q, name in whose.items()}
    counts = {name: logs[name].batch.num_rows for name in whose.values()}
    merged = RawLog(columns="; ".join(dict.fromkeys(logs[name].columns for name in counts)))
    for name, count in counts.items():
        if not count:
            raise RejectedLog(f"{name} has no rows")
    untimed = [*times.values()].count(None)
    if untimed and (untimed < len(times) or len({*counts.values()}) > 1):
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
    clock = _faster({q: stamps[name] for q, name in whose.items()})
    clock, tick = whose[clock], NANOSECONDS.get(units[whose[clock]], NANOSECONDS["s"])
    arrays = {} if untimed else {STAMP: stamps[clock]}
    for quantity, name in whose.items():
        block = np.array([values[name][axis] for axis in SENSORS[quantity]])
        if not np.array_equal(stamps[name], stamps[clock]):
            block, arrays[HELD], lost = _onto(clock, name, stamps, block, tick)
            merged.slower = SENSOR_OF[quantity]
            merged.notes.append(
                f"{quantity} of {name} has a clock of its own: each row of {clock} holds its "
                f"nearest sample{lost}"
            )
        arrays |= dict(zip(SENSORS[quantity], block, strict=True))
    warm = [name for name in sorted(logs, key=clock.__ne__) if logs[name].temperature][:1]
    for name in warm:
        arrays[TEMPERATURE] = values[name][TEMPERATURE]
        if not np.array_equal(stamps[name], stamps[clock]):
            block = arrays[TEMPERATURE][None]
            [arrays[TEMPERATURE]], *_ = _onto(clock, name, stamps, block, tick, linear=True)
            where = f"the stamps of {clock}"
            merged.notes.append(f"temperature of {name} interpolated linearly onto {where}")
    for quantity, name in [*whose.items(), *((TEMPERATURE, name) for name in warm)]:
        merged.found[quantity] = logs[name].found[quantity]
        merged.units |= {q: u for q, u in logs[name].units.items() if q == quantity}
    if not untimed:
        first, *others = times.values()
        merged.found["time"] = times if any(time != first for time in others) else first
        merged.units |= {"time": units[clock]} if units[clock] else {}
    merged.batch = pa.RecordBatch.from_pydict(arrays)
    return merged


def _rows(log):
    """Return the stamps of a log, or numbers of rows, its values by name, and the unit of stamps.

    Rows whose stamp cannot be read are left out. Dates are ns.
    """
    count = log.batch.num_rows
    stamps, readable, dates = np.arange(count), np.ones(count, dtype=bool), False
    if "time" in log.found:
        stamps, readable, dates = stamp_values(log.batch[STAMP])
    names = [name for name in log.batch.schema.names if name in (*CHANNELS, TEMPERATURE)]
    values = {name: log.batch[name].to_numpy(zero_copy_only=False)[readable] for name in names}
    return stamps[readable], values, "ns" if dates else log.units.get("time")


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _faster(stamps):
    """Return the quantity with the faster clock; the angular rate if both are equally fast."""
    steps = {}
    for quantity, x in stamps.items():
        forward = np.diff(x)
        forward = forward[forward > 0]
        steps[quantity] = np.median(forward) if len(forward) else np.inf
    if len(steps) == 1 or not steps["acceleration"] < (1 - _AS_FAST) * steps["angular_rate"]:
        return [*steps][-1]
    return "acceleration"


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _onto(clock, name, stamps, values, tick, linear=False):
    """Bring values of a log, shape (k, n), to the m stamps of another, the clock.

    Rows that miss a value, repeat a stamp or come late are left out. Values are not-a-number where
    no sample is near: within half of a gap of the nearest sample, or, if they are interpolated
    (`linear`), between two samples without a gap. `stamps` are by name, in units of `tick` ns.

    Returns
    -------
    values : ndarray, shape (k, m)
    held : ndarray, shape (m,)
        Stamp of the nearest sample.
    lost : str
        What to say of the rows that were left out.
    """
    times = []
    for each in (clock, name):
        own, x = Clock(), stamps[each]
        times.append(own.mended(x, np.ones(len(x), dtype=bool), tick=tick))
        if own.resets or own.rollovers:
            raise RejectedLog(
                f"the clock of {each} starts again within the log, from where {clock} and {name} "
                "may be apart: make a log of each part"
            )
    # whole stamps lose no digits if they are counted from one of them
    (x, usable), own = times[0], stamps[name]
    origin = x[usable][0].item() if usable.any() else 0
    at, known = (np.where(ok, np.asarray(x - origin, dtype=float), np.nan) for x, ok in times)
    used = np.flatnonzero(np.isfinite(known) & np.isfinite(values).all(axis=0))
    used = used[np.diff(np.maximum.accumulate(known[used]), prepend=-np.inf) > 0]
    known, values = known[used], values[:, used]
    limit = gap_limit(np.median(np.diff(known))) if len(used) > 1 else 0.0
    after, edges = np.searchsorted(known, at), np.concatenate(([-np.inf], known, [np.inf]))
    before, behind = at - edges[after], edges[after + 1] - at
    if linear:
        inside = (before + behind <= limit) | (behind == 0)
        between = np.interp(at, known, values[0]) if len(used) > 1 else np.nan
        return np.where(inside, between, np.nan)[None], None, ""
    near = np.minimum(before, behind) <= limit / 2
    nearest = np.clip(after - (behind > before), 0, len(used) - 1)
    if len(np.unique(nearest[near])) < 2:
        raise RejectedLog(f"{name} and {clock} share no time: their clocks differ")
    lost = len(own) - len(used)
    lost = f"; {lost} of its rows missing, repeated or out of order are left out" if lost else ""
    return np.where(near, values[:, nearest], np.nan), own[used][nearest], lost
