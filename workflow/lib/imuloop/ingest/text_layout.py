"""The layout of a text table by its first bytes: separator, header, units, decimal sign."""

import csv
import re
from collections import Counter
from dataclasses import dataclass
from operator import itemgetter

import pyarrow as pa

from imuloop.core.errors import RejectedLog
from imuloop.ingest.damage import LONGEST_LINE, check_unpacked
from imuloop.ingest.spellings import AXES, SENSORS, guess, stated_unit

BLANKS = " "
_SEPARATORS = (",", "\t", ";", "|", BLANKS)
COMMENT = re.compile(r"\s*(#|%|//)+\s*")
# number of columns of a sensor
LEAST = len(AXES)
MISSING = ["", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "n/a"]
_DATE = re.compile(r"\d{4}[-/]\d\d[-/]\d\d|\d{1,2}-[A-Za-z]{3}-\d{4}")
# a serial monitor puts its time of the day before each line
_ARROW = re.compile(rb"(?m)^[ \t]*(\d{1,2}:\d\d:\d\d\.\d+) -> ([^\r\n]*)")
# a name before a value, as for a serial plotter: AccelX:0.06
_LABEL = re.compile(rb"[A-Za-z_][\w .]{,40}[:=][ \t]*(?=[-+.\d])")
_PACKINGS = {b"\x1f\x8b": "gzip", b"BZh": "bz2", b"\x28\xb5\x2f\xfd": "zstd", b"\4\x22M\x18": "lz4"}
_BINARY = "the file is binary, or UTF-16: save it as UTF-8, or give format: NAME"
_NO_ROWS = "the file has no rows, or lines alone that begin as comments do, with #, % or //"
_NO_TABLE = "the file is not a table of numbers in rows and columns: save it as CSV"
# how a document of JSON begins
_JSON = re.compile(rb"\s*(\{\s*\"|\[\s*[{\[])")
JSON_DOCUMENT = (
    "the file is one JSON document: write JSON lines, an object with the numbers of a sample per "
    "line, or CSV"
)


@dataclass(frozen=True)
class Layout:
    """The layout of a text table.

    - `separator`: a comma, tab, semicolon, bar, or a blank that stands for any number of blanks;
    - `names`: names of the columns, which are numbers if the file has no names;
    - `headed`: whether the file has names of columns;
    - `start`: number of the byte at which the rows begin;
    - `before`: fields of each line before header and rows;
    - `units`: units in a row below the header, or empty;
    - `rewrites`: pairs (pattern, replacement) that are applied to all lines in this order: a
      decimal comma becomes a point, several blanks become a tab;
    - `rows`: fields of each of the first rows.
    """

    separator: str
    names: list[str]
    headed: bool
    start: int
    before: list[list[str]]
    units: list[str]
    rewrites: list[tuple]
    rows: list[list[str]]


def find_layout(source, least=LEAST):
    """Return the Layout of a text table: separator, names and units of its columns, and so on.

    `source` is the path of the table or its text as bytes, and `least` the least number of columns.
    Raises a RejectedLog if it is not a table with at least this number.
    """
    head = next(parts_of(source, LONGEST_LINE), b"")
    # the last line may be cut off
    lines = head.split(b"\n")[: -1 if len(head) == LONGEST_LINE else None]
    # in UTF-16 and UTF-32 one of two, or three of four, bytes of most texts are zero
    if head[:256].count(0) > 0.4 * len(head[:256]):
        raise RejectedLog(_BINARY)
    arrow = sum(map(bool, map(_ARROW.match, lines))) > len(lines) / 2
    bare = [_ARROW.sub(rb"\2", line) for line in lines] if arrow else lines
    labels = Counter(tuple(x.strip(b" \t:=").decode() for x in _LABEL.findall(x)) for x in bare)
    labels, count = max(labels.items(), key=itemgetter(1), default=((), 0))
    rewrites = [(_LABEL, b"")] * (count > len(lines) / 2 and len({*labels}) >= least)
    texts = [decoded(_LABEL.sub(b"", x) if rewrites else x).strip("\ufeff\r") for x in bare]
    filled = [i for i, text in enumerate(texts) if text.strip() and not COMMENT.match(text)]
    if lines and not filled:
        raise RejectedLog(_NO_ROWS)
    separator, width, rows = _rows([texts[i] for i in filled], least)
    if not rows:
        raise RejectedLog(JSON_DOCUMENT if _JSON.match(head) else _NO_TABLE)
    # rows of the table's width before the first of them that holds a number are its header
    wide = [k for k, row in enumerate(rows) if len(row) == width]
    first = next((k for k in wide if any(map(is_number, rows[k]))), wide[0])
    top = [k for k in wide if k < first]
    begin = top[-1] + 1 if top else first
    start = filled[begin]
    comments = [text for text in texts[:start] if COMMENT.match(text)]
    comment = fields_of(COMMENT.sub("", comments[-1], count=1), separator) if comments else []
    # a comment with blanks between its words may be prose
    if (separator == BLANKS and not any(guess(comment).values())) or any(map(is_number, comment)):
        comment = []
    options = (labels if rewrites else (), *(rows[k] for k in top[:1]), comment)
    names = next((names for names in options if len(names) == width), None)
    units = [rows[k] for k in top[1:] if any(stated_unit(q, x) for q in SENSORS for x in rows[k])]
    if arrow:
        # the time becomes the last column
        rewrites.append((_ARROW, rb"\2" + separator.encode() + rb"\1"))
    # dates are left out: their point does not show how other numbers are written
    numbers = [x for row in rows[begin:] for x in row if is_number(x) and not _DATE.match(x)]
    if any("," in x for x in numbers) and not any("." in x for x in numbers) and separator != ",":
        rewrites.append((b",", b"."))
    if separator == BLANKS:
        rewrites += [(rb"(?m)^[ \t]+|[ \t\r]+$", b""), (rb"[ \t]+", b"\t")]
    return Layout(
        separator=separator,
        names=[*(names or map(str, range(width))), *["time"] * arrow],
        headed=names is not None,
        start=sum(len(line) + 1 for line in lines[:start]),
        before=rows[: (top or [first])[0]],
        units=[*units[0], *[""] * arrow] if units else [],
        rewrites=rewrites,
        rows=rows[begin:],
    )


def parts_of(source, size):
    """Yield the content of a file, unpacked if it is compressed, in parts of `size` bytes.

    `source` is the path of the file, or its content as bytes. Raises a RejectedLog if the file
    cannot be read to its end.
    """
    source = pa.py_buffer(source) if isinstance(source, bytes) else source
    try:
        with pa.input_stream(source, compression=None) as file:
            head, packed, unpacked = file.read(max(map(len, _PACKINGS))), file.size(), 0
        packing = next((name for start, name in _PACKINGS.items() if head.startswith(start)), None)
        with pa.input_stream(source, compression=packing) as file:
            while part := file.read(size):
                unpacked += len(part)
                check_unpacked(packed, unpacked)
                yield part
    except OSError as error:
        raise unreadable(error) from error


def unreadable(error):
    """Return the RejectedLog of a file whose reading ended in an exception, `error`."""
    return RejectedLog(f"the file cannot be read to its end: {str(error).splitlines()[0]}")


def _rows(lines, least):
    """Return the separator with which most fields of lines are numbers, the width, and the rows.

    `lines` are the texts. The first result is a text. The second, the width, is the number of
    fields that most lines have, at least `least`. The third is a list of rows, a list of fields for
    each line. If the lines are not a table, the results are an empty text, 0 and an empty list.
    """
    best = 0.0, "", 0, []
    for separator in _SEPARATORS if lines else ():
        rows = [fields_of(line, separator) for line in lines]
        width, alike = Counter(map(len, rows)).most_common(1)[0]
        # rows of several kinds, which differ in their number of fields, are a table too
        long = [row for row in rows if len(row) >= least]
        fields = [text for row in long for text in row if text]
        numeric = sum(map(is_number, fields)) / max(1, len(fields)) * len(long) / len(rows)
        # blanks count less: names and dates may contain them, and fields between tabs may be empty
        score = numeric * (1 + alike / len(rows)) * (0.9 if separator == BLANKS else 1.0)
        if width >= least and numeric >= 0.5 and score > best[0]:
            best = score, separator, width, rows
    return best[1:]


def decoded(line):
    """Return a line, bytes, as text: UTF-8, or Latin-1, which older headers may have."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def fields_of(line, separator):
    """Return the fields of a `line` of a table, a list of text; empty if its quotes do not fit.

    `separator` is the separator of fields, as in `Layout`.
    """
    if separator == BLANKS:
        return line.split()
    try:
        [fields] = csv.reader([line], delimiter=separator, skipinitialspace=True)
    except (csv.Error, ValueError):
        return []
    return [field.strip() for field in fields]


def is_number(text):
    """Return whether `text`, a field, is a number, a date, or a text for a missing number."""
    if text in MISSING or _DATE.match(text):
        return bool(text)
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True
