"""Logs of several streams, each on its own clock: chosen, and merged onto one."""

import re
from dataclasses import dataclass, field, replace

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, Lacking, RejectedLog, did_you_mean, one_line
from imuloop.core.gaps import gap_limit
from imuloop.core.samples import SENSORS, TEMPERATURE
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import HELD, STAMP, check_each_once, listed, without_sign
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import AXES, guess
from imuloop.ingest.stamps import NANOSECONDS

SENSOR_OF = {"acceleration": "accelerometer", "angular_rate": "gyroscope"}
# clocks whose steps agree to this share are as fast
_AS_FAST = 0.05


@dataclass(frozen=True)
class Stream:
    """Numbers that a log keeps together, on one clock.

    `stamps` are whole or decimal numbers, shape (n,), of one unit in all streams of a log; `fields`
    name to values, shape (n,); `units` quantity to unit, where the format says it.
    """

    name: str
    stamps: np.ndarray
    fields: dict
    units: dict = field(default_factory=dict)

    def values(self, names):
        """Return fields as numbers, (k, n)."""
        return np.array([np.asarray(self.fields[name], dtype=float) for name in names])


def raw_log(streams, columns=None, notes=(), damage=()):
    """Return the RawLog of the streams that hold acceleration and angular rate.

    Two of one clock are put beside each other. Of two clocks the stamps are those of the faster
    sensor, of the gyroscope's where both are as fast: its samples stay as they are. Each row holds
    that sample of the slower one which is nearest in time, as far as half a gap (`GAP_STEPS`
    median steps); elsewhere it is missing. So each sample of the slower one is held for as long as
    it stands for: means and variances are its own. Its stamps are beside it (`RawLog.slower`). A
    temperature of another stream is interpolated linearly.

    `columns` maps a quantity to ``STREAM.FIELD``, three of them for a sensor, or to a stream; what
    is left out is found by the usual names of fields, and a time or temperature of None is taken as
    not logged. Where the log lacks what is looked for and `damage` says that something was lost,
    that is a fault of the data, not of the config.
    """
    columns = dict(columns or {})
    if columns.get("interval") is not None:
        raise ImuloopError("columns.interval: only tables have one, no logs of several streams")
    streams = [_signed(stream) for stream in streams]
    if not any(len(stream.stamps) for stream in streams):
        raise RejectedLog("the log has no rows")
    try:
        chosen = _chosen(columns, streams)
        clock = _faster(chosen)
        stream, name, doubts = _temperature(columns, streams, clock)
        time = None
        if columns.get("time") is not None:
            time = _locate("time", columns["time"], streams)
    except Lacking as error:
        if not damage:
            raise
        # the names of streams are enough
        lacks = re.sub(r" \([^()]*\)", "", str(error))
        raise RejectedLog(f"{lacks}; it may be lost to damage: {'; '.join(damage)}") from error
    arrays, found, notes, slower = {}, {}, [*notes, *doubts], None
    stamps, units = clock.stamps, {q: unit for q, unit in clock.units.items() if q == "time"}
    if time:
        own, name = time
        if own is not clock:
            raise ImuloopError(f"columns.time: {columns['time']} is not in {clock.name}")
        # in its own unit
        stamps, units = own.fields[name], {}
    for quantity, (own, fields) in chosen.items():
        values = own.values(fields)
        declared = columns.get(quantity)
        if isinstance(declared, (list, tuple)):
            values *= [[-1.0 if without_sign(column)[1] else 1.0] for column in declared]
        if own is not clock and not np.array_equal(own.stamps, clock.stamps):
            values, arrays[HELD], note = _nearest(clock, own, values)
            slower, notes = SENSOR_OF[quantity], [*notes, f"{quantity} of {own.name} {note}"]
        arrays |= dict(zip(SENSORS[SENSOR_OF[quantity]], values, strict=True))
        units |= {q: unit for q, unit in own.units.items() if q == quantity}
        found[quantity] = [f"{own.name}.{field}" for field in fields]
    if stream:
        arrays[TEMPERATURE] = stream.values([name])[0]
        if stream is not clock and not np.array_equal(stream.stamps, clock.stamps):
            arrays[TEMPERATURE] = _interpolated(clock, stream, arrays[TEMPERATURE])
            where = f"the stamps of {clock.name}"
            notes.append(f"temperature of {stream.name} interpolated linearly onto {where}")
        units |= {q: unit for q, unit in stream.units.items() if q == TEMPERATURE}
        found[TEMPERATURE] = f"{stream.name}.{name}"
    if slower and "time" in columns:
        raise ImuloopError("columns.time: each sensor has a clock of its own: leave it out")
    if columns.get("time", True) is not None:
        found["time"] = columns.get("time") or f"{clock.name} stamps"
        arrays[STAMP] = stamps

    return RawLog(
        batch=pa.RecordBatch.from_pydict(arrays),
        found=found,
        units=units,
        columns=f"{clock.name}: {listed([*clock.fields])}",
        notes=notes,
        slower=slower,
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
    fields = {one_line(name): x for name, x in stream.fields.items()}
    whole = np.asarray(stream.stamps).dtype.kind in "iu"
    stamps = np.asarray(stream.stamps).astype(np.int64 if whole else float)
    return replace(stream, name=one_line(stream.name), fields=fields, stamps=stamps)


def _chosen(columns, streams):
    """Return sensor -> (stream, its three fields)."""
    logged = [quantity for quantity in SENSOR_OF if columns.get(quantity, "") is not None]
    if not logged:
        raise ImuloopError("no sensor: columns.acceleration and columns.angular_rate are null")
    chosen = {quantity: _declared(quantity, columns, streams) for quantity in logged}
    candidates = {q: [chosen[q]] if chosen[q] else _guessed(q, streams) for q in logged}
    names = [{stream.name for stream, _ in found} for found in candidates.values()]
    shared = set.intersection(*names)
    for quantity, found in candidates.items():
        # one that holds both sensors goes before those of one alone
        together = [c for c in found if c[0].name in shared]
        chosen[quantity] = _only(quantity, together or found, streams)
    check_each_once(
        {q: [f"{stream.name}.{name}" for name in fields] for q, (stream, fields) in chosen.items()}
    )
    for stream, _ in chosen.values():
        if not len(stream.stamps):
            raise RejectedLog(f"{stream.name} has no rows")
    return chosen


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _faster(chosen):
    """Return the stream of the faster clock; that of angular rate where both are as fast."""
    if len(chosen) == 1:
        return next(iter(chosen.values()))[0]
    steps = []
    for quantity in ("acceleration", "angular_rate"):
        forward = np.diff(chosen[quantity][0].stamps)
        forward = forward[forward > 0]
        steps.append(np.median(forward) if len(forward) else np.inf)
    of_force, of_rate = steps
    return chosen["acceleration" if of_force < (1 - _AS_FAST) * of_rate else "angular_rate"][0]


def _declared(quantity, columns, streams):
    """Return the declared (stream, fields), or None."""
    declared = columns.get(quantity)
    if declared is None:
        return None
    if isinstance(declared, str):
        known = [stream.name for stream in streams]
        if declared not in known:
            raise Lacking(
                f"columns.{quantity}: no stream '{declared}'; there are {', '.join(known)}"
                f"{did_you_mean(declared, known, 0.5)}"
            )
        stream = streams[known.index(declared)]
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
    located = [_locate(quantity, without_sign(each)[0], streams) for each in declared]
    if len({stream.name for stream, _ in located}) > 1:
        raise ImuloopError(f"columns.{quantity}: x, y and z are not in one stream")
    return located[0][0], [name for _, name in located]


def _locate(quantity, column, streams):
    """Return the stream and the field of ``STREAM.FIELD``."""
    known = {
        f"{stream.name}.{name}": (stream, name) for stream in streams for name in stream.fields
    }
    if not isinstance(column, str) or column not in known:
        raise Lacking(
            f"columns.{quantity}: no column '{column}'{did_you_mean(str(column), known, 0.5)}; "
            f"the log's streams are {', '.join(stream.name for stream in streams)}"
        )
    return known[column]


def _guessed(quantity, streams):
    """Return (stream, fields) of each stream whose fields have the usual names of a quantity."""
    found = []
    for stream in streams:
        names = list(stream.fields)
        for where, _ in guess(names)[quantity]:
            found.append((stream, [names[i] for i in where]))
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
        held = ", ".join(f"{s.name} ({', '.join(s.fields)})" for s in streams) or "nothing"
        raise Lacking(f"no {quantity} found; the log holds {held}; name it in columns.{quantity}")
    alike = " and ".join(f"{s.name} ({', '.join(fields)})" for s, fields in found)
    raise ImuloopError(f"{alike} all look like {quantity}; name one of them in columns.{quantity}")


def _temperature(columns, streams, clock):
    """Return stream and field of the temperature, None where it is not clear, and why (texts)."""
    if "temperature" in columns:
        declared = columns["temperature"]
        found = (None, None) if declared is None else _locate("temperature", declared, streams)
        return *found, []
    found = []
    for stream in streams:
        names = list(stream.fields)
        usual = guess(names)["temperature"]
        if usual and len(stream.stamps):
            found.append((stream, names[usual[0][0]]))
    found = [each for each in found if each[0] is clock] or found
    if len(found) > 1:
        several = ", ".join(f"{stream.name}.{name}" for stream, name in found)
        doubt = f"temperature not read: {several}; name one of them in columns.temperature"
        return None, None, [doubt]
    return *(found or [(None, None)])[0], []


def _one_time(clock, stream):
    """Return the stamps of both from one moment on, not-a-number where there are none."""
    found = []
    for each in (clock, stream):
        own, tick = Clock(), NANOSECONDS[each.units.get("time", "s")]
        found.append(own.mended(each.stamps, np.isfinite(each.stamps), tick=tick))
        if own.resets or own.rollovers:
            raise RejectedLog(
                f"the clock of {each.name} starts again within the log, from where {clock.name} "
                f"and {stream.name} may be apart: make a log of each part"
            )
    # from a stamp on, so that none loses digits
    stamps, usable = found[0]
    origin = stamps[usable][0].item() if usable.any() else 0
    return (np.where(ok, np.asarray(x - origin, dtype=float), np.nan) for x, ok in found)


def _usable(clock, stream, values):
    """Return the stamps of a clock, and those of a stream with its values, (k, n), in order.

    Rows of the stream that miss a value, repeat a stamp or come late are left out.
    """
    at, known = _one_time(clock, stream)
    finite = np.isfinite(known) & np.all(np.isfinite(values), axis=0)
    later = np.maximum.accumulate(np.where(finite, known, -np.inf))
    rows = np.flatnonzero(finite & np.r_[True, known[1:] > later[:-1]])
    return at, known[rows], values[:, rows], rows


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _nearest(clock, stream, values):
    """Return the values of a stream nearest to each stamp of the clock, their stamps, and a note.

    Values are not-a-number where none is near.
    """
    at, known, values, rows = _usable(clock, stream, values)
    if len(known) > 1:
        after = np.clip(np.searchsorted(known, at), 1, len(known) - 1)
        before = known[after] - at > at - known[after - 1]
        nearest = after - before
        near = np.abs(known[nearest] - at) <= gap_limit(np.median(np.diff(known))) / 2
    if len(known) < 2 or len(np.unique(nearest[near])) < 2:
        raise RejectedLog(f"{stream.name} and {clock.name} share no time: their clocks differ")
    note = f"has a clock of its own: each row of {clock.name} holds its nearest sample"
    if left_out := len(stream.stamps) - len(rows):
        note += f"; {left_out} of its rows missing, repeated or out of order are left out"
    return np.where(near, values[:, nearest], np.nan), stream.stamps[rows][nearest], note


@np.errstate(over="ignore", invalid="ignore")
def _interpolated(clock, stream, values):
    """Return values of a stream, (n,), at the stamps of the clock, not-a-number over gaps."""
    at, known, (values,), _ = _usable(clock, stream, values[None])
    if len(known) < 2:
        return np.full(len(at), np.nan)
    after = np.clip(np.searchsorted(known, at), 1, len(known) - 1)
    near = known[after] - known[after - 1] <= gap_limit(np.median(np.diff(known)))
    between = (near & (at >= known[0]) & (at <= known[-1])) | np.isin(at, known)
    return np.where(between, np.interp(at, known, values), np.nan)
