"""Logs of several tables or streams: which hold the sensors, each on its own clock."""

import re
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, Lacking, RejectedLog, did_you_mean, one_line
from imuloop.ingest.columns import lacking, resolve
from imuloop.ingest.join import join
from imuloop.ingest.spellings import SENSORS, guess
from imuloop.ingest.tables import table_log

# units of autopilots
AUTOPILOT = {"time": "us", "acceleration": "m/s^2", "angular_rate": "rad/s", "temperature": "degC"}


@dataclass(frozen=True)
class Stream:
    """Numbers that a log keeps together, on one clock.

    `stamps` are whole or decimal numbers, shape (n,), with the same unit in all streams of a log.
    `fields` maps names to values, shape (n,). `units` maps a quantity to its unit, if the format
    states it.
    """

    name: str
    stamps: np.ndarray
    fields: dict
    units: dict = field(default_factory=dict)

    def log(self, columns):
        """Return the RawLog of the stream; `columns` are its own, as declared."""
        names, columns = ["stamps", *map(one_line, self.fields)], {"time": 0} | columns
        chosen = resolve(names, columns)
        arrays = [self.stamps, *self.fields.values()]
        held = [
            pa.array(np.asarray(arrays[at], None if at == 0 else float))
            for at in chosen.raw().values()
        ]
        units = {q: u for q, u in self.units.items() if q != "time" or columns["time"] == 0}
        log = table_log(names, chosen, held, units=units)
        stem = one_line(self.name)
        for quantity, found in log.found.items():
            several = isinstance(found, list)
            log.found[quantity] = [f"{stem}.{x}" for x in found] if several else f"{stem}.{found}"
        if columns["time"] == 0:
            log.found["time"] = f"{stem} stamps"
        return log


def raw_log(streams, columns=None, notes=(), damage=()):
    """Return the RawLog of the streams that hold acceleration and angular rate.

    `columns` maps a quantity to a stream or to ``STREAM.FIELD``, three of these for a sensor. The
    usual names of fields find what is left out. A time or temperature of None counts as not logged.
    If the log lacks a quantity and `damage` says that something was lost, the data are at fault,
    not the config.
    """
    columns, notes = dict(columns or {}), [*notes]
    if columns.get("interval") is not None:
        raise ImuloopError("columns.interval: only tables have one, no logs of several streams")
    streams = {one_line(stream.name): stream for stream in streams}
    if not any(len(stream.stamps) for stream in streams.values()):
        raise RejectedLog("the log has no rows")
    tables, usual = {name: [*map(one_line, s.fields)] for name, s in streams.items()}, {}
    for quantity in (*SENSORS, "temperature"):
        found = [name for name, fields in tables.items() if guess(fields)[quantity]]
        # a stream that holds nothing is no choice where another does
        usual[quantity] = [name for name in found if len(streams[name].stamps)] or found
    try:
        chosen = choose(columns, tables, usual)
        others = {key: owner(key, columns, tables) for key in ("temperature", "time")}
    except Lacking as error:
        if not damage:
            raise
        # the names of streams are enough
        lacks = re.sub(r" \([^()]*\)", "", str(error))
        raise RejectedLog(f"{lacks}; it may be lost to damage: {'; '.join(damage)}") from error
    used = [*dict.fromkeys(chosen.values())]
    if not used:
        raise ImuloopError("no sensor: columns.acceleration and columns.angular_rate are null")
    if others["time"] and {others["time"]} != {*used}:
        raise ImuloopError(
            f"columns.time: {others['time']} is not the clock of {' and '.join(used)}"
        )
    warm = [others["temperature"]] if others["temperature"] else usual["temperature"]
    if "time" in columns or columns.get("temperature", 0) is None or {*used} & {*warm}:
        warm = []
    if len(warm) > 1:
        line = f"temperature not read: {', '.join(warm)} hold one; name it in columns.temperature"
        notes, warm = [*notes, line], []
    logs = {}
    for name in used + warm:
        # what is declared of another stream is not logged in this one
        whose = others | dict.fromkeys(SENSORS) | chosen
        own = {q: None for q in whose if whose[q] != name and (q in columns or q in SENSORS)}
        own |= {q: value for q, value in columns.items() if whose.get(q) == name}
        logs[name] = streams[name].log(own)
    for quantity, name in chosen.items():
        if quantity not in logs[name].found:
            raise lacking(quantity, logs[name].columns)
    log = join(logs) if len(logs) > 1 else logs[used[0]]
    if isinstance(times := log.found.get("time"), dict):
        log.found["time"] = times["acceleration" if log.slower == "gyroscope" else "angular_rate"]
    log.notes[:0] = notes
    return log


def names_in(columns):
    """Return the words in declared columns, also without the number of an instance."""
    words = re.findall(r"\w+", str(columns or ""))
    return {*words, *(re.sub(r"_\d+\Z", "", word) for word in words)}


def choose(columns, tables, usual, bare=False):
    """Return sensor -> name of its table, from those declared, else from the `usual` ones.

    A table that holds both sensors goes before those of one. Parameters are as in `owner`.
    """
    found = {}
    for quantity in SENSORS:
        if columns.get(quantity, "") is not None:
            own = owner(quantity, columns, tables, bare)
            found[quantity] = [own] if own else usual[quantity]
    shared = set.intersection(*map(set, found.values())) if found else ()
    for quantity, names in found.items():
        names = [name for name in names if name in shared] or names
        if len(names) > 1:
            raise ImuloopError(
                f"{' and '.join(names)} all look like {quantity}; name one of them in "
                f"columns.{quantity}"
            )
        if not names:
            held = ", ".join(f"{name} ({', '.join(of)})" for name, of in tables.items())
            raise Lacking(
                f"no {quantity} found; the log holds {held or 'nothing'}; name it in "
                f"columns.{quantity}"
            )
        [found[quantity]] = names
    return found


def owner(key, columns, tables, bare=False):
    """Return the name of the table in which a declared quantity is, None if it is not declared.

    In `columns` it loses that name. `tables` maps names to columns; with `bare` columns may be
    declared without their table.
    """
    if (declared := columns.get(key)) is None:
        return None
    parts = [str(part) for part in np.ravel(declared)]
    inside = [f"{part.removeprefix('-')}." for part in parts]
    named = [name for name in tables if all(part.startswith(f"{name}.") for part in inside)]
    if not named:
        if bare and not isinstance(declared, str):
            return None
        raise Lacking(
            f"columns.{key}: no stream '{', '.join(parts)}'; there are {', '.join(tables)}"
            f"{did_you_mean(parts[0], tables, 0.5)}"
        )
    name = max(named, key=len)
    parts = [part.replace(f"{name}.", "", 1) for part in parts]
    columns[key] = parts if isinstance(declared, (list, tuple)) else parts[0]
    if declared == name:
        del columns[key]
    return name
