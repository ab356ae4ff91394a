"""What phones export: zips of phyphox and Sensor Logger, a table a sensor.

Android gives specific force in m/s^2. iOS gives its opposite, in g: a phone that lies face up
reads z = -1. phyphox turns that into Android's convention, Sensor Logger does where it is asked
to standardise. Here all become specific force.
"""

import re
import zipfile
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.ingest.columns import AXES, guess, stated_unit, unit_of
from imuloop.ingest.series import read_series
from imuloop.ingest.stamps import iso_text
from imuloop.ingest.streams import Stream, printable, raw_log
from imuloop.ingest.text_layout import find_layout
from imuloop.ingest.zipped import DamagedZip, Member, checked, find_members, small_table

ENDINGS = (".zip",)

# 2200, in seconds since 1970
_LATEST = 7.3e9
# "Acceleration x (m/s^2)", "X (m/s^2)", "accelerationX" or "x": sensor, axis, unit
_AXIS = re.compile(r"(.*?)\s*([xyz])\s*(?:\((.*)\))?", re.IGNORECASE)


@dataclass(frozen=True)
class _App:
    """How an app writes: its time and other columns that tell it, its sensors, the best first."""

    name: str
    marks: tuple[str, ...]
    time_unit: str
    acceleration: tuple[str, ...]
    angular_rate: tuple[str, ...]
    # words of the sensors that have gravity taken out
    without_gravity: str


_APPS = (
    _App(
        *("phyphox", ("time (s)",), "s"),
        acceleration=("acceleration", "accelerometer"),
        angular_rate=("gyroscope",),
        without_gravity="linear|without",
    ),
    _App(
        *("Sensor Logger", ("time", "seconds_elapsed"), "ns"),
        # before the corrections that the phone makes at run time
        acceleration=("accelerometeruncalibrated", "totalacceleration", "accelerometer+gravity"),
        angular_rate=("gyroscopeuncalibrated", "gyroscope"),
        without_gravity=r"accelerometer\Z",
    ),
)
# what Sensor Logger logs of an acceleration in two files
_SPLIT = ("accelerometer", "gravity")
# units of Sensor Logger's accelerations from iOS, which have its sign unless standardised
_IOS_UNITS = {
    "accelerometer": "m/s^2",
    "gravity": "m/s^2",
    "totalacceleration": "m/s^2",
    "accelerometeruncalibrated": "g",
}


@dataclass(frozen=True)
class _Table:
    """A table on one clock; `sensors` maps sensors, lower case, to their columns x, y, z.

    `count` is what was left out, of `imuloop.ingest.series.read_series`.
    """

    app: _App
    stream: Stream
    sensors: dict
    count: object = None


def read(paths, columns=None, batch_rows=1 << 16, most=-1):
    """Read a zip of CSV tables as phyphox and Sensor Logger export it.

    Nothing is unpacked to disk. Of Sensor Logger, what is not calibrated by the phone goes before
    what is; acceleration without gravity is never taken by itself.

    Parameters
    ----------
    paths : dict
        ``{"log": path}``.
    columns : dict, optional
        Quantity to ``FILE.COLUMN``, the file without its ending, three of them for a sensor; or
        to the file, where it holds one sensor.
    batch_rows : int
        Rows read and given at once, about.
    most : int
        Bytes read of each table's head, where only its names count; -1 is all.

    Raises
    ------
    ImuloopError
        If a declared column is not there, or two files hold the same sensor.
    RejectedLog
        If the file is no whole zip of such tables, or not one that is safe to read.
    """
    path = Path(paths["log"])
    with checked("the file is not a whole zip", zipfile.ZipFile, path) as archive:
        members = find_members(archive, path.stat().st_size)
        about = _about(archive, members)
        events = _events(archive, members)
        tables = [
            table
            for name, info in members.items()
            if (table := _table(name, partial(Member, archive, info), batch_rows, most))
        ]
    if not tables:
        listed = ", ".join(repr(name[:80]) for name in archive.namelist()[:5]) or "nothing"
        raise RejectedLog(f"the zip holds no table of phyphox or Sensor Logger, but {listed}")
    app = tables[0].app
    tables = [table for table in tables if table.app is app]
    notes = [
        f"recorded by {app.name} on {about['device']}" if about else f"an export of {app.name}"
    ]
    if app.name == "Sensor Logger":
        tables = _specific_force(tables, about, notes)
    else:
        tables = _with_pauses(tables, events, notes)
    columns = dict(columns or {})
    for quantity in ("acceleration", "angular_rate"):
        if columns.get(quantity) is None:
            columns[quantity] = _usual(quantity, tables, notes)
        for table in tables:
            if columns[quantity] == table.stream.name and len(table.sensors) == 1:
                columns[quantity] = _full_names(table, *table.sensors)
    log = raw_log([table.stream for table in tables], columns, batch_rows)
    log.notes[:0] = notes
    used = {log.found[quantity][0] for quantity in ("acceleration", "angular_rate")}
    for table in tables:
        if any(f"{table.stream.name}.{field}" in used for field in table.stream.fields):
            log.lose(table.count)
    return log


def _about(archive, members):
    """Return what phyphox or Sensor Logger say of the phone, `device` for a reader; or {}."""
    rows = []
    for name, info in members.items():
        if name.lower() in ("meta/device", "metadata"):
            rows = small_table(archive, info)
            # a row a property, or a row of names and one of values
            if name.lower() == "metadata":
                rows = zip(*rows[:2], strict=False)
    about = {row[0].strip().lower(): row[1].strip() for row in rows if len(row) > 1}
    if about:
        words = ("devicebrand", "devicemodel", "device name", "platform", "platform version")
        told = " ".join(about[word] for word in words if about.get(word, "null") != "null")
        about["device"] = "".join(c for c in told if c.isprintable())[:80] or "a phone"
    return about


def _events(archive, members):
    """Return (seconds of the experiment, seconds since 1970) of each start of phyphox's."""
    rows = small_table(archive, members["meta/time"]) if "meta/time" in members else []
    events = []
    for row in rows:
        if row and row[0].strip().upper() == "START":
            # a broken row tells nothing of the sensors
            with suppress(ValueError, IndexError):
                events.append([float(cell.replace(",", ".")) for cell in row[1:3]])
    return np.array([event for event in events if len(event) == 2]).reshape(-1, 2)


def _with_pauses(tables, events, notes):
    """Return tables whose stamps go on in the pauses, in which phyphox stops its clock."""
    events = events[np.isfinite(events).all(axis=1)]
    begun = events[:, 1] - events[:, 0]
    if len(begun) and 0 < begun[0] < _LATEST:
        notes.append(
            f"begun at {iso_text(round(begun[0] * 1000) * 1_000_000)} by the phone's clock"
        )
    # one that is set back makes no pause
    late = np.maximum.accumulate(begun - begun[:1])
    if not late.any():
        return tables
    notes.append(
        f"paused {np.count_nonzero(np.diff(late))} times, {late[-1]:.4g} s together, in which "
        "phyphox stops its clock: its stamps go on by the phone's, to the ms"
    )
    longer = []
    for table in tables:
        x = table.stream.stamps
        passed = np.searchsorted(events[1:, 0], x)
        stream = replace(table.stream, stamps=np.where(passed > 0, x + late[passed], x))
        longer.append(replace(table, stream=stream))
    return longer


def _table(name, opened, batch_rows, most):
    """Return the table, or None where it is none of a sensor's."""
    try:
        layout = find_layout(opened())
    except DamagedZip:
        raise
    except RejectedLog:
        # notes of the user, a header without rows
        return None
    name, names = printable(name), [printable(each) for each in layout.names]
    lower = [each.lower() for each in names]
    app = next((app for app in _APPS if {*app.marks} <= {*lower}), None)
    sensors = _sensors(name, names)
    if app is None or not (sensors or guess(names)["temperature"]):
        return None
    time = lower.index(app.marks[0])
    others = {each: i for i, each in reversed([*enumerate(names)]) if i != time}
    positions = [time, *others.values()]
    stamps, values, count, unstamped = read_series(opened(), layout, positions, batch_rows, most)
    fields = dict(zip(others, values, strict=True))
    units = {"time": app.time_unit, "acceleration": "m/s^2", "angular_rate": "rad/s"}
    for quantity in ("acceleration", "angular_rate"):
        told = [unit_of(quantity, (0, 1, 2), axes) for axes in sensors.values()]
        known = [unit for unit in told if unit and stated_unit(quantity, unit)]
        own = [
            unit for name, unit in zip(sensors, told, strict=True) if name in getattr(app, quantity)
        ]
        units[quantity] = next(filter(None, [*own, *known]), units[quantity])
    count.bad_lines += unstamped
    return _Table(app, Stream(name, stamps, fields, units), sensors, count)


def _sensors(file, names):
    """Return sensor, lower case -> names of its columns x, y, z."""
    found = {}
    for name in names:
        match = _AXIS.fullmatch(name) if len(name) < 100 else None
        if match:
            # a file of one sensor may call its columns x, y, z
            own = match[1] and not re.search("linear|without", file, re.IGNORECASE)
            axes = found.setdefault((match[1] if own else file).lower(), {})
            axes.setdefault(match[2].lower(), name)
    return {sensor: [axes[a] for a in AXES] for sensor, axes in found.items() if len(axes) == 3}


def _specific_force(tables, about, notes):
    """Return Sensor Logger's tables in Android's signs, and the sum of what is logged split."""
    if not about:
        notes.append("no Metadata.csv: taken as SI with Android's signs; see units.acceleration")
    if (
        about.get("platform", "").lower() == "ios"
        and about.get("standardisation", "").lower() != "true"
    ):
        notes.append("the sign of iOS is turned into that of specific force")
        tables = [_turned(table) for table in tables]
    split = {name: table for table in tables for name in table.sensors if name in _SPLIT}
    streams = [table.stream for table in split.values()]
    if len(split) == 2 and np.array_equal(streams[0].stamps, streams[1].stamps):
        total = {axis: streams[0].fields[axis] + streams[1].fields[axis] for axis in AXES}
        stream = replace(streams[0], name="Accelerometer+Gravity", fields=total)
        sensors = {stream.name.lower(): list(AXES)}
        tables = [*tables, replace(split[_SPLIT[0]], stream=stream, sensors=sensors)]
    return tables


def _turned(table):
    """Return a table of iOS with specific force where it has its opposite."""
    fields, units = dict(table.stream.fields), dict(table.stream.units)
    for sensor in _IOS_UNITS.keys() & table.sensors.keys():
        units["acceleration"] = _IOS_UNITS[sensor]
        for name in table.sensors[sensor]:
            fields[name] = -fields[name]
    return replace(table, stream=replace(table.stream, fields=fields, units=units))


def _usual(quantity, tables, notes):
    """Return the names of the three columns that the app has for a quantity, the best it has."""
    app = tables[0].app
    found = [
        (sensor, table)
        for sensor in getattr(app, quantity)
        for table in tables
        if sensor in table.sensors and len(table.stream.stamps)
    ]
    linear = [
        table.stream.name
        for table in tables
        if any(re.search(app.without_gravity, sensor) for sensor in table.sensors)
    ]
    if not found and linear and quantity == "acceleration":
        raise RejectedLog(f"{linear[0]} is without gravity, and no other acceleration is logged")
    if not found:
        listed = ", ".join(
            f"{table.stream.name} ({', '.join(table.stream.fields)})" for table in tables
        )
        raise RejectedLog(
            f"no {quantity} found; the zip holds {listed[:300]}; name it in columns.{quantity}"
        )
    best, table = found[0]
    twins = [other.stream.name for sensor, other in found if sensor == best]
    if len(twins) > 1:
        raise ImuloopError(
            f"{' and '.join(twins)} both hold {quantity}; name one in columns.{quantity}"
        )
    others = [other.stream.name for _, other in found[1:]]
    if quantity == "acceleration":
        others += [f"{name} (without gravity)" for name in linear]
    if others:
        notes.append(f"{quantity} is that of {table.stream.name}, not of {', '.join(others)}")
    return _full_names(table, best)


def _full_names(table, sensor):
    return [f"{table.stream.name}.{name}" for name in table.sensors[sensor]]
