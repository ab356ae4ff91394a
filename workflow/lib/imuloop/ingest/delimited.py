"""Text tables: comma, tab, semicolon or runs of blanks, with or without a header."""

import csv
import os
import re
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from imuloop.core.errors import ImuloopError, RejectedLog, one_line
from imuloop.core.samples import ACCELERATION, refuse_calibrated
from imuloop.ingest.columns import (
    AXES,
    SENSORS,
    STAMP,
    guess,
    listed,
    named_sensor,
    resolve,
    stated_unit,
    unit_of,
)
from imuloop.ingest.guarded import MOST_TIMES, check_unpacked
from imuloop.ingest.ordered_map import ordered_map
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.stamps import stamp_array, stamp_values
from imuloop.ingest.tables import (
    HEAD_ROWS,
    alone,
    doubles,
    first_rows,
    in_turn,
    named_batches,
    paired,
    table_log,
    two_streams,
)

ENDINGS = (".csv", ".txt", ".log", ".dat", ".asc")
# the table in a folder of EuRoC
IN_FOLDER = "data.csv"

# how much of a file is looked at to find its layout, bytes
_HEAD = 1 << 16
# a longer line is no row, bytes; what has none in its head is no table
LONGEST_LINE = _HEAD
BLANKS = " "
_SEPARATORS = (",", "\t", ";", BLANKS)
_COMMENT = re.compile(r"\s*(#|%|//)+\s*")
# columns of a sensor
LEAST = len(AXES)
MISSING = ("", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "n/a")
_DATE = re.compile(r"\d{4}[-/]\d\d[-/]\d\d|\d{1,2}-[A-Za-z]{3}-\d{4}")
# what a serial monitor puts before each line: its time of the day
_ARROW = re.compile(rb"(?m)^[ \t]*(\d{1,2}:\d\d:\d\d\.\d+) -> ([^\r\n]*)")
# a name before a value, as for a serial plotter: AccelX:0.06
_LABEL = re.compile(rb"[A-Za-z_][\w .]*[:=][ \t]*(?=[-+.\d])")
# how files begin that are no text, and what to do about them
_BINARY = {
    b"\x1f\x8b": "packed by gzip: name it .csv.gz",
    b"PK\x03\x04": "a zip or a spreadsheet: save its table as CSV",
    b"\xd0\xcf\x11\xe0": "a spreadsheet: save its table as CSV",
}
# rows by which a separator is judged, at least; most rows of names and units below the first
_JUDGED, _HEADERS = 64, 3
# a line that may be a header
_WORDS = re.compile(rb"(?m)^[ \t]*[^\d\s+\-.,;][^\n]*")
# most texts in a column that names the sensors, and lines in which their comments stand
_KINDS, _COMMENTS = 20, 200
# typical length of a row, bytes: turns rows a batch into bytes a block
_ROW_BYTES = 64
# zeros and erased memory become a byte that no number has, so that they spoil their own row alone
_EMPTY = b"\x01"
_ASCII = bytes(ord(_EMPTY) if i in (0, 255) else i if i < 128 else ord("?") for i in range(256))


# --- how a table is written


@dataclass(frozen=True)
class Layout:
    """How a text table is written.

    `separator` is a comma, tab, semicolon, or a blank that stands for any run of blanks; `names`
    are numbers where the file has none (`headed`); rows begin at the byte `start`, `preamble` lines
    come before header or rows; `units` are those of a row below the header, else empty; `rows` are
    the fields of the first rows. With an `arrow` each line begins with a time and an arrow: that
    time is the last column; where `labelled`, the name of each value stands before it.
    """

    separator: str
    names: list[str]
    headed: bool
    start: int
    decimal_comma: bool
    preamble: int
    units: list[str] = field(default_factory=list)
    arrow: bool = False
    labelled: bool = False
    rows: list[list[str]] = field(default_factory=list)


def find_layout(path, least=LEAST):
    """Return the layout of a text table of `least` columns or more (path or bytes)."""
    try:
        with _opened(path) as stream:
            head = stream.read(_HEAD)
    except OSError as error:
        raise _unreadable(error) from error
    if fault := _no_text(head):
        raise RejectedLog(fault)
    lines = head.split(b"\n")
    if len(head) == _HEAD:
        lines.pop()
    arrow = sum(map(bool, map(_ARROW.match, lines))) > len(lines) / 2
    bare = [_ARROW.sub(rb"\2", line) for line in lines] if arrow else lines
    labels = [[x.strip(b" \t:=").decode() for x in _LABEL.findall(line)] for line in bare]
    labelled = sum(len({*each}) >= least for each in labels) > len(lines) / 2
    bare = [_LABEL.sub(b"", line) for line in bare] if labelled else bare
    texts = [_decoded(line).removeprefix("\ufeff").rstrip("\r") for line in bare]
    rows = [i for i, text in enumerate(texts) if text.strip() and not _COMMENT.match(text)]
    if not rows:
        said = next((one_line(text)[:60] for text in texts if text.strip()), None)
        fault = (
            said and f"no rows but lines that begin as comments do: '{said}'; take #, % or // away"
        )
        raise RejectedLog(f"the file has {fault or 'no rows; record or copy it again'}")
    separator, width = _separator([texts[i] for i in rows], least)
    fields = {i: _fields_of(texts[i], separator) for i in rows}
    first = next(i for i in rows if len(fields[i]) == width)
    preamble = rows.index(first)
    names, units = None, []
    if labelled:
        names = next((each for each in labels if len(each) == width), None)
    elif not any(map(_is_number, fields[first])):
        names, first = fields[first], first + 1
    elif comments := [text for text in texts[:first] if _COMMENT.match(text)]:
        names = _commented_header(comments[-1], separator, width)
    for i in [i for i in rows if i >= first][: _HEADERS if names else 0]:
        more = fields[i]
        if units or len(more) != width or any(map(_is_number, more)):
            break
        letters = {text[:1].lower() for text in more} | {text[-1:].lower() for text in more}
        if _are_units(more):
            units = [*more, *[""] * arrow]
        elif {*AXES} <= letters:
            names = _joined(names, more) if more != names else names
        else:
            # what is neither units nor axes costs its line
            break
        first = i + 1
    rows = [fields[i] for i in rows if i >= first]
    # the point of a date is not that of the numbers beside it
    numbers = "".join(x for row in rows for x in row if _is_number(x) and not _DATE.match(x))
    return Layout(
        separator=separator,
        names=[*(names or map(str, range(width))), *["time"] * arrow],
        headed=names is not None,
        start=sum(len(line) + 1 for line in lines[:first]),
        decimal_comma="." not in numbers and "," in numbers,
        preamble=preamble,
        units=units,
        arrow=arrow,
        labelled=labelled,
        rows=rows,
    )


def _opened(source):
    """Return the text of a file, unpacked, or of bytes, as a stream."""
    held = isinstance(source, bytes)
    return pa.input_stream(pa.py_buffer(source) if held else source, compression="detect")


def _size(source):
    return len(source) if isinstance(source, bytes) else os.path.getsize(source)


def _commented_header(comment, separator, width):
    """Return the names of a header that is a comment right before the rows, or None."""
    names = _fields_of(_COMMENT.sub("", comment, count=1), separator)
    # between blanks it may be prose
    prose = separator == BLANKS and not (
        any(guess(names).values()) or {*AXES} <= {name[:1].lower() for name in names}
    )
    return None if prose or len(names) != width or any(map(_is_number, names)) else names


def _joined(names, more):
    """Return names of two rows: one above several columns is that of each."""
    above, found = "", []
    for name, part in zip(names, more, strict=True):
        above = name or above
        found.append(f"{above} {part}".strip())
    return found


def _separator(rows, least):
    """Return the separator by which the most fields are numbers, and the fields in a row."""
    # an odd step: rows of two kinds in turn both count
    rows = rows[:: len(rows) // _JUDGED | 1]
    numbers, shares, widths = {}, {}, {}
    for separator in _SEPARATORS:
        table = [_fields_of(row, separator) for row in rows]
        width = widths[separator] = Counter(map(len, table)).most_common(1)[0][0]
        # rows of several kinds, each with a number of fields of its own, are a table too
        given = [text for row in table if len(row) >= least for text in row if text]
        long = sum(len(row) >= least for row in table) / len(rows)
        alike = sum(len(row) == width for row in table) / len(rows)
        numeric = sum(map(_is_number, given)) / max(1, len(given)) * long
        numbers[separator] = numeric if width >= least else 0.0
        shares[separator] = numbers[separator] * (1 + alike) / 2
    best = max(_SEPARATORS, key=shares.get)
    if numbers[best] < 0.5:
        raise RejectedLog(
            "the file is not a table of numbers in rows and columns; save it as CSV, a sample per "
            "line"
        )
    # blanks may be inside of a header's names, or of dates, and fields between tabs empty
    if best == BLANKS and shares["\t"] > 0.9 * shares[best]:
        best = "\t"
    return best, widths[best]


def _decoded(line):
    """Return a line as text; a degree or a square in a header may be of an older encoding."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _are_units(fields):
    """Tell whether a row below a header, without numbers, names units."""
    texts = [field.strip("[](){} ") for field in fields]
    return any(stated_unit(quantity, text) for quantity in SENSORS for text in texts)


def _unreadable(error):
    """Return the rejection of a file whose reading ended in an error."""
    return RejectedLog(f"the file cannot be read to its end: {str(error).splitlines()[0]}")


def _no_text(head):
    """Return why a file that begins like this is no text in lines, or None."""
    for mark in ("utf-32", "utf-16"):
        if head.startswith(("\ufeff".encode(f"{mark}-le"), "\ufeff".encode(f"{mark}-be"))):
            return f"the text is {mark.upper()}: save it as UTF-8 (iconv -f {mark} -t utf-8)"
    for signature, what in _BINARY.items():
        if head.startswith(signature):
            return f"the file is {what}"
    start = head[:256]
    if start and not start.strip(b"\0"):
        return "the file begins with zeros: no table"
    if len(head) == _HEAD and b"\n" not in head:
        return f"the first line is longer than {LONGEST_LINE >> 10} kB: no table"
    # every second byte, or three of four
    if start.count(0) > 0.4 * len(start):
        if start.replace(b"\0", b"").decode("latin-1").replace("\n", "").isprintable():
            return "the text looks like UTF-16 or UTF-32: save it as UTF-8"
        return "the file is binary, no text: format: names what it is, see docs/formats.md"
    return None


def _fields_of(line, separator):
    """Return the fields of a line, none where its quotes do not fit."""
    if separator == BLANKS:
        return line.split()
    try:
        # the csv module takes a line end or a zero otherwise than as a part of a field
        quoted = csv.reader([line], delimiter=separator, skipinitialspace=True)
        rows = quoted if '"' in line else iter([line.split(separator)])
        return [field.strip() for field in next(rows, [])]
    except csv.Error:
        return []


def _is_number(text):
    """Tell whether a field is a number, a date, or stands for a missing one."""
    if text in MISSING or _DATE.match(text):
        return bool(text)
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


# --- its columns


# columns of a table whose acceleration has the opposite sign, as of LPMS: face up it reads -1 g
OPPOSITE = ("SensorId", "TimeStamp (s)", "FrameNumber", "AccX (g)")


def read(paths, columns=None, batch_rows=1 << 16):
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
        logs = {q: read({"log": text}, alone(q, columns), batch_rows) for q, text in parts.items()}
        return paired(logs, batch_rows)
    refuse_calibrated(layout.names, {})
    chosen = resolve(layout.names, columns, layout.headed)
    _check_stamps(layout, chosen)
    notes = [f"{layout.preamble} line(s) before the table skipped"] if layout.preamble else []
    if {*OPPOSITE} <= {*layout.names} and "acceleration" not in (columns or {}):
        chosen = replace(chosen, turned=frozenset(ACCELERATION))
        notes.append("a table of LPMS: the sign of its acceleration is turned: specific force")

    def batches(log, rows):
        places = [*chosen.raw().values()]
        read = text_batches(path, layout, places, rows, log, chosen.stamps())
        return named_batches(layout.names, chosen, read)

    units = _units_below(layout, chosen)
    log = table_log(layout.names, chosen, (), layout.headed, units=units, notes=notes)
    log.batches = batches(log, batch_rows)
    head, _ = first_rows(batches(RawLog(), HEAD_ROWS))
    lacks = in_turn(head)
    return two_streams(log, lacks) if lacks else log


def _by_sensor(source, layout):
    """Return sensor -> header and rows of it, of a table with its name in a column; else nothing.

    The header is the table's, or a comment that begins as these rows do.
    """
    for at in range(len(layout.names)):
        texts = {row[at] for row in layout.rows if at < len(row) and not _is_number(row[at])}
        names = {q: [text for text in texts if named_sensor(text) == q] for q in SENSORS}
        # what the phone has not corrected goes first
        names = {q: [x for x in of if "uncal" in x.lower()] or of for q, of in names.items()}
        if len(texts) <= _KINDS and all(len(of) == 1 for of in names.values()):
            break
    else:
        return {}
    with _opened(source) as stream:
        text = stream.read(MOST_TIMES * _size(source) + 1)
    check_unpacked(_size(source), len(text))
    lines = [_decoded(line) for line in text.splitlines()]
    rows = [_fields_of(line, layout.separator) for line in lines]
    comments = [line for line in lines[:_COMMENTS] if _COMMENT.match(line)]
    heads = [_fields_of(_COMMENT.sub("", x, count=1), layout.separator) for x in comments]
    parts = {}
    for quantity, [name] in names.items():
        own = [row for row in rows if row[at : at + 1] == [name]]
        head = [head for head in heads if head[at : at + 1] == [name]][:1]
        head = head or ([layout.names] if layout.headed else [])
        parts[quantity] = "\n".join(map(_delimiter(layout).join, head + own)).encode()
    return parts


def _check_stamps(layout, chosen):
    """Raise where no stamp of the first rows can be read."""
    at = chosen.raw().get(STAMP)
    texts = [row[at] for row in layout.rows if at is not None and at < len(row)]
    texts = [text for text in texts if text not in MISSING]
    if not texts or any(map(_is_number, texts)):
        return
    if not stamp_values(stamp_array(pa.array(texts)))[1].any():
        raise ImuloopError(
            f"time column '{layout.names[at]}': '{texts[0]}' is neither a number nor ISO 8601, a "
            "time of the day or a day such as 24-Nov-2026; name the right one in columns.time, or "
            "give columns.time: null and rate in Hz"
        )


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


# --- its rows


def text_batches(source, layout, positions, batch_rows, log, stamps=None):
    """Give columns of a text table (path or bytes), at most `batch_rows` rows at once.

    The first `stamps` of the columns at `positions` are stamps, as of `stamp_array`, the others
    float64; all are text if None. `log` counts bad lines and bytes, and has the number of threads.
    """

    def work(piece):
        text, bad_lines, lost, taken = piece
        batch, more, bytes_ = _parsed(text, layout, positions, stamps)
        return batch, bad_lines + more, lost + bytes_, taken

    try:
        with _opened(source) as stream:
            stream.read(layout.start)
            # any row must fit
            size = max(batch_rows * _ROW_BYTES, LONGEST_LINE)
            pieces = _pieces(stream, _size(source), size, layout)
            for batch, bad_lines, lost, taken in ordered_map(work, pieces, log.threads):
                log.bad_lines += bad_lines
                log.lost_bytes += lost
                log.text_bytes += taken
                for begin in range(0, batch.num_rows, batch_rows):
                    yield batch.slice(begin, batch_rows)
    except (pa.ArrowInvalid, OSError) as error:
        raise _unreadable(error) from error


def _parsed(text, layout, positions, stamps):
    """Return the columns of a text, how many lines are no row, and the bytes of these."""
    as_text = [pa.string()] * len(positions)
    kinds = as_text if stamps is None else as_text[:stamps] + [pa.float64()] * len(as_text[stamps:])
    numeric = stamps is not None
    try:
        columns, bad_lines, lost = _columns(text, layout, positions, kinds)
    except pa.ArrowInvalid:
        # what is no number spoils its own row alone
        numeric = False
        columns, bad_lines, lost = _columns(text, layout, positions, as_text)
    if bad_lines or not numeric:
        _check_headers(text, layout, positions)
    if stamps is not None:
        columns = [*map(stamp_array, columns[:stamps]), *map(_numbers, columns[stamps:])]
    return pa.RecordBatch.from_arrays(columns, [*map(str, range(len(columns)))]), bad_lines, lost


def _columns(text, layout, positions, kinds):
    bad_lines = lost = 0

    def bad(row):
        nonlocal bad_lines, lost
        bad_lines += 1
        lost += _weight(row.text.encode())
        return "skip"

    names = [str(i) for i in positions]
    table = pyarrow.csv.read_csv(
        pa.BufferReader(text),
        read_options=pyarrow.csv.ReadOptions(
            column_names=[str(i) for i in range(len(layout.names))],
            block_size=len(text),
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
    columns = [table[name].combine_chunks() for name in names]
    if layout.decimal_comma:
        columns = [
            pc.replace_substring(x, ",", ".") if x.type == pa.string() else x for x in columns
        ]
    return columns, bad_lines, lost


def _delimiter(layout):
    return "\t" if layout.separator == BLANKS else layout.separator


def _check_headers(text, layout, positions):
    """Reject a text in which another header names other columns: other rows follow it."""
    for line in _WORDS.findall(text) if layout.headed else ():
        # runs of blanks are tabs by now
        names = _fields_of(_COMMENT.sub("", _decoded(line), count=1), _delimiter(layout))
        if names == layout.names or len(names) < LEAST or any(map(_is_number, names)):
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
    return len(line) - line.count(_EMPTY) - line.count(b" ")


def _whole(lines):
    """Return lines without those that are too long or have an open quote, and how many these are.

    The last one may lack its line end.
    """
    ends = np.flatnonzero(np.frombuffer(lines, np.uint8) == ord("\n")) + 1
    if lines and not lines.endswith(b"\n"):
        ends = np.append(ends, len(lines))
    starts = np.append(0, ends[:-1])[: len(ends)]
    bad = ends - starts > LONGEST_LINE
    if b'"' in lines:
        bad |= [lines.count(b'"', a, b) % 2 == 1 for a, b in zip(starts, ends, strict=True)]
    if not bad.any():
        return lines, 0
    kept = zip(starts[~bad], ends[~bad], strict=True)
    return b"".join([lines[a:b] for a, b in kept]), int(bad.sum())


def _pieces(stream, packed, size, layout):
    """Give the lines of a stream in plain ASCII, some `size` bytes at once.

    Runs of blanks become tabs, the time before an arrow the last field, as of the `layout`; the
    stream comes out of `packed` bytes. With the text, whole lines, come the number of lines left
    out and the bytes in them, and bytes of the text read, empty ones left out.
    """
    rest, taken, written, lost, ended = b"", 0, 0, 0, False
    while not ended:
        piece = stream.read(size)
        taken += len(piece)
        check_unpacked(packed, taken)
        ended = not piece
        if not piece.isascii() or b"\0" in piece:
            piece = piece.translate(_ASCII)
        written += _weight(piece)
        text = rest + piece
        end = len(text) if ended else text.rfind(b"\n") + 1
        head = text[:end]
        lines, bad_lines = _whole(head)
        # enough of a line to show that it is too long
        rest = text[end : end + LONGEST_LINE + 1]
        lost += _weight(text[end + LONGEST_LINE + 1 :])
        if bad_lines:
            lost += _weight(head) - _weight(lines)
        if layout.labelled:
            lines = _LABEL.sub(b"", lines)
        if layout.arrow:
            lines = _ARROW.sub(rb"\2" + layout.separator.encode() + rb"\1", lines)
        if layout.separator == BLANKS:
            lines = re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", lines)
            # no comma: that may be decimal
            lines = re.sub(rb"[ \t]+", b"\t", lines)
        if lines or bad_lines:
            yield lines or b"\n", bad_lines, lost, written
            lost = written = 0
