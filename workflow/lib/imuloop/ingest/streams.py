"""Logs of several streams, each on a clock of its own: chosen, and merged onto one."""

from dataclasses import dataclass, field, replace

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, Lacking, RejectedLog, did_you_mean
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, GAP_STEPS, TEMPERATURE
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import AXES, guess, listed
from imuloop.ingest.raw_log import STAMP, RawLog
from imuloop.ingest.stamps import NANOSECONDS

_SENSORS = {"acceleration": ACCELERATION, "angular_rate": ANGULAR_RATE}

# two clocks that are further apart, in spans of the counter, are not brought together
_MOST_TURNS = 1000


@dataclass(frozen=True)
class Stream:
    """Numbers that a log keeps together, on one clock.

    Attributes
    ----------
    name : str
        Topic, message or file.
    stamps : ndarray, shape (n,)
        Whole or decimal numbers, the same unit in all streams of a log.
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
        out is found by the usual names of fields; a time or temperature that is None is taken as
        not logged.
    batch_rows : int
        Rows given at once.

    Raises
    ------
    ImuloopError
        If a declared column is not there, or a quantity is in no stream or in several.
    RejectedLog
        If there are no rows, or the streams share no time.
    """
    columns = dict(columns or {})
    if columns.get("interval") is not None:
        raise ImuloopError("columns.interval: only tables have one, no logs of several streams")
    streams = [_signed(stream) for stream in streams]
    if not any(len(stream.stamps) for stream in streams):
        raise RejectedLog("the log has no rows")
    chosen = {quantity: _declared(quantity, columns, streams) for quantity in _SENSORS}
    candidates = {q: [chosen[q]] if chosen[q] else _guessed(q, streams) for q in _SENSORS}
    shared = {c[0].name for c in candidates["acceleration"]} & {
        c[0].name for c in candidates["angular_rate"]
    }
    for quantity, found in candidates.items():
        # one that holds both sensors goes before those of one alone
        together = [c for c in found if c[0].name in shared]
        chosen[quantity] = _only(quantity, together or found, streams)
    taken = [f"{stream.name}.{field}" for stream, fields in chosen.values() for field in fields]
    if twice := [name for name in taken if taken.count(name) > 1]:
        raise ImuloopError(f"columns: {twice[0]} is named twice; each axis is a column of its own")
    for stream, _ in chosen.values():
        if not len(stream.stamps):
            raise RejectedLog(f"{stream.name} has no rows")
    clock = chosen["acceleration"][0]
    stamps, units = clock.stamps, _stated("time", clock)
    if columns.get("time") is not None:
        stream, name = _locate("time", columns["time"], streams)
        if stream is not clock:
            raise ImuloopError(f"columns.time: {columns['time']} is not in {clock.name}")
        # in a unit of its own
        stamps, units = stream.fields[name], {}
    notes, arrays, interpolated = [], {}, set()
    for quantity, names in _SENSORS.items():
        stream, fields = chosen[quantity]
        own = len(notes)
        values = _onto(clock, stream, [stream.fields[f] for f in fields], quantity, notes)
        if len(notes) > own:
            interpolated.add(quantity)
        arrays |= dict(zip(names, values, strict=True))
        units |= _stated(quantity, stream)
    found = {q: [f"{s.name}.{f}" for f in fields] for q, (s, fields) in chosen.items()}
    warmth = _temperature(columns, streams, clock, notes)
    if warmth:
        stream, name = warmth
        (arrays[TEMPERATURE],) = _onto(clock, stream, [stream.fields[name]], TEMPERATURE, notes)
        found["temperature"] = f"{stream.name}.{name}"
        units |= _stated("temperature", stream)
    if columns.get("time", True) is not None:
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
        columns=f"{clock.name}: {listed([*clock.fields])}",
        notes=notes,
        interpolated=interpolated,
    )


def stream_names(columns):
    """Return what the declared streams, whole or by their fields, may be called.

    Streams and fields may have dots in their names: a name may end at each.
    """
    flat = []
    for value in (columns or {}).values():
        flat += value if isinstance(value, (list, tuple)) else [value]
    parts = [str(value).split(".") for value in flat if value is not None]
    return {".".join(words[: i + 1]) for words in parts for i in range(len(words))}


def _signed(stream):
    """Return the stream with stamps that can be subtracted, and names that fit in a line."""
    fields = {printable(name): x for name, x in stream.fields.items()}
    stream = replace(stream, name=printable(stream.name), fields=fields)
    if np.asarray(stream.stamps).dtype.kind in "iu":
        return replace(stream, stamps=np.asarray(stream.stamps).astype(np.int64))
    return replace(stream, stamps=np.asarray(stream.stamps, dtype=float))


def printable(text):
    """Return a name of a file without what a terminal would obey."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _stated(quantity, stream):
    return {q: unit for q, unit in stream.units.items() if q == quantity}


def _declared(quantity, columns, streams):
    """Return the declared (stream, fields), or None."""
    declared = columns.get(quantity)
    if declared is None:
        return None
    if isinstance(declared, str):
        stream = _named(quantity, declared, streams)
        # what is declared needs no usual name
        found = _guessed(quantity, [stream]) or _triples(stream)
        if len(found) != 1:
            raise ImuloopError(
                f"columns.{quantity}: {declared} holds {', '.join(stream.fields)}; name x, y and z "
                f"of it as {declared}.FIELD"
            )
        return found[0]
    if not isinstance(declared, (list, tuple)) or len(declared) != len(AXES):
        raise ImuloopError(f"columns.{quantity}: {declared!r} is not a list of three columns")
    located = [_locate(quantity, each, streams) for each in declared]
    if len({stream.name for stream, _ in located}) > 1:
        raise ImuloopError(f"columns.{quantity}: x, y and z are not in one stream")
    return located[0][0], [name for _, name in located]


def _named(quantity, name, streams):
    for stream in streams:
        if stream.name == name:
            return stream
    known = [stream.name for stream in streams]
    raise Lacking(
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
    raise Lacking(
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
    # a stream that holds nothing is no choice where another does
    return [each for each in found if len(each[0].stamps)] or found


def _triples(stream):
    """Return (stream, fields) of all fields of a stream that end in x, y and z alike."""
    stems = [name.removesuffix("x") for name in stream.fields if name.endswith("x")]
    triples = [[f"{stem}{axis}" for axis in AXES] for stem in stems]
    return [(stream, names) for names in triples if set(names) <= set(stream.fields)]


def _only(quantity, found, streams):
    if len(found) == 1:
        return found[0]
    if not found:
        listed = ", ".join(f"{s.name} ({', '.join(s.fields)})" for s in streams) or "nothing"
        raise Lacking(f"no {quantity} found; the log holds {listed}; name it in columns.{quantity}")
    listed = " and ".join(f"{s.name} ({', '.join(fields)})" for s, fields in found)
    raise ImuloopError(f"{listed} all look like {quantity}; name one of them in columns.{quantity}")


def _temperature(columns, streams, clock, notes):
    """Return the stream and field of the temperature; None without, or where it is not told."""
    if "temperature" in columns:
        declared = columns["temperature"]
        return _locate("temperature", declared, streams) if declared is not None else None
    own, others = [], []
    for stream in streams:
        names = list(stream.fields)
        found = [(stream, names[i]) for i, _ in guess(names).get("temperature", ())]
        if len(stream.stamps):
            (own if stream is clock else others).extend(found[:1])
    if not own and len(others) > 1:
        listed = ", ".join(f"{stream.name}.{name}" for stream, name in others)
        notes.append(f"temperature not read: {listed}; name one of them in columns.temperature")
        return None
    return (own or others or [None])[0]


def _one_time(clock, stream, notes):
    """Return the stamps of both from one moment on; not-a-number where there are none.

    Each is mended by itself: counters roll over at moments of their own. Where both start again
    equally often, they count from one moment on again.
    """
    (at, usable, first), (known, readable, second) = (_mended(each) for each in (clock, stream))
    notes += [f"{stream.name}: {line}" for line in second.warnings()]
    if len(first.restarts) == len(second.restarts):
        for (_, common), (row, own) in zip(first.restarts, second.restarts, strict=True):
            known = known + np.where(np.arange(len(known)) < row, 0, common - own)
    else:
        notes.append(
            f"{clock.name} and {stream.name} start again {first.resets} and {second.resets} times: "
            "from there on their clocks may be apart"
        )
    span_s = first.span_s or second.span_s
    if span_s and usable.any() and readable.any():
        # one of the two may begin before the counter rolls over, and one after
        width = _ticks(span_s, clock, at.dtype)
        limits = [x[ok][[0, -1]] for x, ok in ((at, usable), (known, readable))]
        turns = (limits[0].mean() - limits[1].mean()) / width
        if abs(turns) < _MOST_TURNS:
            shifts = [(round(turns) + k) * width for k in (0, -1, 1)]
            known = known + max(shifts, key=lambda shift: _overlap(limits[0], limits[1] + shift))
    # from a stamp on, so that none loses digits
    origin = at[usable.argmax()] if usable.any() else 0
    return (
        np.where(ok, np.asarray(x - origin, dtype=float), np.nan)
        for x, ok in ((at, usable), (known, readable))
    )


def _mended(stream):
    """Return the stamps of a stream as of a clock that never falls, which are usable, the Clock."""
    own, none = Clock(), (stream.stamps[:0], np.zeros(0, dtype=bool))
    tick = NANOSECONDS[stream.units.get("time", "s")]
    stamps, usable = own.mended(stream.stamps, np.isfinite(stream.stamps), none, tick)
    return stamps, usable, own


def _ticks(seconds, stream, dtype):
    """Return seconds in the unit of a stream's stamps, whole where they are."""
    ticks = seconds * 1e9 / NANOSECONDS[stream.units.get("time", "s")]
    return round(ticks) if dtype.kind == "i" else ticks


def _overlap(a, b):
    return min(a[1], b[1]) - max(a[0], b[0])


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _onto(clock, stream, values, quantity, notes):
    """Return fields of a stream at the stamps of the clock; not-a-number where there are none."""
    values = [np.asarray(x, dtype=float) for x in values]
    if stream is clock or np.array_equal(stream.stamps, clock.stamps):
        return values
    at, known = _one_time(clock, stream, notes)
    finite = np.isfinite(known) & np.all(np.isfinite(values), axis=0)
    later = np.maximum.accumulate(np.where(finite, known, -np.inf))
    used = finite & np.r_[True, known[1:] > later[:-1]]
    left_out = int((~used).sum())
    known, values = known[used], [x[used] for x in values]
    between = np.zeros(len(at), dtype=bool)
    if len(known) > 1:
        after = np.clip(np.searchsorted(known, at, side="right"), 1, len(known) - 1)
        step = known[after] - known[after - 1]
        near = step <= GAP_STEPS * np.median(np.diff(known))
        # on a stamp nothing is interpolated, however far the next one is
        between = (near & (at >= known[0]) & (at <= known[-1])) | np.isin(at, known)
    if not between.any():
        if quantity == TEMPERATURE:
            return [np.full(len(at), np.nan)]
        raise RejectedLog(f"{stream.name} and {clock.name} share no time: their clocks differ")
    note = f"{quantity} of {stream.name} interpolated linearly onto the stamps of {clock.name}"
    if quantity != TEMPERATURE:
        share = ((at - known[after - 1]) / step)[between]
        kept = np.mean(share**2 + (1 - share) ** 2)
        note += f": white noise keeps {kept:.0%} of its variance"
    if left_out:
        note += f"; {left_out} of its rows missing, repeated or out of order are left out"
    notes.append(note)
    return [np.where(between, np.interp(at, known, x), np.nan) for x in values]
