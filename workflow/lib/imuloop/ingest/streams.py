"""Logs of several tables or streams, each with its own clock: choice of those with the sensors."""

import re
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, Lacking, RejectedLog, did_you_mean, one_line
from imuloop.ingest.columns import ambiguous, lacking, resolve
from imuloop.ingest.spellings import AXES, SENSORS, guess
from imuloop.ingest.tables import read_tables, table_log

# units in the logs of autopilots
AUTOPILOT = {"time": "us", "acceleration": "m/s^2", "angular_rate": "rad/s", "temperature": "degC"}


@dataclass(frozen=True)
class Stream:
    """The part of a log that has one clock, such as a topic or a kind of message, n rows.

    `stamps` are its time stamps, whole or decimal numbers, (n,); all streams of a log have the same
    unit of time. `fields` are its values, (n,) by name. `units` are its units by quantity, if the
    format states them. `notes` are lines for the user of this stream.
    """

    name: str
    stamps: np.ndarray
    fields: dict
    units: dict = field(default_factory=dict)
    notes: list = field(default_factory=list)

    @property
    def names(self):
        """Names of the fields as messages to the user show them, a list."""
        return [*map(one_line, self.fields)]

    def measures(self, quantity):
        """Return whether the stream measures a quantity: a field of it has values other than zero.

        `quantity` is the name of the quantity. Its fields are found by their usual names. Without
        such a field the result is None.
        """
        if not guess(self.names)[quantity]:
            return None
        values = zip(self.names, self.fields.values(), strict=True)
        return not guess([name for name, x in values if not np.any(x)])[quantity]

    def log(self, columns):
        """Return the RawLog of the stream; `columns` are its declared columns by quantity."""
        chosen = resolve(["stamps", *self.names], {"time": 0} | columns)
        values = [self.stamps, *(np.asarray(x, float) for x in self.fields.values())]
        arrays = [pa.array(values[at]) for at in chosen.raw.values()]
        stem = one_line(self.name)
        names = [f"{stem} stamps", *(f"{stem}.{name}" for name in self.names)]
        return table_log(names, chosen, arrays, units=self.units, notes=[*self.notes])


def sensor_fields(quantity, fields, names, interval, ticks_per_s=1):
    """Return the fields of a sensor under their usual names, a dict; empty if they are not there.

    `quantity` is the quantity of the sensor, `fields` are the values, (n,) by name, and `names` the
    names of x, y and z in `fields`. If `fields` has a field with the name `interval`, the values
    are increments and are divided by it. `ticks_per_s` is the number of units of the interval in a
    second. A value becomes not-a-number if its interval is not positive.
    """
    if not {*names} <= {*fields}:
        return {}
    values = [fields[name] for name in names]
    if interval in fields:
        ticks = np.where(fields[interval] > 0, fields[interval], np.nan)
        # the product of ticks and single precision is exact, so that only the division rounds
        values = [ticks_per_s * x.astype(float) / ticks for x in values]
    return {f"{quantity}.{axis}": x for axis, x in zip(AXES, values, strict=True)}


def raw_log(streams, columns=None, notes=(), damage=()):
    """Return the RawLog of the streams that hold acceleration, angular rate and temperature.

    `streams` are all Streams of the log. `columns` are the declared columns by quantity: a stream
    or ``STREAM.FIELD``, three of these for a sensor. Other quantities are found by the usual names
    of fields, in streams with values other than zero. A time or temperature that is declared as
    None counts as not logged. `notes` and `damage` are lines on the log and on its lost parts.

    Raises an ImuloopError if no stream holds a sensor, but a RejectedLog if there is damage: then
    the data are at fault, not the config. Raises a RejectedLog, too, if no stream has rows.
    """
    columns, notes = dict(columns or {}), [*damage, *notes]
    streams, usual = {one_line(stream.name): stream for stream in streams}, {}
    if not any(len(stream.stamps) for stream in streams.values()):
        raise RejectedLog("the log has no rows of inertial sensors")
    for quantity in (*SENSORS, "temperature"):
        measures = {name: stream.measures(quantity) for name, stream in streams.items()}
        usual[quantity] = [name for name, values in measures.items() if values]
        usual[quantity] = usual[quantity] or [name for name, x in measures.items() if x is not None]
    names = {name: stream.names for name, stream in streams.items()}
    try:
        tables = choose(columns, names, usual)
        thermometers = [owner("temperature", columns, names)]
    except Lacking as error:
        if damage:
            raise RejectedLog(f"{error}; it may be lost to damage: {'; '.join(damage)}") from error
        raise
    if not tables:
        raise ImuloopError("no sensor: columns.acceleration and columns.angular_rate are null")
    if None in (columns.get("time", 0), columns.get("temperature", 0)):
        thermometers = []
    elif thermometers == [None]:
        with_sensor = {*tables.values()}.intersection(usual["temperature"])
        thermometers = [] if with_sensor else usual["temperature"]
    if len(thermometers) > 1:
        both = ", ".join(thermometers)
        notes.append(f"temperature not read: {both} hold one; name it in columns.temperature")
    tables |= {"temperature": thermometers[0]} if len(thermometers) == 1 else {}
    log = read_tables(tables, lambda name, declared: streams[name].log(declared), columns)
    if isinstance(times := log.names.get("time"), dict):
        log.names["time"] = times["acceleration" if log.slower == "gyroscope" else "angular_rate"]
    log.notes[:0] = notes
    return log


def names_in(columns):
    """Return the names of topics or messages that declared columns may mean, a set.

    `columns` are the declared columns by quantity, or None. The names are all words in the
    declarations, and also these words without the number of an instance at the end. Besides the
    usual topics, a reader has to look only at topics with these names.
    """
    words = re.findall(r"\w+", str(columns or ""))
    return {*words, *(re.sub(r"_\d+\Z", "", word) for word in words)}


def choose(columns, tables, usual, bare=False):
    """Return the name of the table that holds each sensor, a dict by quantity.

    `columns` are the declared columns by quantity. They name the table; the name is removed from
    them, in place. `tables` has the names of the columns of each table by its name. For a sensor
    that is not declared, `usual` lists the names of tables that look like it; a table that holds
    both sensors is preferred. If `bare`, columns may be declared without their table. Raises an
    ImuloopError if no table or several tables fit.
    """
    logged = [quantity for quantity in SENSORS if columns.get(quantity, "") is not None]
    owners = {quantity: owner(quantity, columns, tables, bare) for quantity in logged}
    fits = {quantity: [name] if name else usual[quantity] for quantity, name in owners.items()}
    shared = set.intersection(*map(set, fits.values())) if fits else ()
    for quantity, names in fits.items():
        names = [name for name in names if name in shared] or names
        if not names:
            raise lacking(quantity, "; ".join(f"{n} ({', '.join(of)})" for n, of in tables.items()))
        if len(names) > 1:
            raise ambiguous(quantity, names)
        [fits[quantity]] = names
    return fits


def owner(key, columns, tables, bare=False):
    """Return the name of the table that is declared for a quantity, None if none is declared.

    `key` is the name of the quantity. `columns` are the declared columns by quantity; the name of
    the table is removed from the columns of this quantity, in place. `tables` has the names of the
    columns of each table by its name. If `bare`, columns may be declared without their table.
    Raises an ImuloopError if there is no such table.
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
            f"{did_you_mean(parts[0], tables)}"
        )
    name = max(named, key=len)
    if declared == name:
        del columns[key]
    else:
        parts = [part.replace(f"{name}.", "", 1) for part in parts]
        columns[key] = parts[0] if isinstance(declared, str) else parts
    return name
