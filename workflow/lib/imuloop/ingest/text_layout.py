"""How a text table is written: separator, header, units, decimal comma, found from its head."""

import csv
import re
from collections import Counter
from dataclasses import dataclass, field

import pyarrow as pa

from imuloop.core.errors import RejectedLog
from imuloop.ingest.columns import stated_unit

# how much of a file is looked at to find its layout, bytes
_HEAD = 1 << 16
BLANKS = " "
_SEPARATORS = (",", "\t", ";", BLANKS)
_COMMENT = re.compile(r"\s*(#|%|//)")
COMMENTED = re.compile(r"\A\s*(#|%|//)+\s*")
# columns of a sensor
AXES = 3
MISSING = ("", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "n/a")
_ISO = re.compile(r"\d{4}-\d\d-\d\d")
# how files begin that are no text, and what to do about them
_BINARY = {
    b"\x89HDF": "HDF5: format netcdf or matlab reads it where it is written as these are",
    b"\x1f\x8b": "packed by gzip: name it .csv.gz",
    b"BZh": "packed by bzip2: name it .csv.bz2",
    b"\x28\xb5\x2f\xfd": "packed by zstd: name it .csv.zst",
    b"PK\x03\x04": "a zip or a spreadsheet: save its table as CSV",
    b"\xd0\xcf\x11\xe0": "a spreadsheet: save its table as CSV",
    b"\x93NUMPY": "an array of NumPy: save it as CSV, Parquet or NetCDF",
    b"ARROW1": "an Arrow file: save it as Parquet",
}
# what the csv module takes otherwise than as a part of a field
_QUOTED = re.compile(r'["\r\n\0]')
# rows by which a separator is judged, at least
_JUDGED = 64
# a longer line is no row, bytes; what has none in its head is no table
LONGEST_LINE = _HEAD


@dataclass(frozen=True)
class Layout:
    """How a text table is written.

    Attributes
    ----------
    separator : str
        One of comma, tab, semicolon, or a blank that stands for any run of blanks.
    names : list of str
        Names of the columns; their numbers where there is no header.
    headed : bool
        Whether the names are the file's own.
    start : int
        Byte at which the rows begin.
    decimal_comma : bool
        Whether numbers have a decimal comma.
    preamble : int
        Lines before the header or the first row.
    units : list of str
        Units of the columns where a row below the header names them, else empty.
    """

    separator: str
    names: list[str]
    headed: bool
    start: int
    decimal_comma: bool
    preamble: int
    units: list[str] = field(default_factory=list)


def find_layout(path, least=3):
    """Return the layout of a text table (path or file object), from its first lines.

    Three axes are the `least` columns that a file of one sensor holds.
    """
    try:
        with pa.input_stream(path, compression="detect") as stream:
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
    # an odd step: rows of two kinds in turn both count
    table = [texts[i] for i in rows[:: len(rows) // _JUDGED | 1]]
    tried = {s: _split(table, s) for s in _SEPARATORS}
    shares = {s: _numeric_share(*tried[s], least) for s in _SEPARATORS}
    best = max(_SEPARATORS, key=shares.get)
    width = tried[best][1]
    if shares[best] < 0.5:
        raise RejectedLog("the file is not a table of numbers in rows and columns")
    # as many tabs as blanks: the blanks are inside of the header's names
    if best == BLANKS and tried["\t"][1] == width:
        best = "\t"
    first = next(i for i in rows if len(fields_of(texts[i], best)) == width)
    fields = fields_of(texts[first], best)
    names, headed = [str(i) for i in range(width)], False
    preamble = sum(1 for i in rows if i < first)
    if not any(is_number(text) for text in fields):
        names, headed, first = fields, True, first + 1
    else:
        # a header written as a comment, right before the rows
        comments = [t for t in texts[:first] if _COMMENT.match(t)]
        if comments:
            header = fields_of(COMMENTED.sub("", comments[-1]), best)
            if len(header) == width and not any(is_number(text) for text in header):
                names, headed = header, True
    units = []
    if headed and (below := [i for i in rows if i >= first]):
        fields = fields_of(texts[below[0]], best)
        if len(fields) == width and _are_units(fields):
            units, first = fields, below[0] + 1
    start = sum(len(line) + 1 for line in lines[:first])
    sample = [texts[i] for i in rows if i >= first]
    decimal_comma = not any("." in text for text in sample) and any(
        "," in field for text in sample for field in fields_of(text, best)
    )
    names = [name.strip() for name in names]
    return Layout(best, names, headed, start, decimal_comma, preamble, units)


def decoded(line):
    """Return a line as text; a degree or a square in a header may be of an older encoding."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _are_units(fields):
    """Tell whether a row below a header names units."""
    told = [field.strip("[](){} ") for field in fields]
    known = any(stated_unit(q, text) for q in ("acceleration", "angular_rate") for text in told)
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
    if not _QUOTED.search(line):
        return [field.strip() for field in line.split(separator)]
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error:
        return []


def is_number(text):
    """Tell whether a field is a number, a date, or stands for a missing one."""
    if text in MISSING or _ISO.match(text):
        return bool(text)
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _split(lines, separator):
    """Return the fields of each line, and how many the most lines have."""
    if separator != BLANKS and not any(separator in line for line in lines):
        return [[line] for line in lines], 1
    fields = [fields_of(line, separator) for line in lines]
    return fields, Counter(map(len, fields)).most_common(1)[0][0]


def _numeric_share(fields, width, least):
    """Return the share of fields that are numbers, 0 of fewer than the `least` columns."""
    if width < least:
        return 0.0
    rows = [row for row in fields if len(row) == width]
    return sum(map(_numeric, rows)) / (len(rows) * width)


def _numeric(row):
    """Return how many fields of a row are numbers."""
    try:
        # nearly every row, and much faster
        return len([float(text) for text in row])
    except ValueError:
        return sum(map(is_number, row))
