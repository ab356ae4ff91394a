"""Text tables: fields between commas, tabs, semicolons or blanks, with or without a header."""

import re
from contextlib import suppress
from itertools import chain, pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv

from imuloop.core.errors import RejectedLog
from imuloop.core.samples import refuse_calibrated
from imuloop.core.units import TIME, raw_unit
from imuloop.ingest.columns import STAMP, listed, resolve
from imuloop.ingest.formats import IN_FOLDER
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import SENSORS, TABLE, names_device
from imuloop.ingest.stamps import no_stamps, stamp_array
from imuloop.ingest.tables import doubles, table_log
from imuloop.ingest.text_layout import (
    BLANKS,
    COMMENT,
    MISSING,
    decoded,
    fields_of,
    find_layout,
    parts_of,
    unreadable,
)

# a line with a quote that is not closed
_OPEN_QUOTE = re.compile(rb'(?m)^[^"\n]*+(?:"[^"\n]*+"[^"\n]*+)*+"[^"\n]*+$')
# lines of comments amid the rows
_COMMENTS = re.compile(rb"(?m)^[ \t]*(?:#|%|//).*\n?")
# number of bytes that are parsed at once
_BLOCK = 1 << 22
# bytes of zeros and of erased memory become one that no number has, so that only their row is lost
_EMPTY = b"\x01"
_ASCII = bytes(ord(_EMPTY) if i in (0, 255) else i if i < 128 else ord("?") for i in range(256))


def read(paths, columns=None):
    """Return the RawLog of a text table, the log as it was read.

    ``paths["log"]`` is the path of the table or its text as bytes; a compressed file (.gz, .bz2 and
    so on) is unpacked. If the path is the folder of a sensor in an EuRoC recording, such as
    ``imu0``, the table is the file `IN_FOLDER` in it. `columns` are the declared columns by
    quantity, or None.
    """
    path = paths["log"]
    if not isinstance(path, bytes) and Path(path).is_dir():
        path = Path(path) / IN_FOLDER
        if not path.is_file():
            raise RejectedLog(f"the folder holds no {IN_FOLDER}")
    layout = find_layout(path)
    refuse_calibrated(layout.names, {})
    chosen, counts = resolve(layout.names, columns, layout.headed, layout.units), RawLog()
    _refuse_devices(layout, chosen)
    units, nominal, tick = _scaled(layout, chosen.units)
    skipped = f"{len(layout.before)} line(s) before the table skipped"
    notes = [skipped] * bool(layout.before and not nominal)
    arrays = text_columns(path, layout, [*chosen.raw.values()], counts, chosen.stamps)
    facts = {"nominal": nominal, "notes": notes}
    log = table_log(layout.names, chosen, arrays, layout.headed, tick, units, **facts)
    log.lose(counts)
    if STAMP in log.batch.schema.names:
        texts, stamps = _texts(layout, chosen.places["time"][0]), log.batch[STAMP]
        if texts and 0 < stamps.null_count == len(stamps):
            raise no_stamps(stamps, log.names["time"], texts)
    return log


def _refuse_devices(layout, chosen):
    """Raise a RejectedLog if a column shows that the rows are of several devices in turn.

    `layout` is the Layout of the table, and `chosen` are the Columns that are read. Only the first
    rows of the table are looked at, and of these only rows in which the sensors have values that
    are not zero.
    """
    rows = [[*row, *[""] * len(layout.names)] for row in layout.rows]
    for sensor in {*SENSORS} & {*chosen.places}:
        axes = chosen.places[sensor]
        rows = [row for row in rows if {row[at].strip("+-0.,") for at in axes} - {*MISSING}]
    for at, name in enumerate(layout.names):
        ids = [row[at] for row in rows if row[at]] if names_device(name) else []
        if 1 < len({*ids}) <= sum(one != other for one, other in pairwise(ids)):
            raise RejectedLog(
                f"the rows are of several devices in turn, as column '{name}' says "
                f"({listed([*dict.fromkeys(ids)])}): split the log, so that each file holds one "
                "device"
            )


def _scaled(layout, units):
    """Return the units of a text table, the scales of its counts, and the tick of its time stamps.

    The first result is a dict of units by quantity. The second is a dict by quantity of the scales
    of counts, dicts as in `RawLog.nominal`. The third, the tick, is the factor by which time stamps
    are multiplied to be in the unit of time. A unit that is a multiple of a known unit, such as
    mdeg/s, becomes a count with a scale. Lines above the header may also state scales. `layout` is
    the Layout of the table, and `units` are the units by quantity that the table states.
    """
    multiples = {q: TABLE["multiples"].get(q, {}).get(unit) for q, unit in units.items()}
    scales = {quantity: multiple for quantity, multiple in multiples.items() if multiple}
    said = {row[0]: row[1] for row in layout.before if len(row) == 2}
    if not {*said}.isdisjoint(TABLE["scales"]):
        with suppress(ValueError):
            for name, (quantity, unit, usual) in TABLE["scales"].items():
                scales[quantity] = float(said.get(name, usual)), unit
    tick, unit = scales.pop("time", (1, None))
    if unit:
        tick *= TIME[unit]
        whole = next((name for name, scale in TIME.items() if scale == tick), None)
        units, tick = units | {"time": whole or "s"}, 1 if whole else tick
    nominal = {q: {"scale": scale * raw_unit(q, unit).scale} for q, (scale, unit) in scales.items()}
    return units | dict.fromkeys(scales, "count"), nominal, tick


def text_columns(source, layout, positions, log, stamps):
    """Return some columns of a text table, a list of Arrow arrays.

    `positions` are their positions in the table, from 0. `source` is the path of the table or its
    text as bytes, and `layout` its Layout. The first `stamps` columns, a number, are time stamps,
    int64, float64 or timestamp[ns]; the following ones are float64. Bad lines and their bytes are
    counted in the RawLog `log`. In a table with time stamps, rows in which all of these columns are
    missing are left out, as at the end of the columns of a slower sensor. Raises a RejectedLog if
    the text cannot be parsed.
    """
    every, names = [str(at) for at in range(len(layout.names))], [str(at) for at in positions]
    # the size of a block is no limit, so that no line is longer than one
    reading = csv.ReadOptions(column_names=every, block_size=_BLOCK, use_threads=False)
    kinds = [_stamp_kind(layout, at) for at in positions[:stamps]]
    kinds += [pa.float64()] * len(positions[stamps:])
    # if there is text among the numbers, read all as text, so that only the rows with it are lost
    for types in (kinds, [pa.string()] * len(positions)):
        weights, lost = [], []
        parsing = csv.ParseOptions(
            delimiter="\t" if layout.separator == BLANKS else layout.separator,
            invalid_row_handler=lambda row, lost=lost: lost.append(row.text.encode()) or "skip",
        )
        converting = csv.ConvertOptions(
            column_types=dict(zip(names, types, strict=True)),
            include_columns=[*dict.fromkeys(names)],
            null_values=MISSING,
            strings_can_be_null=True,
            check_utf8=False,
        )
        blocks = _blocks(source, layout, weights)
        file = SimpleNamespace(read=lambda size, x=blocks: next(x, b""), closed=False)
        try:
            columns = _joined(csv.open_csv(file, reading, parsing, converting))
            break
        except pa.ArrowInvalid as error:
            fault = error
    else:
        raise unreadable(fault)
    columns = [columns[name] for name in names]
    if types is not kinds:
        _refuse_header(layout, positions, columns)
    log.bad_lines += len(lost)
    log.lost_bytes += sum(map(_weight, lost))
    log.text_bytes += sum(weights)
    if stamps and all(column.null_count for column in columns):
        # drop rows with neither stamp nor value, as at the end of the columns of a slower sensor
        rows = pa.array(np.any([column.is_valid() for column in columns], axis=0))
        columns = [column.filter(rows) for column in columns]
    return [*map(stamp_array, columns[:stamps]), *map(_numbers, columns[stamps:])]


def _joined(batches):
    """Return the columns of a text table, a dict of Arrow arrays by name.

    `batches` is pyarrow's reader of the blocks of the table. The values of each block are appended
    to one array per column of numbers, so that the table is not in memory twice.
    """
    fields, count = {field.name: field.type for field in batches.schema}, 0
    numbers = {name: np.empty(0) for name, kind in fields.items() if kind == pa.float64()}
    others = {name: [] for name in fields if name not in numbers}
    for batch in batches:
        count += batch.num_rows
        for name, values in numbers.items():
            values.resize(count, refcheck=False)
            values[count - batch.num_rows :] = batch[name].to_numpy(zero_copy_only=False)
        for name, arrays in others.items():
            arrays.append(batch[name])
    columns = {name: pa.array(values, from_pandas=True) for name, values in numbers.items()}
    for name, arrays in others.items():
        columns[name] = pa.chunked_array(arrays, fields[name]).combine_chunks()
    return columns


def _texts(layout, at):
    """Return the values of a column in the first rows of a text table, a list of text.

    `layout` is the Layout of the table, and `at` the position of the column. Missing values are
    left out.
    """
    return [row[at] for row in layout.rows if len(row) > at and row[at] not in MISSING]


def _stamp_kind(layout, at):
    """Return the Arrow type in which the time stamps of a text table are read.

    It is int64, float64, or text for dates, by the first rows. `layout` is the Layout of the table,
    and `at` the position of the column of time stamps.
    """
    kind = stamp_array(pa.array(_texts(layout, at), pa.string())).type
    return pa.string() if pa.types.is_timestamp(kind) else kind


def _blocks(source, layout, weights):
    """Yield the rows of a text table in blocks of whole lines, as bytes that pyarrow can parse.

    `source` is the path of the table or its text as bytes, and `layout` its Layout. Comments are
    left out. The number of bytes of each block, as `_weight` counts it, is appended to the list
    `weights`; by their sum the share of the bytes in bad lines is known.
    """
    lines, skipped = b"", layout.start
    # an empty part marks the end
    for part in chain(parts_of(source, _BLOCK), [b""]):
        lines += part[skipped:]
        skipped, end = 0, lines.rfind(b"\n") + 1 if part else len(lines)
        block, lines = lines[:end], lines[end:]
        if not block.isascii() or b"\0" in block:
            block = block.translate(_ASCII)
        weights.append(_weight(block))
        # a search for one byte takes a fraction of the time of one for two
        if any(mark in block for mark in (b"#", b"%", b"/")):
            _check_comments(layout, map(decoded, _COMMENTS.findall(block)))
            block = _COMMENTS.sub(b"", block)
        if b'"' in block:
            block = _OPEN_QUOTE.sub(lambda line: line[0].replace(b'"', _EMPTY), block)
        for pattern, replacement in layout.rewrites:
            block = re.sub(pattern, replacement, block)
        if block:
            yield block


def _check_comments(layout, comments):
    """Raise a RejectedLog if a comment between rows is a header that differs from the first one.

    `comments` are the texts of the comments, and `layout` is the Layout of the table.
    """
    rows = [fields_of(COMMENT.sub("", text, count=1), layout.separator) for text in comments]
    rows = [row for row in rows if len(row) == len(layout.names)]
    # a comment may be prose: more than half of the fields of a header are names
    rows = [row for row in rows if sum(x in layout.names for x in row) > len(row) / 2]
    _refuse_header(layout, range(len(layout.names)), map(pa.array, zip(*rows, strict=True)))


def _refuse_header(layout, positions, columns):
    """Raise a RejectedLog if the table has a second header with its columns in another order.

    Then a column holds the name of another column. `layout` is the Layout of the table, `positions`
    are positions of columns in it, and `columns` are the texts in these, Arrow arrays.
    """
    for at, texts in zip(positions, columns, strict=False):
        others = pa.array({*layout.names} - {layout.names[at]}, pa.string())
        if layout.headed and pc.any(pc.is_in(pc.utf8_trim_whitespace(texts), others)).as_py():
            raise RejectedLog(
                f"a second header in the log has another column in place of {layout.names[at]}: "
                "make a log of each part"
            )


def _numbers(text):
    """Return a column of text, an Arrow array, as float64; text without a number becomes NaN."""
    try:
        return doubles(text)
    except pa.ArrowInvalid:
        return pa.array(pd.to_numeric(text.to_pandas(), errors="coerce").astype(float))


def _weight(text):
    """Return the number of bytes in `text`, bytes, that are neither blanks nor unwritten memory."""
    # to count takes far longer than to search
    return len(text) - sum(text.count(byte) for byte in (_EMPTY, b" ") if byte in text)
