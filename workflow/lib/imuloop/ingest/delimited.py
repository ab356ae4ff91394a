"""Text tables: comma, tab, semicolon or runs of blanks, with or without a header."""

import csv
import os
import re
from collections import Counter
from dataclasses import dataclass

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from imuloop.core.errors import RejectedLog
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest.columns import resolve
from imuloop.ingest.packed import check_unpacked
from imuloop.ingest.raw_log import STAMP, RawLog
from imuloop.ingest.stamps import parse_stamps

ENDINGS = (".csv", ".txt", ".log", ".dat", ".asc")

# how much of a file is looked at to find its layout, bytes
_HEAD = 1 << 16
_BLANKS = " "
_SEPARATORS = (",", "\t", ";", _BLANKS)
_COMMENT = re.compile(r"\s*(#|%|//)")
_MISSING = ("", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "n/a")
_ISO = re.compile(r"\d{4}-\d\d-\d\d")
# a longer line is no row, bytes; what has none in its head is no table
_LONGEST_LINE = _HEAD
# how much is read at once, bytes
_PIECE = 1 << 20
# typical length of a row, bytes: turns rows a batch into bytes a block
_ROW_BYTES = 64


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
    """

    separator: str
    names: list[str]
    headed: bool
    start: int
    decimal_comma: bool
    preamble: int


def read(paths, columns=None, batch_rows=1 << 16):
    """Read a text table.

    Parameters
    ----------
    paths : dict
        ``{"log": path}``; a compressed file (.gz, .bz2, ...) is unpacked on the way.
    columns : dict, optional
        Quantity to columns, by name or number; see `imuloop.ingest.columns.resolve`.
    batch_rows : int
        Rows held at once, about.

    Raises
    ------
    ImuloopError
        If a declared column is not there.
    RejectedLog
        If the file is no table of numbers.
    """
    path = paths["log"]
    layout = find_layout(path)
    chosen = resolve(layout.names, columns, layout.headed)
    log = RawLog(
        batches=iter(()),
        temperature=chosen.temperature is not None,
        found=chosen.found(layout.names),
        units=dict(chosen.units),
    )
    if layout.preamble:
        log.notes.append(f"{layout.preamble} line(s) before the table skipped")

    def batches():
        for text in text_batches(path, layout, chosen.positions(), batch_rows, log):
            arrays = {name: numbers(text[i]) for i, name in enumerate(CHANNELS)}
            rest = iter(range(len(CHANNELS), text.num_columns))
            if chosen.time is not None:
                arrays[STAMP] = parse_stamps(text[next(rest)])
            if chosen.temperature is not None:
                arrays[TEMPERATURE] = numbers(text[next(rest)])
            yield pa.RecordBatch.from_pydict(arrays)

    log.batches = batches()
    return log


def find_layout(path):
    """Return the layout of a text table (path or file object), from its first lines."""
    try:
        with pa.input_stream(path, compression="detect") as stream:
            head = stream.read(_HEAD)
    except OSError as error:
        raise _unreadable(error) from error
    if fault := _no_text(head):
        raise RejectedLog(fault)
    lines = head.split(b"\n")
    if len(head) == _HEAD:
        lines.pop()
    texts = [line.decode("utf-8-sig", "replace").rstrip("\r") for line in lines]
    rows = [i for i, text in enumerate(texts) if text.strip() and not _COMMENT.match(text)]
    if not rows:
        raise RejectedLog("the file has no rows")
    table = [texts[i] for i in rows]
    best = max(_SEPARATORS, key=lambda s: _numeric_share(table, s))
    if _numeric_share(table, best) < 0.5:
        raise RejectedLog("the file is not a table of numbers in rows and columns")
    width = _width(table, best)
    # as many tabs as blanks: the blanks are inside of the header's names
    if best == _BLANKS and _width(table, "\t") == width:
        best = "\t"
    first = next(i for i in rows if len(_fields(texts[i], best)) == width)
    fields = _fields(texts[first], best)
    names, headed = [str(i) for i in range(width)], False
    preamble = sum(1 for i in rows if i < first)
    if not any(_is_number(text) for text in fields):
        names, headed, first = fields, True, first + 1
    else:
        # a header written as a comment, right before the rows
        comments = [t for t in texts[:first] if _COMMENT.match(t)]
        if comments:
            header = _fields(re.sub(r"^\s*(#|%|//)+\s*", "", comments[-1]), best)
            if len(header) == width and not any(_is_number(text) for text in header):
                names, headed = header, True
    start = sum(len(line) + 1 for line in lines[:first])
    sample = [text for i in rows if i >= first for text in _fields(texts[i], best)]
    decimal_comma = any("," in text for text in sample) and not any("." in t for t in sample)
    return Layout(best, [n.strip() for n in names], headed, start, decimal_comma, preamble)


def text_batches(path, layout, positions, batch_rows, log):
    """Give the columns at `positions` as text, batch by batch, counting bad lines in `log`."""

    def bad(row):
        log.bad_lines += 1
        return "skip"

    every = [str(i) for i in range(len(layout.names))]
    wanted = [str(i) for i in positions]
    blanks = layout.separator == _BLANKS
    # who gives a file object bounds what it unpacks
    packed = os.path.getsize(path) if isinstance(path, (str, os.PathLike)) else None
    stream = pa.input_stream(path, compression="detect")
    with stream:
        stream.read(layout.start)
        try:
            reader = pyarrow.csv.open_csv(
                pa.PythonFile(_Cleaned(stream, blanks, packed, log), mode="r"),
                read_options=pyarrow.csv.ReadOptions(
                    column_names=every,
                    # any row must fit
                    block_size=max(batch_rows * _ROW_BYTES, _LONGEST_LINE),
                    use_threads=False,
                ),
                parse_options=pyarrow.csv.ParseOptions(
                    delimiter="," if blanks else layout.separator, invalid_row_handler=bad
                ),
                convert_options=pyarrow.csv.ConvertOptions(
                    column_types=dict.fromkeys(wanted, pa.string()),
                    include_columns=list(dict.fromkeys(wanted)),
                    strings_can_be_null=True,
                    null_values=list(_MISSING),
                    check_utf8=False,
                ),
            )
            for batch in reader:
                text = [_point(batch.column(name), layout) for name in wanted]
                names = [str(i) for i in range(len(wanted))]
                table = pa.RecordBatch.from_arrays(text, names=names)
                for begin in range(0, table.num_rows, batch_rows):
                    yield table.slice(begin, batch_rows)
        except (pa.ArrowInvalid, OSError) as error:
            raise _unreadable(error) from error


def numbers(text):
    """Return a column of text as float64; what is no number becomes NaN."""
    try:
        return pc.fill_null(pc.cast(text, pa.float64()), float("nan"))
    except pa.ArrowInvalid:
        return pa.array(pd.to_numeric(text.to_pandas(), errors="coerce").astype(float))


def _point(text, layout):
    return pc.replace_substring(text, ",", ".") if layout.decimal_comma else text


def _unreadable(error):
    return RejectedLog(f"the file cannot be read to its end: {str(error).splitlines()[0]}")


def _no_text(head):
    """Return why a file that begins like this is no text in lines, or None."""
    for mark in ("utf-32", "utf-16"):
        if head.startswith(("\ufeff".encode(f"{mark}-le"), "\ufeff".encode(f"{mark}-be"))):
            return f"the text is {mark.upper()}: save it as UTF-8 (iconv -f {mark} -t utf-8)"
    start = head[:256]
    if start and not start.strip(b"\0"):
        return "the file begins with zeros: no table"
    if len(head) == _HEAD and b"\n" not in head:
        return f"the first line is longer than {_LONGEST_LINE >> 10} kB: no table"
    # every second byte, or three of four
    if start.count(0) > 0.4 * len(start):
        return "the text looks like UTF-16 or UTF-32: save it as UTF-8"
    return None


def _fields(line, separator):
    if separator == _BLANKS:
        return line.split()
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error:
        return []


def _is_number(text):
    if text in _MISSING or _ISO.match(text):
        return bool(text)
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _width(lines, separator):
    return Counter(len(_fields(line, separator)) for line in lines).most_common(1)[0][0]


def _numeric_share(lines, separator):
    """Return the share of fields that are numbers, 0 if the lines have no six columns."""
    fields = [_fields(line, separator) for line in lines]
    width = Counter(len(row) for row in fields).most_common(1)[0][0]
    # three axes and a time are the least that a file of one sensor holds
    if width < 3:
        return 0.0
    flat = [text for row in fields if len(row) == width for text in row]
    return sum(_is_number(text) for text in flat) / len(flat)


# bytes that no number has, so that damaged ones spoil their own row alone
_ASCII = bytes(i if 0 < i < 128 else ord("?") for i in range(256))


class _Cleaned:
    """A stream in plain ASCII without the lines that are no row, piece by piece.

    Left out, and counted in `log`, are lines that are too long and those with an open quote.
    Runs of blanks become commas if `squeeze`; `packed` is the size of the file that it comes out
    of, None where that is of no concern.
    """

    closed = False

    def __init__(self, stream, squeeze, packed, log):
        self._stream, self._squeeze, self._packed, self._log = stream, squeeze, packed, log
        self._rest, self._ready, self._taken, self._ended = b"", b"", 0, False

    def _take(self):
        piece = self._stream.read(_PIECE)
        self._taken += len(piece)
        if self._packed is not None:
            check_unpacked(self._packed, self._taken)
        self._ended = not piece
        return piece.translate(_ASCII)

    def _lines(self):
        """Return the next whole lines, perhaps none."""
        text, begin, kept = self._rest + self._take(), 0, []
        # from the last line end within reach to the next one
        while len(text) - begin > _LONGEST_LINE:
            end = text.rfind(b"\n", begin, begin + _LONGEST_LINE) + 1
            if end:
                kept.append(text[begin:end])
            elif end := text.find(b"\n", begin) + 1:
                self._log.bad_lines += 1
            else:
                break
            begin = end
        last = len(text) if self._ended else text.rfind(b"\n", begin) + 1 or begin
        if last - begin > _LONGEST_LINE:
            self._log.bad_lines += 1
        else:
            kept.append(text[begin:last])
        # enough of a line to tell that it is too long
        self._rest = text[last : last + _LONGEST_LINE + 1]
        lines = b"".join(kept)
        if b'"' in lines:
            rows = lines.splitlines(keepends=True)
            whole = [row for row in rows if row.count(b'"') % 2 == 0]
            self._log.bad_lines += len(rows) - len(whole)
            lines = b"".join(whole)
        if self._squeeze:
            lines = re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", lines)
            lines = re.sub(rb"[ \t]+", b",", lines)
        return lines

    def read(self, size=-1):
        """Return `size` bytes, fewer at the end only: so that every row lies in two blocks."""
        while not self._ended and (size is None or size < 0 or len(self._ready) < size):
            self._ready += self._lines()
        size = len(self._ready) if size is None or size < 0 else size
        head, self._ready = self._ready[:size], self._ready[size:]
        return head

    def close(self):
        """Leave the closing to who opened the stream."""
        self.closed = True
