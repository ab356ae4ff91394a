"""Text tables: comma, tab, semicolon or runs of blanks, with or without a header."""

import csv
import os
import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.csv

from imuloop.core.errors import RejectedLog
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest.columns import guess, listed, resolve, stated_unit, unit_of
from imuloop.ingest.in_order import in_order
from imuloop.ingest.packed import check_unpacked
from imuloop.ingest.raw_log import STAMP, RawLog
from imuloop.ingest.stamps import stamp_array

ENDINGS = (".csv", ".txt", ".log", ".dat", ".asc")

# how much of a file is looked at to find its layout, bytes
_HEAD = 1 << 16
_BLANKS = " "
_SEPARATORS = (",", "\t", ";", _BLANKS)
_COMMENT = re.compile(r"\s*(#|%|//)")
_COMMENTED = re.compile(r"\A\s*(#|%|//)+\s*")
# columns of a sensor
_AXES = 3
_MISSING = ("", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "n/a")
_ISO = re.compile(r"\d{4}-\d\d-\d\d")
# a line that may be a header
_WORDS = re.compile(rb"(?m)^[ \t]*[^\d\s+\-.,;][^\n]*")
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
_LONGEST_LINE = _HEAD
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
        units={**chosen.units, **_units_below(layout, chosen)},
        columns=listed(layout.names, layout.headed),
    )
    if layout.preamble:
        log.notes.append(f"{layout.preamble} line(s) before the table skipped")

    exact = [i for name, i in chosen.others.items() if name.startswith("pps")]
    stamps = exact if chosen.time is None else [chosen.time, *exact]

    def parse(text):
        table, *bad = _numbers_or_text(text, layout, chosen.positions(), stamps)
        arrays = {name: numbers(table[i]) for i, name in enumerate(CHANNELS)}
        rest = iter(range(len(CHANNELS), table.num_columns))
        if chosen.time is not None:
            arrays[STAMP] = stamp_array(table[next(rest)])
        if chosen.temperature is not None:
            arrays[TEMPERATURE] = numbers(table[next(rest)])
        arrays |= {name: stamp_array(table[next(rest)]) for name in chosen.others}
        return pa.RecordBatch.from_pydict(arrays), *bad

    def batches():
        yield from _batches(path, layout, parse, batch_rows, log, log.threads)

    log.batches = batches()
    return log


def find_layout(path, least=3):
    """Return the layout of a text table (path or file object), from its first lines.

    Three axes are the `least` columns that a file of one sensor holds.
    """
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
    texts = [_decoded(line).removeprefix("\ufeff").rstrip("\r") for line in lines]
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
    if best == _BLANKS and tried["\t"][1] == width:
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
            header = _fields(_COMMENTED.sub("", comments[-1]), best)
            if len(header) == width and not any(_is_number(text) for text in header):
                names, headed = header, True
    units = []
    if headed and (below := [i for i in rows if i >= first]):
        fields = _fields(texts[below[0]], best)
        if len(fields) == width and _are_units(fields):
            units, first = fields, below[0] + 1
    start = sum(len(line) + 1 for line in lines[:first])
    sample = [texts[i] for i in rows if i >= first]
    decimal_comma = not any("." in text for text in sample) and any(
        "," in field for text in sample for field in _fields(text, best)
    )
    names = [name.strip() for name in names]
    return Layout(best, names, headed, start, decimal_comma, preamble, units)


def _decoded(line):
    """Return a line as text; a degree or a square in a header may be of an older encoding."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _are_units(fields):
    """Tell whether a row below a header names units."""
    told = [field.strip("[](){} ") for field in fields]
    known = any(stated_unit(q, text) for q in ("acceleration", "angular_rate") for text in told)
    return known and not any(map(_is_number, fields))


def _units_below(layout, chosen):
    """Return the units that a row below the header names."""
    names = [f"[{text.strip('[](){} ')}]" for text in layout.units]
    where = {q: getattr(chosen, q) for q in ("time", "acceleration", "angular_rate", "temperature")}
    told = {
        quantity: unit_of(quantity, position, names, quantity in chosen.increments)
        for quantity, position in where.items()
        if names and position is not None
    }
    return {quantity: unit for quantity, unit in told.items() if unit}


def text_batches(path, layout, positions, batch_rows, log):
    """Give the columns at `positions` as text, batch by batch, counting bad lines in `log`."""

    def parse(text):
        _check_headers(text, layout, positions)
        return _parsed(text, layout, positions, dict.fromkeys(positions, pa.string()))

    return _batches(path, layout, parse, batch_rows, log)


def _batches(source, layout, parse, batch_rows, log, threads=1):
    """Give what `parse` makes of a text, in batches; bad lines and position go to `log`."""
    path = os.fspath(source) if isinstance(source, (str, os.PathLike)) else None
    file = pa.PythonFile(source, mode="r") if path is None else pa.OSFile(path)

    def work(piece):
        text, bad_lines, lost, *read = piece
        batch, more, bytes_ = parse(text)
        return batch, bad_lines + more, lost + bytes_, *read

    with file, pa.input_stream(file, compression=path and _packing(path)) as stream:
        try:
            stream.read(layout.start)
            # any row must fit
            size = max(batch_rows * _ROW_BYTES, _LONGEST_LINE)
            pieces = _pieces(stream, path and file, size, layout.separator == _BLANKS)
            for batch, bad_lines, lost, taken, position in in_order(work, pieces, threads):
                log.bad_lines += bad_lines
                log.lost_bytes += lost
                log.text_bytes += taken
                log.position = position
                for begin in range(0, batch.num_rows, batch_rows):
                    yield batch.slice(begin, batch_rows)
        except (pa.ArrowInvalid, OSError) as error:
            raise _unreadable(error) from error


def _packing(path):
    """Return how a file is compressed, by its name; None where it is not."""
    try:
        return pa.Codec.detect(path).name
    except TypeError:
        return None


def _numbers_or_text(text, layout, positions, stamps):
    """Return columns of a text as numbers, all as text where that is not exact, and what is bad."""
    kinds = dict.fromkeys(positions, pa.float64())
    fields = text[: text.find(b"\n")].split(_delimiter(layout).encode())
    for i in stamps:
        kinds[i] = _kind(fields[i].strip() if i < len(fields) else b"")
    with suppress(pa.ArrowInvalid):
        batch, bad_lines, lost = _parsed(text, layout, positions, kinds)
        decimal = [batch[positions.index(i)] for i in stamps if kinds[i] == pa.float64()]
        decimal = [x.to_numpy(zero_copy_only=False) for x in decimal]
        # stamps that are whole numbers but for the first line's have more digits than these hold
        if all((x[np.isfinite(x)] % 1).any() for x in decimal):
            if bad_lines:
                _check_headers(text, layout, positions)
            return batch, bad_lines, lost
    _check_headers(text, layout, positions)
    return _parsed(text, layout, positions, dict.fromkeys(positions, pa.string()))


def _check_headers(text, layout, positions):
    """Reject a text in which another header names other columns: other rows follow it."""
    separator = _BLANKS if layout.separator == _BLANKS else _delimiter(layout)
    for line in _WORDS.findall(text) if layout.headed else ():
        names = _fields(_COMMENTED.sub("", _decoded(line).rstrip("\r")), separator)
        if names == layout.names or len(names) < _AXES or any(map(_is_number, names)):
            continue
        named = guess(names)
        if not (named["acceleration"] or named["angular_rate"]):
            # by names of its own
            if len({*names} & {*layout.names}) < max(_AXES, len(names) / 2):
                continue
        if [names[i] for i in positions if i < len(names)] != [layout.names[i] for i in positions]:
            raise RejectedLog(
                f"a second header in the log names other columns ({listed(names)}) than the first "
                f"({listed(layout.names)}): make a log of each part"
            )


def _kind(stamp):
    """Return the type that fits a stamp."""
    if re.fullmatch(rb"[+-]?\d+", stamp):
        return pa.int64()
    try:
        float(stamp)
    except ValueError:
        return pa.string()
    return pa.float64()


def _delimiter(layout):
    return "\t" if layout.separator == _BLANKS else layout.separator


def _parsed(text, layout, positions, kinds):
    """Return the columns of a text, of the kinds given, how many lines are no row, their bytes."""
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
            column_types={str(i): kind for i, kind in kinds.items()},
            include_columns=list(dict.fromkeys(names)),
            strings_can_be_null=True,
            null_values=list(_MISSING),
            check_utf8=False,
            decimal_point="," if layout.decimal_comma else ".",
        ),
    )
    columns = [table[name].combine_chunks() for name in names]
    if layout.decimal_comma:
        import pyarrow.compute as pc

        columns = [
            pc.replace_substring(c, ",", ".") if c.type == pa.string() else c for c in columns
        ]
    batch = pa.RecordBatch.from_arrays(columns, names=[str(i) for i in range(len(names))])
    return batch, bad_lines, lost


def doubles(column):
    """Return a column as float64; what is missing becomes NaN."""
    # nothing to do where nothing is missing: arrow's functions take long to import
    if column.type != pa.float64():
        # whole numbers of more than 53 bits are rounded
        column = column.cast(pa.float64(), safe=False)
    return column.fill_null(float("nan")) if column.null_count else column


def numbers(text):
    """Return a column of text as float64; what is no number becomes NaN."""
    try:
        return doubles(text)
    except pa.ArrowInvalid:
        # takes longer to import than all the rest, and few logs need it
        import pandas as pd

        return pa.array(pd.to_numeric(text.to_pandas(), errors="coerce").astype(float))


def _unreadable(error):
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
        return f"the first line is longer than {_LONGEST_LINE >> 10} kB: no table"
    # every second byte, or three of four
    if start.count(0) > 0.4 * len(start):
        if start.replace(b"\0", b"").decode("latin-1").replace("\n", "").isprintable():
            return "the text looks like UTF-16 or UTF-32: save it as UTF-8"
        return "the file is binary, no text: format: names what it is, see docs/formats.md"
    return None


def _fields(line, separator):
    if separator == _BLANKS:
        return line.split()
    if not _QUOTED.search(line):
        return [field.strip() for field in line.split(separator)]
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


def _split(lines, separator):
    """Return the fields of each line, and how many the most lines have."""
    if separator != _BLANKS and not any(separator in line for line in lines):
        return [[line] for line in lines], 1
    fields = [_fields(line, separator) for line in lines]
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
        return sum(map(_is_number, row))


# bytes that no number has, so that damaged ones spoil their own row alone
_EMPTY = b"\x01"
_ASCII = bytes(ord(_EMPTY) if i in (0, 255) else i if i < 128 else ord("?") for i in range(256))


def _weight(line):
    """Return how many bytes of a line can hold anything: no zeros, erased memory or blanks."""
    return len(line) - line.count(_EMPTY) - line.count(b" ")


def _pieces(stream, file, size, squeeze):
    """Give the lines of a stream in plain ASCII, some `size` bytes at once.

    Left out are lines that are too long and those with an open quote. Runs of blanks become
    tabs if `squeeze`; `file` is what the stream comes out of, None where that is of no concern.

    Yields
    ------
    text : bytes
        Whole lines, at least one.
    bad_lines, lost : int
        Lines left out, and bytes in them.
    taken : int
        Bytes of the text read, empty ones left out.
    position : int
        Bytes of the file read so far.
    """
    rest, taken, written, bad_lines, lost, ended = b"", 0, 0, 0, 0, False
    while not ended:
        piece = stream.read(size)
        taken += len(piece)
        if file:
            check_unpacked(file.size(), taken)
        ended = not piece
        if not piece.isascii() or b"\0" in piece:
            piece = piece.translate(_ASCII)
        written += _weight(piece)
        text, begin, kept = rest + piece, 0, []
        # from the last line end within reach to the next one
        while len(text) - begin > _LONGEST_LINE:
            end = text.rfind(b"\n", begin, begin + _LONGEST_LINE) + 1
            if end:
                kept.append(text[begin:end])
            elif end := text.find(b"\n", begin) + 1:
                bad_lines += 1
                lost += _weight(text[begin:end])
            else:
                break
            begin = end
        last = len(text) if ended else text.rfind(b"\n", begin) + 1 or begin
        if last - begin > _LONGEST_LINE:
            bad_lines += 1
            lost += _weight(text[begin:last])
        else:
            kept.append(text[begin:last])
        # enough of a line to tell that it is too long
        rest = text[last : last + _LONGEST_LINE + 1]
        lost += _weight(text[last + _LONGEST_LINE + 1 :])
        lines = b"".join(kept)
        if b'"' in lines:
            rows = lines.splitlines(keepends=True)
            whole = [row for row in rows if row.count(b'"') % 2 == 0]
            bad_lines += len(rows) - len(whole)
            lost += _weight(lines)
            lines = b"".join(whole)
            lost -= _weight(lines)
        if squeeze:
            lines = re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", lines)
            # no comma: that may be decimal
            lines = re.sub(rb"[ \t]+", b"\t", lines)
        if lines or bad_lines:
            yield lines or b"\n", bad_lines, lost, written, file.tell() if file else taken
            bad_lines = lost = written = 0
