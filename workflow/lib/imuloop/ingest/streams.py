"""Logs of several tables or streams, each on its own clock: find those that hold the sensors."""

import re
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, Lacking, RejectedLog, did_you_mean, one_line
from imuloop.ingest.columns import lacking, resolve
from imuloop.ingest.join import join
from imuloop.ingest.spellings import SENSORS, guess
from imuloop.ingest.tables import table_log

# units in the logs of autopilots
AUTOPILOT = {"time": "us", "acceleration": "m/s^2", "angular_rate": "rad/s", "temperature": "degC"}


@dataclass(frozen=True)
class Stream:
    """Numbers in a log that have the same clock, such as a topic or a kind of message.

    `stamps` are whole or decimal numbers, shape (n,), with the same unit in all streams of a log.
    `fields` maps names to values, shape (n,). `units` maps a quantity to its unit, if the format
    states it. `notes` are lines that a user of this stream should know.
    """

    name: str
    stamps: np.ndarray
    fields: dict
    units: dict = field(default_factory=dict)
    notes: list = field(default_factory=list)

    @property
    def names(self):
        """Names of the fields as messages show them."""
        return [*map(one_line, self.fields)]

    def measures(self, quantity):
        """Return whether fields with the usual names of a quantity hold any value but zero.

        The result is None if no field has such a name.
        """
        zero = [
            name for name, x in zip(self.names, self.fields.values(), strict=True) if not np.any(x)
        ]
        return not guess(zero)[quantity] if guess(self.names)[quantity] else None

    def log(self, columns):
        """Return the RawLog of the stream; `columns` are its declared columns by quantity."""
        names, stem = self.names, one_line(self.name)
        chosen = resolve(["stamps", *names], {"time": 0} | columns)
        arrays = [self.stamps, *(np.asarray(x, float) for x in self.fields.values())]
        held = [pa.array(np.asarray(arrays[at])) for at in chosen.raw().values()]
        names = [f"{stem} stamps", *(f"{stem}.{name}" for name in names)]
        return table_log(names, chosen, held, units=self.units, notes=[*self.notes])


def rates(increments, interval, ticks_per_s=1):
    """Return increments, (n,), divided by their intervals, per s, (n,).

    `interval` has the intervals in ticks, (n,), and `ticks_per_s` is the number of ticks in 1 s.
    The result is not-a-number for an interval that is not positive.
    """
    # the product of ticks and single precision is exact, so that only the division rounds
    return ticks_per_s * increments.astype(float) / np.where(interval > 0, interval, np.nan)


def raw_log(streams, columns=None, notes=(), damage=()):
    """Return the RawLog of the streams that hold acceleration and angular rate.

    `columns` maps a quantity to a stream or to ``STREAM.FIELD``, three of these for a sensor. Other
    quantities are found by the usual names of fields, in streams with values other than zero. A
    time or temperature of None counts as not logged. `notes` and `damage` are lines on the log and
    on its lost parts. If no stream holds a sensor, an ImuloopError is raised, but a RejectedLog if
    there is damage, as the data are then at fault, not the config.
    """
    columns, notes = dict(columns or {}), [*notes]
    for quantity in ("time", "interval"):
        if columns.get(quantity) is not None:
            raise ImuloopError(f"columns.{quantity}: only tables have one, no streams")
    streams, usual = {one_line(stream.name): stream for stream in streams}, {}
    if not any(len(stream.stamps) for stream in streams.values()):
        raise RejectedLog("the log has no rows")
    for quantity in (*SENSORS, "temperature"):
        found = {name: stream.measures(quantity) for name, stream in streams.items()}
        found = {name: measured for name, measured in found.items() if measured is not None}
        usual[quantity] = [name for name, measured in found.items() if measured] or [*found]
    tables = {name: stream.names for name, stream in streams.items()}
    try:
        chosen = choose(columns, tables, usual)
        warm = owner("temperature", columns, tables)
    except Lacking as error:
        if not damage:
            raise
        raise RejectedLog(f"{error}; it may be lost to damage: {'; '.join(damage)}") from error
    used = [*dict.fromkeys(chosen.values())]
    if not used:
        raise ImuloopError("no sensor: columns.acceleration and columns.angular_rate are null")
    thermometers = [warm] if warm else usual["temperature"]
    if None in (columns.get("time", 0), columns.get("temperature", 0)) or {*used} & {*thermometers}:
        thermometers = []
    elif len(thermometers) > 1:
        names, thermometers = ", ".join(thermometers), []
        notes.append(f"temperature not read: {names} hold one; name it in columns.temperature")
    logs, whose = {}, chosen | {"temperature": warm}
    declared = {q: columns[q] for q in (*SENSORS, "temperature", "time") if q in columns}
    for name in used + thermometers:
        # a quantity that is declared of another stream is not logged in this one
        others = {quantity: None for quantity, owns in whose.items() if owns not in (None, name)}
        logs[name] = streams[name].log(declared | others)
    for quantity, name in chosen.items():
        if quantity not in logs[name].found:
            raise lacking(quantity, logs[name].columns)
    log = join(logs) if len(logs) > 1 else logs[used[0]]
    if isinstance(times := log.found.get("time"), dict):
        log.found["time"] = times["acceleration" if log.slower == "gyroscope" else "angular_rate"]
    log.notes[:0] = notes
    return log


def names_in(columns):
    """Return the words in declared columns, with and without the number of an instance, a set."""
    words = re.findall(r"\w+", str(columns or ""))
    return {*words, *(re.sub(r"_\d+\Z", "", word) for word in words)}


def choose(columns, tables, usual, bare=False):
    """Return the name of the table of each sensor, a dict by quantity.

    The table is the one in the declared `columns`, else one of the `usual` tables, a list of names
    for each quantity. A table that holds both sensors is preferred. `tables` maps names of tables
    to their columns. If `bare`, columns may be declared without their table. Declared columns lose
    the name of their table. Raises an ImuloopError if no table or several tables fit.
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

    `key` is the quantity. In the declared `columns` it loses the name of the table. `tables` maps
    names of tables to their columns. If `bare`, columns may be declared without their table. Raises
    an ImuloopError if there is no such table.
    """
    if (declared := columns.get(key)) is None:
        return None
    parts = [str(part) for part in np.ravel(declared)]
    named = [n for n in tables if all(f"{p.removeprefix('-')}.".startswith(f"{n}.") for p in parts)]
    if not named:
        if bare and not isinstance(declared, str):
            return None
        raise Lacking(
            f"columns.{key}: no stream '{', '.join(parts)}'; there are {', '.join(tables)}"
            f"{did_you_mean(parts[0], tables, 0.5)}"
        )
    name = max(named, key=len)
    if declared == name:
        del columns[key]
    else:
        parts = [part.replace(f"{name}.", "", 1) for part in parts]
        columns[key] = parts[0] if isinstance(declared, str) else parts
    return name
