"""Zips of text tables, as phones export them: phyphox and Sensor Logger.

Android gives specific force in m/s^2. iOS gives its opposite, in g: a phone that lies face up
reads z = -1. phyphox turns that into Android's convention; Sensor Logger does so only if the user
asks it to standardise. The reader turns all into specific force.
"""

import csv
import os
import re
import zipfile
from contextlib import suppress
from pathlib import PureWindowsPath

import numpy as np
import pyarrow as pa

from imuloop.core.errors import RejectedLog, one_line
from imuloop.ingest import delimited
from imuloop.ingest.columns import STAMP
from imuloop.ingest.damage import SPREADSHEET, check_unpacked
from imuloop.ingest.formats import FORMATS
from imuloop.ingest.spellings import AXES, SENSORS, guess, named_sensor
from imuloop.ingest.streams import choose
from imuloop.ingest.tables import read_tables
from imuloop.ingest.text_layout import find_layout

# ends of the names of text tables in a zip
_TABLES = FORMATS["csv"].endings + FORMATS["tsv"].endings
# a row of phyphox's clock: separator, seconds of the experiment, and seconds since 1970
_STARTS = re.compile(rb'(?mi)^"?START"?([;,\t])([\d.,E+-]+?)\1([\d.,E+-]+?)\1')
# tables of Sensor Logger that include gravity, and their units in recordings of iOS
_WITH_GRAVITY = {"accelerometeruncalibrated": "g", "totalacceleration": "m/s^2"}


def read(paths, columns=None):
    """Return the RawLog of a zip of text tables, such as phyphox or Sensor Logger on a phone write.

    ``paths["log"]`` is the path of the zip. Uncalibrated values are preferred to values that the
    phone has corrected. Acceleration without gravity is used only if it is declared. `columns` are
    the declared columns by quantity, or None: for a sensor, the name of a file without the ending
    .csv, or three of ``FILE.COLUMN``.
    """
    texts, facts, clock = _texts(paths["log"])
    layouts = {}
    for name, text in texts.items():
        # notes of the user and headers without rows are not tables
        with suppress(RejectedLog):
            layouts[name] = find_layout(text)
    logger = any("seconds_elapsed" in layout.names for layout in layouts.values())
    columns, usual = dict(columns or {}), {quantity: [*layouts] for quantity in SENSORS}
    if len(layouts) != 1:
        usual = {quantity: _usual(quantity, layouts, logger) for quantity in SENSORS}
    names = {name: layout.names for name, layout in layouts.items()}
    tables = choose(columns, names, usual, bare=True)
    used = [*dict.fromkeys(tables.values())] or [*layouts]
    notes, unit = [f"the table{'s' * (len(used) > 1)} {' and '.join(used)} of the zip"], None
    if logger and not facts:
        notes.append("no Metadata.csv: taken as SI with Android's signs; see units.acceleration")
    if logger and facts.get("platform") == "ios" and facts.get("standardisation") != "true":
        unit = _WITH_GRAVITY.get(tables.get("acceleration", "").lower())
    if unit:
        notes.append("iOS logs the opposite of specific force: its sign is turned")
        axes = columns.get("acceleration") or AXES
        columns["acceleration"] = [f"-{axis}".replace("--", "") for axis in axes]

    def read_table(name, columns):
        """Return the RawLog of the table `name`; `columns` are its declared columns."""
        return _with_pauses(delimited.read({"log": texts[name]}, columns), clock)

    if len(used) > 1:
        log = read_tables(tables, read_table, columns)
        for quantity, name in tables.items():
            log.names[quantity] = [f"{name}.{axis}" for axis in log.names[quantity]]
    else:
        log = read_table(used[0], columns)
    log.units |= {"acceleration": unit} if unit else {}
    log.notes[:0] = notes
    return log


def _texts(path):
    """Return the text tables of a zip by name, facts about the recording, and its clock.

    `path` is the path of the zip. The first result is a dict of the tables, bytes, by name; the
    name of a CSV lacks its ending. The second is a dict of facts, text in lower case, from Sensor
    Logger's Metadata.csv. The third is phyphox's table of starts and pauses, meta/time.csv, bytes.
    The second and the third are empty if the zip has no such file.
    """
    texts, about = {}, {"Metadata": b"", "time": b""}
    with zipfile.ZipFile(path) as archive:
        check_unpacked(os.path.getsize(path), sum(x.file_size for x in archive.infolist()))
        for info in archive.infolist():
            if info.filename.startswith("xl/") or info.filename == "content.xml":
                raise RejectedLog(SPREADSHEET)
            # a path of Windows splits at / as well
            place = PureWindowsPath(info.filename)
            ending = place.suffix.lower()
            if ending not in _TABLES or place.parts[0] == "__MACOSX" or place.name[0] == ".":
                continue
            name = one_line(place.stem if ending == ".csv" else place.name)
            if name in texts:
                raise RejectedLog(f"the zip holds two files {name!r}: give one recording")
            into = about if name == "Metadata" or place.parent.name == "meta" else texts
            into[name] = archive.read(info)
    facts = about["Metadata"].decode("utf-8-sig", "replace").lower().splitlines()
    return texts, next(csv.DictReader(facts), {}), about["time"]


def _usual(quantity, tables, logger):
    """Return the names of the tables in a zip that look like tables of a sensor, a list.

    `quantity` is the quantity of the sensor, `tables` are the Layouts by name, and `logger` tells
    whether they are from Sensor Logger. If some of the tables that look like it are uncalibrated,
    only these are returned. Exception: Sensor Logger's table Accelerometer is not in the list,
    because its values lack gravity.
    """
    names = []
    for name, table in tables.items():
        header = table.names if table.headed else []
        sensors = {q for q, usual in guess(header).items() if q in SENSORS and usual}
        if len(sensors) < 2:
            sensors = {named_sensor(" ".join([name, *header]))}
        # Sensor Logger's table of this name lacks gravity
        if quantity in sensors and not (logger and name.lower() == "accelerometer"):
            names.append(name)
    return [name for name in names if "uncal" in name.lower()] or names


def _with_pauses(log, clock):
    """Return a RawLog whose time stamps include the pauses, in which phyphox stops its clock.

    `log` is the RawLog without them. `clock` is phyphox's table of events, bytes, with three
    columns: the name of the event, seconds of the experiment, and seconds since 1970.
    """
    events = [[x.replace(b",", b".") for x in row[1:]] for row in _STARTS.findall(clock)]
    starts = np.array(events, dtype=float).reshape(-1, 2)
    begun = starts[:, 1] - starts[:, 0]
    # a clock of the phone that is set back does not count as a pause
    late = np.maximum.accumulate(begun - begun[:1])
    if late.any():
        x = log.batch[STAMP].to_numpy(zero_copy_only=False)
        passed = np.searchsorted(starts[1:, 0], x)
        stamps = pa.array(np.where(passed > 0, x + late[passed], x))
        log.batch = log.batch.set_column(log.batch.schema.get_field_index(STAMP), STAMP, stamps)
        log.notes.append(
            f"paused {np.count_nonzero(np.diff(late))} times, {late[-1]:.4g} s together, in which "
            "phyphox stops its clock: its stamps go on by the phone's, to the ms"
        )
    return log
