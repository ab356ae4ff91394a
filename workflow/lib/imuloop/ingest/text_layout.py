"""How a text table is written: separator, header, units, decimal comma, found from its head."""

import csv
import re
from collections import Counter
from dataclasses import dataclass, field

import pyarrow as pa

from imuloop.core.errors import RejectedLog
from imuloop.ingest.columns import AXES, guess, stated_unit

# how much of a file is looked at to find its layout, bytes
_HEAD = 1 << 16
# a longer line is no row, bytes; what has none in its head is no table
LONGEST_LINE = _HEAD
BLANKS = " "
_SEPARATORS = (",", "\t", ";", BLANKS)
_COMMENT = re.compile(r"\s*(#|%|//)")
COMMENTED = re.compile(r"\A\s*(#|%|//)+\s*")
# columns of a sensor
LEAST = len(AXES)
MISSING = ("", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "n/a")
_DATE = re.compile(r"\d{4}[-/]\d\d[-/]\d\d|\d{1,2}-[A-Za-z]{3}-\d{4}")
# what a serial monitor puts before each line: its time of the day
_ARROW = re.compile(r"\s*\d{1,2}:\d\d:\d\d\.\d+ -> ")
ARROW = re.compile(rb"(?m)^[ \t]*(\d{1,2}:\d\d:\d\d\.\d+) -> ([^\r\n]*)")
# how files begin that are no text, and what to do about them
_BINARY = {
    b"\x1f\x8b": "packed by gzip: name it .csv.gz",
    b"PK\x03\x04": "a zip or a spreadsheet: save its table as CSV",
    b"\xd0\xcf\x11\xe0": "a spreadsheet: save its table as CSV",
}
# rows by which a separator is judged, at least
_JUDGED = 64
# most rows of names and units below the first
_HEADERS = 3


@dataclass(frozen=True)
class Layout:
    """How a text table is written.

    `separator` is a comma, tab, semicolon, or a blank that stands for any run of blanks; `names`
    are numbers where the file has none (`headed`); rows begin at the byte `start`, `preamble` lines
    come before header or rows; `units` are those of a row below the header, else empty. With an
    `arrow` each line begins with a time and an arrow: that time is the last column. `rows` are the
    fields of the first rows.
    """

    separator: str
    names: list[str]
    headed: bool
    start: int
    decimal_comma: bool
    preamble: int
    units: list[str] = field(default_factory=list)
    arrow: bool = False
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
    texts = [decoded(line).removeprefix("\ufeff").rstrip("\r") for line in lines]
    rows = [i for i, text in enumerate(texts) if text.strip() and not _COMMENT.match(text)]
    if not rows:
        raise RejectedLog("the file has no rows; record or copy it again")
    arrow = sum(bool(_ARROW.match(texts[i])) for i in rows) > len(rows) / 2
    if arrow:
        texts = [_ARROW.sub("", text) for text in texts]
        rows = [i for i in rows if texts[i].strip()]
    separator, width = _separator([texts[i] for i in rows], least)

    def fields(i):
        return fields_of(texts[i], separator)

    first = next(i for i in rows if len(fields(i)) == width)
    preamble = sum(1 for i in rows if i < first)
    names, units = None, []
    if not any(map(is_number, fields(first))):
        names, first = fields(first), first + 1
    elif comments := [t for t in texts[:first] if _COMMENT.match(t)]:
        # a header written as a comment, right before the rows
        header = fields_of(COMMENTED.sub("", comments[-1]), separator)
        named = any(guess(header).values()) or {*AXES} <= {name[:1].lower() for name in header}
        # between blanks it may be prose
        named = named or separator != BLANKS
        if named and len(header) == width and not any(map(is_number, header)):
            names = header
    for i in [i for i in rows if i >= first][: _HEADERS if names else 0]:
        more = fields(i)
        if units or len(more) != width or any(map(is_number, more)) or not any(more):
            break
        first = i + 1
        if _are_units(more):
            units = more
        elif more != names:
            names = _joined(names, more)
    # the point of a date is not that of the numbers beside it
    sample = [text for i in rows if i >= first for text in fields(i) if not _DATE.match(text)]
    numbers = "".join(filter(is_number, sample))
    decimal_comma = "." not in numbers and "," in numbers
    known = [name.strip() for name in names] if names else [str(i) for i in range(width)]
    return Layout(
        separator=separator,
        names=[*known, *["time"] * arrow],
        headed=names is not None,
        start=sum(len(line) + 1 for line in lines[:first]),
        decimal_comma=decimal_comma,
        preamble=preamble,
        units=[*units, *[""] * (arrow and bool(units))],
        arrow=arrow,
        rows=[fields(i) for i in rows if i >= first],
    )


def opened(source):
    """Return the text of a file, unpacked, or of bytes, as a stream."""
    held = isinstance(source, bytes)
    return pa.input_stream(pa.py_buffer(source) if held else source, compression="detect")


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
        # rows of several kinds, each with a number of fields of its own, are a table too
        table = [row for row in table if len(row) >= least]
        given = [text for row in table for text in row if text]
        alike = sum(len(row) == width for row in table) / len(rows)
        numeric = sum(map(is_number, given)) / max(1, len(given)) * len(table) / len(rows)
        numeric = numbers[separator] = numeric if width >= least else 0.0
        shares[separator] = numeric * (1 + alike) / 2
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
    """Tell whether a row below a header names units."""
    texts = [field.strip("[](){} ") for field in fields]
    known = any(stated_unit(q, text) for q in ("acceleration", "angular_rate") for text in texts)
    return known and not any(map(is_number, fields))


def unreadable(error):
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


def fields_of(line, separator):
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


def is_number(text):
    """Tell whether a field is a number, a date, or stands for a missing one."""
    if text in MISSING or _DATE.match(text):
        return bool(text)
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True
