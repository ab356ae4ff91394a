"""How a text table is written: separator, header, units, decimal comma, found from its head."""

import csv
import os
import re
from collections import Counter
from dataclasses import dataclass, field

import pyarrow as pa
import pyarrow.csv

from imuloop.core.errors import RejectedLog, one_line
from imuloop.ingest.damage import check_unpacked
from imuloop.ingest.spellings import AXES, SENSORS, guess, stated_unit

# how much of a file is looked at to find its layout, bytes
_HEAD = 1 << 16
# a longer line is no row, bytes; what has none in its head is no table
LONGEST_LINE = _HEAD
BLANKS = " "
_SEPARATORS = (",", "\t", ";", "|", BLANKS)
COMMENT = re.compile(r"\s*(#|%|//)+\s*")
# columns of a sensor
LEAST = len(AXES)
MISSING = ("", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "n/a")
_DATE = re.compile(r"\d{4}[-/]\d\d[-/]\d\d|\d{1,2}-[A-Za-z]{3}-\d{4}")
# what a serial monitor puts before each line: its time of the day
_ARROW = re.compile(rb"(?m)^[ \t]*(\d{1,2}:\d\d:\d\d\.\d+) -> ([^\r\n]*)")
# a name before a value, as for a serial plotter: AccelX:0.06
_LABEL = re.compile(rb"[A-Za-z_][\w .]*[:=][ \t]*(?=[-+.\d])")
# how files begin that hold no log of any format, and what to do about them
SPREADSHEET = "the file is a spreadsheet, such as Excel's: save its table as CSV"
NO_LOGS = {
    b"\xd0\xcf\x11\xe0": SPREADSHEET,
    b"version https://git-lfs.github.com/": (
        "the file is a pointer of Git LFS, not the log that it stands for: fetch that with git lfs "
        "pull"
    ),
}
# and files that are no text
_UTF16 = "the text is UTF-16 or UTF-32: save it as UTF-8"
_BINARY = NO_LOGS | {
    b"\x1f\x8b": "the file is packed by gzip: name it .csv.gz",
    b"PK\x03\x04": "the file is a zip or a spreadsheet: save its table as CSV",
    **dict.fromkeys((b"\xff\xfe", b"\xfe\xff", b"\0\0\xfe\xff"), _UTF16),
}
# and how a document of JSON begins
_JSON = re.compile(r"\s*(\{\s*\"|\[\s*[{\[])")
JSON_DOCUMENT = (
    "the file is one JSON document: write JSON lines, an object with the numbers of a sample per "
    "line, or CSV"
)
# rows by which a separator is judged, at least; most rows of names and units below the first
_JUDGED, _HEADERS = 64, 3


@dataclass(frozen=True)
class Layout:
    """How a text table is written.

    `separator` is a comma, tab, semicolon, or a blank that stands for any number of blanks; `names`
    are numbers where the file has none (`headed`); rows begin at the byte `start`, `before` are the
    fields of lines before header and rows; `units` are those of a row below the header, else empty;
    `rows` are the fields of the first rows. In all lines each pattern of `rewrites` gives place to
    its replacement, in this order.
    """

    separator: str
    names: list[str]
    headed: bool
    start: int
    decimal_comma: bool
    before: list[list[str]]
    units: list[str] = field(default_factory=list)
    rewrites: list[tuple] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)


def find_layout(path, least=LEAST):
    """Return the layout of a text table of `least` columns or more (path or bytes)."""
    try:
        with opened(path) as stream:
            head = stream.read(_HEAD)
    except OSError as error:
        raise unreadable(error) from error
    if fault := _no_text(head):
        raise RejectedLog(fault)
    lines = head.split(b"\n")
    if len(head) == _HEAD:
        lines.pop()
    arrow = sum(map(bool, map(_ARROW.match, lines))) > len(lines) / 2
    rewrites = [(_ARROW, rb"\2")] * arrow
    bare = [rewritten(line, rewrites) for line in lines]
    labels = [[x.strip(b" \t:=").decode() for x in _LABEL.findall(line)] for line in bare]
    labelled = sum(len({*each}) >= least for each in labels) > len(lines) / 2
    if labelled:
        rewrites.insert(0, (_LABEL, b""))
        bare = [_LABEL.sub(b"", line) for line in bare]
    texts = [decoded(line).removeprefix("\ufeff").rstrip("\r") for line in bare]
    rows = [i for i, text in enumerate(texts) if text.strip() and not COMMENT.match(text)]
    if not rows:
        said = next((one_line(text)[:60] for text in texts if text.strip()), None)
        fault = (
            said and f"no rows but lines that begin as comments do: '{said}'; take #, % or // away"
        )
        raise RejectedLog(f"the file has {fault or 'no rows; record or copy it again'}")
    try:
        separator, width = _separator([texts[i] for i in rows], least)
    except RejectedLog:
        if _JSON.match(decoded(head)):
            raise RejectedLog(JSON_DOCUMENT) from None
        raise
    fields = {i: fields_of(texts[i], separator) for i in rows}
    first = next(i for i in rows if len(fields[i]) == width)
    before = [fields[i] for i in rows if i < first]
    names, units = None, []
    if labelled:
        names = next((each for each in labels if len(each) == width), None)
    elif not any(map(is_number, fields[first])):
        names, first = fields[first], first + 1
    elif comments := [text for text in texts[:first] if COMMENT.match(text)]:
        names = _commented_header(comments[-1], separator, width)
    for i in [i for i in rows if i >= first][: _HEADERS if names else 0]:
        more = fields[i]
        if units or len(more) != width or any(map(is_number, more)):
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
    if arrow:
        # the time becomes the last column
        rewrites[-1] = _ARROW, rb"\2" + separator.encode() + rb"\1"

    def in_numbers(mark):
        # the point of a date is not that of the numbers beside it
        given = (x for row in rows for x in row if mark in x)
        return any(is_number(x) and not _DATE.match(x) for x in given)

    return Layout(
        separator=separator,
        names=[*(names or map(str, range(width))), *["time"] * arrow],
        headed=names is not None,
        start=sum(len(line) + 1 for line in lines[:first]),
        decimal_comma=in_numbers(",") and not in_numbers("."),
        before=before,
        units=units,
        rewrites=rewrites,
        rows=rows,
    )


def rewritten(text, rewrites):
    """Return a text in which each pattern gives place to its replacement, in turn."""
    for pattern, replacement in rewrites:
        text = pattern.sub(replacement, text)
    return text


def opened(source):
    """Return the text of a file, unpacked, or of bytes, as a stream."""
    held = isinstance(source, bytes)
    return pa.input_stream(pa.py_buffer(source) if held else source, compression="detect")


def unpacked(source):
    """Return all of the text of a file, unpacked, or of bytes."""
    packed = len(source) if isinstance(source, bytes) else os.path.getsize(source)
    parts, size = [], 0
    try:
        with opened(source) as stream:
            while part := stream.read(1 << 22):
                parts.append(part)
                size += len(part)
                check_unpacked(packed, size)
    except OSError as error:
        raise unreadable(error) from error
    return b"".join(parts)


def _commented_header(comment, separator, width):
    """Return the names of a header that is a comment right before the rows, or None."""
    names = fields_of(COMMENT.sub("", comment, count=1), separator)
    # between blanks it may be prose
    prose = separator == BLANKS and not (
        any(guess(names).values()) or {*AXES} <= {name[:1].lower() for name in names}
    )
    return None if prose or len(names) != width or any(map(is_number, names)) else names


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
        table = [fields_of(row, separator) for row in rows]
        width = widths[separator] = Counter(map(len, table)).most_common(1)[0][0]
        # rows of several kinds, each with a number of its own fields, are a table too
        given = [text for row in table if len(row) >= least for text in row if text]
        long = sum(len(row) >= least for row in table) / len(rows)
        alike = sum(len(row) == width for row in table) / len(rows)
        numeric = sum(map(is_number, given)) / max(1, len(given)) * long
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


def decoded(line):
    """Return a line as text; a degree or a square in a header may be of an older encoding."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _are_units(fields):
    """Tell whether a row below a header, without numbers, names units."""
    texts = [field.strip("[](){} ") for field in fields]
    return any(stated_unit(quantity, text) for quantity in SENSORS for text in texts)


def unreadable(error):
    """Return the rejection of a file whose reading ended in an error."""
    return RejectedLog(f"the file cannot be read to its end: {str(error).splitlines()[0]}")


def _no_text(head):
    """Return why a file that begins like this is no text in lines, or None."""
    for signature, fault in _BINARY.items():
        if head.startswith(signature):
            return fault
    if len(head) == _HEAD and b"\n" not in head:
        if _JSON.match(decoded(head)):
            return JSON_DOCUMENT
        return f"the first line is longer than {LONGEST_LINE >> 10} kB: no table"
    # every second byte, or three of four
    if head[:256].count(0) > 0.4 * len(head[:256]):
        return (
            "the file is binary, or text in UTF-16: save it as UTF-8, or give format: NAME, see "
            "docs/formats.md"
        )
    return None


def fields_of(line, separator):
    """Return the fields of a line, none where its quotes do not fit."""
    if separator == BLANKS:
        return line.split()
    # the csv module takes a line end or a zero otherwise than as a part of a field
    if '"' not in line:
        return [field.strip() for field in line.split(separator)]
    try:
        quoted = csv.reader([line], delimiter=separator, skipinitialspace=True)
        return [field.strip() for field in next(quoted, [])]
    except csv.Error:
        return []


def is_number(text):
    """Tell whether a field is a number, a date, or stands for a missing one."""
    # most are, and of a head every field is asked
    if _is_float(text):
        return True
    if text in MISSING or _DATE.match(text):
        return bool(text)
    return _is_float(text.replace(",", "."))


def _is_float(text):
    try:
        float(text)
    except ValueError:
        return False
    return True
