"""Text tables: comma, tab, semicolon or runs of blanks, with or without a header."""

import os
import re
from contextlib import suppress

import numpy as np
import pyarrow as pa
import pyarrow.csv

from imuloop.core.errors import RejectedLog
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest.columns import guess, listed, resolve, unit_of
from imuloop.ingest.in_order import in_order
from imuloop.ingest.packed import check_unpacked
from imuloop.ingest.raw_log import STAMP, RawLog
from imuloop.ingest.stamps import stamp_array
from imuloop.ingest.text_layout import (
    AXES,
    BLANKS,
    COMMENTED,
    LONGEST_LINE,
    MISSING,
    decoded,
    fields_of,
    find_layout,
    is_number,
    unreadable,
)

ENDINGS = (".csv", ".txt", ".log", ".dat", ".asc")

# a line that may be a header
_WORDS = re.compile(rb"(?m)^[ \t]*[^\d\s+\-.,;][^\n]*")
# typical length of a row, bytes: turns rows a batch into bytes a block
_ROW_BYTES = 64


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
            size = max(batch_rows * _ROW_BYTES, LONGEST_LINE)
            pieces = _pieces(stream, path and file, size, layout.separator == BLANKS)
            for batch, bad_lines, lost, taken, position in in_order(work, pieces, threads):
                log.bad_lines += bad_lines
                log.lost_bytes += lost
                log.text_bytes += taken
                log.position = position
                for begin in range(0, batch.num_rows, batch_rows):
                    yield batch.slice(begin, batch_rows)
        except (pa.ArrowInvalid, OSError) as error:
            raise unreadable(error) from error


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
    separator = BLANKS if layout.separator == BLANKS else _delimiter(layout)
    for line in _WORDS.findall(text) if layout.headed else ():
        names = fields_of(COMMENTED.sub("", decoded(line).rstrip("\r")), separator)
        if names == layout.names or len(names) < AXES or any(map(is_number, names)):
            continue
        named = guess(names)
        if not (named["acceleration"] or named["angular_rate"]):
            # by names of its own
            if len({*names} & {*layout.names}) < max(AXES, len(names) / 2):
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
    return "\t" if layout.separator == BLANKS else layout.separator


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
            null_values=list(MISSING),
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
        while len(text) - begin > LONGEST_LINE:
            end = text.rfind(b"\n", begin, begin + LONGEST_LINE) + 1
            if end:
                kept.append(text[begin:end])
            elif end := text.find(b"\n", begin) + 1:
                bad_lines += 1
                lost += _weight(text[begin:end])
            else:
                break
            begin = end
        last = len(text) if ended else text.rfind(b"\n", begin) + 1 or begin
        if last - begin > LONGEST_LINE:
            bad_lines += 1
            lost += _weight(text[begin:last])
        else:
            kept.append(text[begin:last])
        # enough of a line to tell that it is too long
        rest = text[last : last + LONGEST_LINE + 1]
        lost += _weight(text[last + LONGEST_LINE + 1 :])
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
