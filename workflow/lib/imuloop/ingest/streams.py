"""Logs of several streams, each on a clock of its own: chosen, and merged onto one."""

from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog, did_you_mean
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TEMPERATURE
from imuloop.ingest.columns import guess
from imuloop.ingest.quality import GAP_STEPS
from imuloop.ingest.raw_log import STAMP, RawLog

_SENSORS = {"acceleration": ACCELERATION, "angular_rate": ANGULAR_RATE}


@dataclass(frozen=True)
class Stream:
    """Numbers that a log keeps together, on one clock.

    Attributes
    ----------
    name : str
        Topic, message or file.
    stamps : ndarray, shape (n,)
        int64 or float64, the same unit in all streams of a log.
    fields : dict of str to ndarray, shape (n,)
        Field names as the log has them.
    units : dict of str to str
        Unit of each quantity, where the format says it.
    """

    name: str
    stamps: np.ndarray
    fields: dict
    units: dict = field(default_factory=dict)


def raw_log(streams, columns=None, batch_rows=1 << 16):
    r"""Return the RawLog of the streams that hold acceleration and angular rate.

    The accelerometer's stamps are the log's. A quantity of another stream is interpolated
    linearly onto them, between stamps at most `GAP_STEPS` median steps apart; elsewhere it is
    missing. Between two stamps, a share u of the step after the first, white noise keeps
    :math:`u^2 + (1 - u)^2` of its variance: a note says how much on average.

    Parameters
    ----------
    streams : sequence of Stream
        All that the log holds.
    columns : dict, optional
        Quantity to ``STREAM.FIELD``, three of them for a sensor, or to a stream. What is left
        out is found by the usual names of fields.
    batch_rows : int
        Rows given at once.

    Raises
    ------
    ImuloopError
        If a declared column is not there, or a quantity is in no stream or in several.
    RejectedLog
        If the streams share no time.
    """
    columns = dict(columns or {})
    streams = [stream for stream in streams if len(stream.stamps)]
    chosen = {quantity: _declared(quantity, columns, streams) for quantity in _SENSORS}
    candidates = {q: [chosen[q]] if chosen[q] else _guessed(q, streams) for q in _SENSORS}
    shared = {c[0].name for c in candidates["acceleration"]} & {
        c[0].name for c in candidates["angular_rate"]
    }
    for quantity, found in candidates.items():
        # one that holds both sensors goes before those of one alone
        together = [c for c in found if c[0].name in shared]
        chosen[quantity] = _only(quantity, together or found, streams)
    clock = chosen["acceleration"][0]
    stamps = clock.stamps
    if columns.get("time") is not None:
        stream, name = _locate("time", columns["time"], streams)
        if stream is not clock:
            raise ImuloopError(f"columns.time: {columns['time']} is not in {clock.name}")
        stamps = stream.fields[name]
    notes, arrays, units = [], {}, dict(clock.units)
    for quantity, names in _SENSORS.items():
        stream, fields = chosen[quantity]
        values = _onto(clock, stream, [stream.fields[f] for f in fields], quantity, notes)
        arrays |= dict(zip(names, values, strict=True))
        units |= {quantity: stream.units[quantity]} if quantity in stream.units else {}
    found = {q: [f"{s.name}.{f}" for f in fields] for q, (s, fields) in chosen.items()}
    warmth = _temperature(columns, streams, clock)
    if warmth:
        stream, name = warmth
        (arrays[TEMPERATURE],) = _onto(clock, stream, [stream.fields[name]], TEMPERATURE, notes)
        found["temperature"] = f"{stream.name}.{name}"
        units |= {q: u for q, u in stream.units.items() if q == "temperature"}
    if all(np.isnan(arrays[name]).all() for name in ANGULAR_RATE):
        raise RejectedLog(
            f"{chosen['angular_rate'][0].name} and {clock.name} share no time: their clocks differ"
        )
    found["time"] = columns.get("time") or f"{clock.name} stamps"
    arrays[STAMP] = stamps

    def batches():
        for begin in range(0, len(stamps), batch_rows):
            part = slice(begin, begin + batch_rows)
            yield pa.RecordBatch.from_pydict({n: pa.array(x[part]) for n, x in arrays.items()})

    return RawLog(
        batches=batches(),
        temperature=TEMPERATURE in arrays,
        found=found,
        units=units,
        notes=notes,
    )


def _declared(quantity, columns, streams):
    """Return the declared (stream, fields), or None."""
    declared = columns.get(quantity)
    if declared is None:
        return None
    if isinstance(declared, str):
        stream = _named(quantity, declared, streams)
        return _only(quantity, _guessed(quantity, [stream]), [stream])
    located = [_locate(quantity, each, streams) for each in declared]
    if len({stream.name for stream, _ in located}) > 1:
        raise ImuloopError(f"columns.{quantity}: x, y and z are not in one stream")
    return located[0][0], [name for _, name in located]


def _named(quantity, name, streams):
    for stream in streams:
        if stream.name == name:
            return stream
    known = [stream.name for stream in streams]
    raise ImuloopError(
        f"columns.{quantity}: no stream '{name}'; there are {', '.join(known)}"
        f"{did_you_mean(name, known, 0.5)}"
    )


def _locate(quantity, column, streams):
    """Return the stream and the field of ``STREAM.FIELD``."""
    known = [f"{stream.name}.{name}" for stream in streams for name in stream.fields]
    for stream in streams:
        for name in stream.fields:
            if column == f"{stream.name}.{name}":
                return stream, name
    raise ImuloopError(
        f"columns.{quantity}: no column '{column}'{did_you_mean(str(column), known, 0.5)}; "
        f"the log's streams are {', '.join(stream.name for stream in streams)}"
    )


def _guessed(quantity, streams):
    """Return (stream, fields) of each stream whose fields have the usual names of a quantity."""
    found = []
    for stream in streams:
        names = list(stream.fields)
        for positions, _ in guess(names).get(quantity, ()):
            found.append((stream, [names[i] for i in positions]))
    return found


def _only(quantity, found, streams):
    if len(found) == 1:
        return found[0]
    if not found:
        listed = ", ".join(f"{s.name} ({', '.join(s.fields)})" for s in streams) or "nothing"
        raise ImuloopError(
            f"no {quantity} found; the log holds {listed}; name it in columns.{quantity}"
        )
    listed = " and ".join(f"{s.name} ({', '.join(fields)})" for s, fields in found)
    raise ImuloopError(f"{listed} all look like {quantity}; name one of them in columns.{quantity}")


def _temperature(columns, streams, clock):
    """Return the stream and field of the temperature; None without, or where it is not told."""
    if "temperature" in columns:
        declared = columns["temperature"]
        return _locate("temperature", declared, streams) if declared is not None else None
    own, others = [], []
    for stream in streams:
        names = list(stream.fields)
        found = [(stream, names[i]) for i, _ in guess(names).get("temperature", ())]
        (own if stream is clock else others).extend(found[:1])
    return own[0] if own else others[0] if len(others) == 1 else None


def _onto(clock, stream, values, quantity, notes):
    """Return fields of a stream at the stamps of the clock; not-a-number where there are none."""
    values = [np.asarray(x, dtype=float) for x in values]
    if stream is clock or np.array_equal(stream.stamps, clock.stamps):
        return values
    # from the first stamp on, so that none loses digits
    origin = clock.stamps[0]
    at, known = (np.asarray(s - origin, dtype=float) for s in (clock.stamps, stream.stamps))
    finite = np.isfinite(known) & np.all(np.isfinite(values), axis=0)
    later = np.maximum.accumulate(np.where(finite, known, -np.inf))
    used = finite & np.r_[True, known[1:] > later[:-1]]
    if used.sum() < 2:
        return [np.full(len(at), np.nan) for _ in values]
    left_out = int((~used).sum())
    known, values = known[used], [x[used] for x in values]
    after = np.clip(np.searchsorted(known, at, side="right"), 1, len(known) - 1)
    step = known[after] - known[after - 1]
    share = (at - known[after - 1]) / step
    between = (share >= 0) & (share <= 1) & (step <= GAP_STEPS * np.median(np.diff(known)))
    # on a stamp nothing is interpolated, however far the next one is
    between |= np.isin(at, known)
    kept = np.mean((share**2 + (1 - share) ** 2)[between]) if between.any() else np.nan
    note = f"{quantity} of {stream.name} interpolated linearly onto the stamps of {clock.name}"
    if quantity != TEMPERATURE and between.any():
        note += f": white noise keeps {kept:.0%} of its variance"
    if left_out:
        note += f"; {left_out} of its rows missing, repeated or out of order are left out"
    notes.append(note)
    return [np.where(between, np.interp(at, known, x), np.nan) for x in values]
