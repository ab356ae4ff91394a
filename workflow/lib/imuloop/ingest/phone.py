"""What phones export: zips of phyphox and Sensor Logger, a table a sensor.

Android gives specific force in m/s^2. iOS gives its opposite, in g: a phone that lies face up
reads z = -1. phyphox turns that into Android's convention, Sensor Logger does where it is asked
to standardise. Here all become specific force.
"""

import csv
import os
import re
import zipfile
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import PureWindowsPath

import numpy as np

from imuloop.core.errors import ImuloopError, RejectedLog, one_line
from imuloop.ingest import delimited
from imuloop.ingest.damage import check_unpacked, reject_damage
from imuloop.ingest.delimited import text_columns
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import AXES, SENSORS, guess, named_sensor, unit_of
from imuloop.ingest.stamps import stamp_values
from imuloop.ingest.streams import Stream, raw_log
from imuloop.ingest.tables import read_pair
from imuloop.ingest.text_layout import LONGEST_LINE, SPREADSHEET, find_layout

ENDINGS = (".zip",)
# of text tables in a zip
_TABLES = (*delimited.ENDINGS, ".tsv", ".tab")

# "Acceleration x (m/s^2)", "X (m/s^2)", "accelerationX" or "x": sensor, axis, unit
_AXIS = re.compile(r"(.{,99}?)\s*([xyz])\s*(?:\((.*)\))?", re.IGNORECASE)


# how an app writes: columns that show it, time first, unit of time, its sensors, the best first; of
# Sensor Logger first what is logged before the corrections that the phone makes at run time
_APPS = {
    "phyphox": (
        ("time (s)",),
        "s",
        {"acceleration": ("acceleration", "accelerometer"), "angular_rate": ("gyroscope",)},
    ),
    "Sensor Logger": (
        ("time", "seconds_elapsed"),
        "ns",
        {
            "acceleration": ("accelerometeruncalibrated", "totalacceleration"),
            "angular_rate": ("gyroscopeuncalibrated", "gyroscope"),
        },
    ),
}
# units of Sensor Logger's accelerations from iOS, which have its sign unless standardised
_IOS_UNITS = {"totalacceleration": "m/s^2", "accelerometeruncalibrated": "g"}
_IOS_UNITS |= {"accelerometer": "m/s^2", "gravity": "m/s^2"}
_USUAL_UNITS = {"acceleration": "m/s^2", "angular_rate": "rad/s"}


@dataclass(frozen=True)
class _Table:
    """A table on one clock; `sensors` maps sensors, lower case, to their columns x, y, z.

    `count` is a RawLog with the lines and bytes that were left out.
    """

    app: str
    stream: Stream
    sensors: dict
    count: object

    def columns(self, sensor):
        return [f"{self.stream.name}.{name}" for name in self.sensors[sensor]]


@reject_damage
def read(paths, columns=None):
    """Read a zip of tables as phyphox and Sensor Logger export it, or of one or two text tables.

    Of Sensor Logger, what is not calibrated by the phone goes before what is; acceleration
    without gravity is never taken by itself. `columns` names a file without its ending, where it
    holds one sensor, or three of ``FILE.COLUMN``.
    """
    with zipfile.ZipFile(paths["log"]) as archive:
        size = sum(info.file_size for info in archive.infolist())
        check_unpacked(os.path.getsize(paths["log"]), size)
        members = _members(archive)
        about = _cells(archive, members, "Metadata")[:2]
        about = dict(zip(*([x.strip().lower() for x in row] for row in about), strict=False))
        turned = about.get("platform") == "ios" and about.get("standardisation") != "true"
        tables = [_table(name, _text(archive, info), turned) for name, info in members.items()]
        tables = [table for table in tables if table]
        if not tables:
            return _plain(archive, members, columns)
        events = _events(archive, members)
    app = tables[0].app
    tables = [table for table in tables if table.app == app]
    notes = [f"an export of {app}"]
    if app == "phyphox":
        tables = _with_pauses(tables, events, notes)
    elif not about:
        notes.append("no Metadata.csv: taken as SI with Android's signs; see units.acceleration")
    elif turned:
        notes.append("the sign of iOS is turned into that of specific force")
    columns = dict(columns or {})
    for quantity in SENSORS:
        if columns.get(quantity) is None:
            columns[quantity] = _usual(quantity, tables, notes)
        for table in tables:
            if columns[quantity] == table.stream.name and len(table.sensors) == 1:
                columns[quantity] = table.columns(*table.sensors)
    log = raw_log([table.stream for table in tables], columns, notes)
    used = {log.found[quantity][0] for quantity in SENSORS}
    for table in tables:
        if any(f"{table.stream.name}.{field}" in used for field in table.stream.fields):
            log.lose(table.count)
    return log


def _plain(archive, members, columns):
    """Return the log of a zip that holds one table, or one of each sensor by their names."""
    members = {name: info for name, info in members.items() if _is_table(archive, info)}
    by_sensor = {q: [n for n in members if named_sensor(n) == q] for q in SENSORS}
    if len(members) == 1:
        [(name, info)] = members.items()
        log = delimited.read({"log": _text(archive, info)}, columns)
        log.notes.insert(0, f"the table {name} of the zip")
        return log
    if any(name.startswith("xl/") or name == "content.xml" for name in archive.namelist()):
        raise RejectedLog(SPREADSHEET)
    if any(len(names) != 1 for names in by_sensor.values()):
        listed = ", ".join(repr(name[:80]) for name in archive.namelist()[:5]) or "nothing"
        raise RejectedLog(
            "the zip holds no table of phyphox or Sensor Logger, nor one table, nor one whose name "
            f"says acc and one gyr, but {listed}"
        )
    texts = {q: _text(archive, members[name]) for q, (name,) in by_sensor.items()}
    log = read_pair(delimited.read, texts, columns)
    log.notes.insert(0, f"the tables {' and '.join(n for (n,) in by_sensor.values())} of the zip")
    return log


def _is_table(archive, info):
    with suppress(RejectedLog):
        return bool(find_layout(_text(archive, info, LONGEST_LINE)))
    return False


def _text(archive, info, most=-1):
    with archive.open(info) as file:
        return file.read(most)


def _members(archive):
    """Return name without folder, of a CSV without ending, -> ZipInfo of the text tables."""
    members = {}
    for info in archive.infolist():
        # splits at / as well
        place = PureWindowsPath(info.filename)
        ending = place.suffix.lower()
        if ending not in _TABLES or place.parts[0] == "__MACOSX" or place.name[0] == ".":
            continue
        name = place.stem if ending == ".csv" else place.name
        key = "meta/" * (place.parent.name == "meta") + name
        if key in members:
            raise RejectedLog(f"the zip holds two files {place.name[:80]!r}: give one recording")
        members[key] = info
    return members


def _cells(archive, members, name):
    """Return the cells of a small table, none where there is no such."""
    if name not in members:
        return []
    text = _text(archive, members[name], LONGEST_LINE).decode("utf-8-sig", "replace")
    head = text.partition("\n")[0]
    return [*csv.reader(text.splitlines(), delimiter=max(",;\t", key=head.count))]


def _events(archive, members):
    """Return (seconds of the experiment, seconds since 1970) of each start of phyphox's."""
    events = []
    for row in _cells(archive, members, "meta/time"):
        if row and row[0].strip().upper() == "START":
            # a broken row tells nothing of the sensors
            with suppress(ValueError, IndexError):
                events.append([float(row[i].replace(",", ".")) for i in (1, 2)])
    events = np.array(events).reshape(-1, 2)
    return events[np.isfinite(events).all(axis=1)]


def _with_pauses(tables, events, notes):
    """Return tables whose stamps go on in the pauses, in which phyphox stops its clock."""
    begun = events[:, 1] - events[:, 0]
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


def _table(name, text, turned):
    """Return the table, with specific force where iOS has its opposite; None if of no sensor."""
    try:
        layout = find_layout(text)
    except RejectedLog:
        # notes of the user, a header without rows
        return None
    name, names = one_line(name), [one_line(each) for each in layout.names]
    lower = [each.lower() for each in names]
    app = next((name for name, (marks, *_) in _APPS.items() if {*marks} <= {*lower}), None)
    sensors = _sensors(name, names)
    if app is None or not (sensors or guess(names)["temperature"]):
        return None
    marks, time_unit, best = _APPS[app]
    time = lower.index(marks[0])
    others = {each: i for i, each in reversed([*enumerate(names)]) if i != time}
    stamps, values, count, lost = _series(text, layout, [time, *others.values()])
    count.bad_lines += lost
    fields = dict(zip(others, values, strict=True))
    units = {"time": time_unit}
    for quantity, usual in _USUAL_UNITS.items():
        own = [unit_of(quantity, (0, 1, 2), sensors[s]) for s in best[quantity] if s in sensors]
        units[quantity] = next(filter(None, own), usual)
    for sensor in _IOS_UNITS.keys() & sensors.keys() if turned else ():
        units["acceleration"] = _IOS_UNITS[sensor]
        fields |= {each: -fields[each] for each in sensors[sensor]}
    return _Table(app, Stream(name, stamps, fields, units), sensors, count)


def _series(source, layout, places):
    """Return stamps, of the first column, numbers, what was left out, and rows without a stamp."""
    count = RawLog()
    stamps, *values = text_columns(source, layout, places, count, stamps=1)
    stamps, readable, dates = stamp_values(stamps)
    # dates are no stamps of these apps
    readable &= not dates
    values = [x.to_numpy(zero_copy_only=False)[readable] for x in values]
    return stamps[readable], values, count, np.count_nonzero(~readable)


def _sensors(file, names):
    """Return sensor, lower case -> names of its columns x, y, z."""
    found = {}
    for name in names:
        if match := _AXIS.fullmatch(name):
            # a file of one sensor may call its columns x, y, z
            own = match[1] and not re.search("linear|without", file, re.IGNORECASE)
            axes = found.setdefault((match[1] if own else file).lower(), {})
            axes.setdefault(match[2].lower(), name)
    return {sensor: [axes[a] for a in AXES] for sensor, axes in found.items() if len(axes) == 3}


def _usual(quantity, tables, notes):
    """Return the names of the three columns that the app has for a quantity, the best it has."""
    found = [
        (sensor, table)
        for sensor in _APPS[tables[0].app][2][quantity]
        for table in tables
        if sensor in table.sensors and len(table.stream.stamps)
    ]
    if not found:
        listed = ", ".join(
            f"{table.stream.name} ({', '.join(table.stream.fields)})" for table in tables
        )
        raise RejectedLog(
            f"no {quantity} found{', gravity in it' * (quantity == 'acceleration')}; the zip holds "
            f"{listed[:300]}; name it in columns.{quantity}"
        )
    best, table = found[0]
    twins = [other.stream.name for sensor, other in found if sensor == best]
    if len(twins) > 1:
        raise ImuloopError(
            f"{' and '.join(twins)} both hold {quantity}; name one in columns.{quantity}"
        )
    if len(found) > 1:
        others = ", ".join(other.stream.name for _, other in found[1:])
        notes.append(f"{quantity} is that of {table.stream.name}, not of {others}")
    return table.columns(best)
