"""Text tables: comma, tab, semicolon or blanks, with or without a header."""

import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import refuse_calibrated
from imuloop.core.units import STANDARD_GRAVITY, TIME
from imuloop.ingest.columns import STAMP, listed, resolve
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import SENSORS, guess, named_sensor, unit_of
from imuloop.ingest.stamps import stamp_array, stamp_values
from imuloop.ingest.tables import (
    doubles,
    multiplied,
    read_pair,
    table_log,
)
from imuloop.ingest.text_layout import (
    BLANKS,
    COMMENT,
    LEAST,
    LONGEST_LINE,
    MISSING,
    decoded,
    fields_of,
    find_layout,
    is_number,
    rewritten,
    unpacked,
    unreadable,
)

ENDINGS = (".csv", ".txt", ".log", ".dat", ".asc", ".gcsv")
# the table in a folder of EuRoC
IN_FOLDER = "data.csv"
# a line that may be a header
_WORDS = re.compile(rb"(?m)^[ \t]*[^\d\s+\-.,;][^\n]*")
# most texts in a column that names the sensors, and lines in which their comments stand
_KINDS, _COMMENTS = 20, 200
# zeros and erased memory become a byte that no number has, so that they spoil their own row alone
_EMPTY = b"\x01"
_ASCII = bytes(ord(_EMPTY) if i in (0, 255) else i if i < 128 else ord("?") for i in range(256))
# first line of Gyroflow's logs, and the scales stated below it, each with its parser's default
_GYROFLOW = (["GYROFLOW IMU LOG"], ["CAMERA IMU LOG"])
_SCALES = {"tscale": 1e-3, "ascale": 1.0, "gscale": 1.0}


def read(paths, columns=None):
    """Read a text table, a path or bytes; a compressed file (.gz, .bz2, ...) is unpacked.

    Of a sensor's folder of an EuRoC recording, ``imu0``, it is the table in it, whose header gives
    names and units.
    """
    path = paths["log"]
    if not isinstance(path, bytes) and Path(path).is_dir():
        path = Path(path) / IN_FOLDER
        if not path.is_file():
            raise RejectedLog(f"the folder holds no {IN_FOLDER}")
    layout = find_layout(path)
    if parts := _by_sensor(path, layout):
        return read_pair(read, parts, columns)
    refuse_calibrated(layout.names, {})
    chosen = resolve(layout.names, columns, layout.headed)
    chosen = _with_stamps(layout, chosen, "time" in (columns or {}))
    units, nominal, tick = _gyroflow(layout)
    skipped = len(layout.before) if not units else 0
    notes = [f"{skipped} line(s) before the table skipped"] if skipped else []

    known = {"units": _units_below(layout, chosen) | units, "nominal": nominal, "notes": notes}
    places, count = [*chosen.raw().values()], RawLog()
    held = text_columns(path, layout, places, count, chosen.stamps())
    log = table_log(layout.names, chosen, held, layout.headed, **known)
    log.batch = multiplied(log.batch, tick)
    log.lose(count)
    return log


def _by_sensor(source, layout):
    """Return sensor -> header and rows of it, of a table with its name in a column; else nothing.

    The header is the table's, or a comment that begins as these rows do.
    """
    for at in range(len(layout.names)):
        texts = _texts(layout.rows, at)
        if len(texts) <= _KINDS and any(map(named_sensor, texts)):
            break
    else:
        return {}
    lines = [decoded(line) for line in unpacked(source).splitlines()]
    rows = [fields_of(line, layout.separator) for line in lines if not COMMENT.match(line)]
    # one sensor's rows may all come before the other's
    names = {q: [x for x in _texts(rows, at) if named_sensor(x) == q] for q in SENSORS}
    # what the phone has not corrected goes first
    names = {q: [x for x in of if "uncal" in x.lower()] or of for q, of in names.items()}
    if any(len(of) != 1 for of in names.values()):
        return {}
    comments = [line for line in lines[:_COMMENTS] if COMMENT.match(line)]
    heads = [fields_of(COMMENT.sub("", x, count=1), layout.separator) for x in comments]
    parts = {}
    for quantity, [name] in names.items():
        own = [row for row in rows if row[at : at + 1] == [name]]
        head = [head for head in heads if head[at : at + 1] == [name]][:1]
        head = head or ([layout.names] if layout.headed else [])
        parts[quantity] = "\n".join(map(_delimiter(layout).join, head + own)).encode()
    return parts


def _texts(rows, at):
    """Return the texts in a column, those that are no numbers."""
    return {row[at] for row in rows if at < len(row) and not is_number(row[at])}


def _with_stamps(layout, chosen, declared):
    """Return the columns, without a time that is empty and not declared.

    Raise where no stamp of the first rows can be read.
    """
    at = chosen.raw().get(STAMP)
    texts = [row[at] for row in layout.rows if at is not None and at < len(row)]
    stamps = [text for text in texts if text not in MISSING]
    if texts and not stamps and not declared:
        return replace(chosen, time=None)
    if stamps and not any(map(is_number, stamps)) and not _are_stamps(stamps):
        raise ImuloopError(
            f"time column '{layout.names[at]}': '{stamps[0]}' is neither a number nor ISO 8601, a "
            "time of the day or a day such as 24-Nov-2026; name the right one in columns.time, or "
            "give columns.time: null and rate in Hz"
        )
    return chosen


def _are_stamps(texts):
    return stamp_values(stamp_array(pa.array(texts)))[1].any()


def _units_below(layout, chosen):
    """Return the units that a row below the header names."""
    # m/(s^2) has brackets in it
    names = [f"[{re.sub(r'[][(){}]', '', text)}]" for text in layout.units]
    where = {q: getattr(chosen, q) for q in ("time", *SENSORS, "temperature")}
    units = {
        q: unit_of(q, at, names, q in chosen.increments)
        for q, at in where.items()
        if names and at is not None
    }
    return {quantity: unit for quantity, unit in units.items() if unit}


def _gyroflow(layout):
    """Return units, scales of counts, and the tick, in the unit of time, of a Gyroflow log.

    Lines before its table state s, g and rad/s per count. In other logs nothing is stated, and the
    tick is 1.
    """
    said = {row[0]: row[1] for row in layout.before if len(row) == 2}
    if layout.before[:1] not in ([line] for line in _GYROFLOW) and not {*_SCALES} <= {*said}:
        return {}, {}, 1
    try:
        tick, g, rate = (float(said.get(name, usual)) for name, usual in _SCALES.items())
    except ValueError:
        return {}, {}, 1
    unit = next((name for name, scale in TIME.items() if scale == tick), None)
    nominal = {"acceleration": {"scale": g * STANDARD_GRAVITY}, "angular_rate": {"scale": rate}}
    units = {"time": unit or "s"} | dict.fromkeys(SENSORS, "count")
    return units, nominal, 1 if unit else tick


def text_columns(source, layout, positions, log, stamps=None):
    """Return columns of a text table (path or bytes).

    The first `stamps` of the columns at `positions` are stamps, as in `stamp_array`, the others
    float64; all are text if None. `log` counts bad lines and bytes.
    """
    kinds = [pa.string()] * len(positions)
    if stamps is not None:
        kinds = [_stamp_kind(layout, at) for at in positions[:stamps]]
        kinds += [pa.float64()] * len(positions[stamps:])
    text = _plain(unpacked(source)[layout.start :], layout, log)
    try:
        return _parsed(text, layout, positions, kinds, stamps, log)
    except pa.ArrowInvalid as error:
        raise unreadable(error) from error


def _stamp_kind(layout, at):
    """Return the type of stamps by the first rows: int64, float64, or text of what is no number."""
    rows = [row for row in layout.rows if len(row) == len(layout.names)]
    texts = pa.array([row[at] for row in rows if row[at] not in MISSING])
    for kind in (pa.int64(), pa.float64()):
        with suppress(pa.ArrowInvalid):
            texts.cast(kind)
            return kind
    return pa.string()


def _parsed(text, layout, positions, kinds, stamps, log):
    """Return the columns of a text; lines that are no row are counted in `log`."""
    numeric, before = stamps is not None, log.bad_lines
    try:
        columns = _columns(text, layout, positions, kinds, log)
    except pa.ArrowInvalid:
        # what is no number spoils its own row alone
        numeric = False
        columns = _columns(text, layout, positions, [pa.string()] * len(positions), log)
    if stamps and all(column.null_count for column in columns):
        # rows without a stamp and any value are none, as below the last one of a shorter sensor
        held = pa.array(np.any([column.is_valid() for column in columns], axis=0))
        columns = [column.filter(held) for column in columns]
    if log.bad_lines > before or not numeric:
        _check_headers(text, layout, positions)
    if stamps is None:
        return columns
    return [*map(stamp_array, columns[:stamps]), *map(_numbers, columns[stamps:])]


def _columns(text, layout, positions, kinds, log):
    bad_lines = []

    def bad(row):
        bad_lines.append(row.text.encode())
        return "skip"

    names = [str(i) for i in positions]
    table = pyarrow.csv.read_csv(
        pa.BufferReader(text),
        read_options=pyarrow.csv.ReadOptions(
            column_names=[str(i) for i in range(len(layout.names))],
            use_threads=False,
        ),
        parse_options=pyarrow.csv.ParseOptions(
            delimiter=_delimiter(layout), invalid_row_handler=bad
        ),
        convert_options=pyarrow.csv.ConvertOptions(
            column_types=dict(zip(names, kinds, strict=True)),
            include_columns=list(dict.fromkeys(names)),
            strings_can_be_null=True,
            null_values=list(MISSING),
            check_utf8=False,
            decimal_point="," if layout.decimal_comma else ".",
        ),
    )
    log.bad_lines += len(bad_lines)
    log.lost_bytes += sum(map(_weight, bad_lines))
    columns = [table[name].combine_chunks() for name in names]
    if layout.decimal_comma:
        columns = [
            pc.replace_substring(x, ",", ".") if x.type == pa.string() else x for x in columns
        ]
    return columns


def _delimiter(layout):
    return "\t" if layout.separator == BLANKS else layout.separator


def _check_headers(text, layout, positions):
    """Reject a text in which another header names other columns: other rows follow it."""
    for line in _WORDS.findall(text) if layout.headed else ():
        # blanks that follow each other are a tab by now
        names = fields_of(COMMENT.sub("", decoded(line), count=1), _delimiter(layout))
        if names == layout.names or len(names) < LEAST or any(map(is_number, names)):
            continue
        named, shared = guess(names), len({*names} & {*layout.names})
        known = named["acceleration"] or named["angular_rate"]
        if not known and shared < max(LEAST, len(names) / 2):
            continue
        if [names[i] for i in positions if i < len(names)] != [layout.names[i] for i in positions]:
            raise RejectedLog(
                f"a second header in the log names other columns ({listed(names)}) than the first "
                f"({listed(layout.names)}): make a log of each part"
            )


def _numbers(text):
    """Return a column of text as float64; what is no number becomes NaN."""
    try:
        return doubles(text)
    except pa.ArrowInvalid:
        return pa.array(pd.to_numeric(text.to_pandas(), errors="coerce").astype(float))


def _weight(line):
    """Return how many bytes of a line can hold anything: no zeros, erased memory or blanks."""
    # whether there is any is found ten times as fast as how many there are
    return len(line) - sum(line.count(x) for x in (_EMPTY, b" ") if x in line)


def _whole(lines):
    """Return lines without those that are too long or have an open quote, and how many these are.

    The last one may lack its line end.
    """
    ends = np.flatnonzero(np.frombuffer(lines, np.uint8) == ord("\n")) + 1
    ends = np.union1d(ends, [len(lines)])
    starts = np.append(0, ends[:-1])
    bad = ends - starts > LONGEST_LINE
    if b'"' in lines:
        bad |= [lines.count(b'"', a, b) % 2 == 1 for a, b in zip(starts, ends, strict=True)]
    if not bad.any():
        return lines, 0
    kept = zip(starts[~bad], ends[~bad], strict=True)
    return b"".join([lines[a:b] for a, b in kept]), int(bad.sum())


def _plain(text, layout, log):
    """Return the lines of a text in plain ASCII.

    Blanks that follow each other become a tab, and what the `layout` rewrites is rewritten. `log`
    counts the bytes, without empty ones, and the lines that are left out.
    """
    if not text.isascii() or b"\0" in text:
        text = text.translate(_ASCII)
    lines, bad_lines = _whole(text)
    weight = _weight(text)
    log.bad_lines += bad_lines
    log.text_bytes += weight
    log.lost_bytes += weight - _weight(lines) if bad_lines else 0
    lines = rewritten(lines, layout.rewrites)
    if layout.separator == BLANKS:
        lines = re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", lines)
        # no comma: that may be decimal
        lines = re.sub(rb"[ \t]+", b"\t", lines)
    return lines or b"\n"
