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
import pyarrow.csv

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import refuse_calibrated
from imuloop.core.units import TIME, raw_unit
from imuloop.ingest.columns import STAMP, resolve
from imuloop.ingest.formats import IN_FOLDER
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import TABLE, names_device
from imuloop.ingest.stamps import no_stamps, stamp_array
from imuloop.ingest.tables import doubles, stated_units, table_log
from imuloop.ingest.text_layout import (
    BLANKS,
    MISSING,
    find_layout,
    parts_of,
    unreadable,
)

# a line with a quote that is not closed
_OPEN_QUOTE = re.compile(rb'(?m)^[^"\n]*+(?:"[^"\n]*+"[^"\n]*+)*+"[^"\n]*+$')
# lines of comments at the end of a file, and the number of bytes in which they are looked for
_LAST_COMMENTS, _LONGEST_END = re.compile(rb"(\n[ \t]*(#|%|//)[^\n]*+)++\s*\Z"), 1 << 12
_CONVERTING = {"null_values": [*MISSING], "strings_can_be_null": True, "check_utf8": False}
# number of bytes that are parsed at once
_BLOCK = 1 << 22
# bytes of zeros and of erased memory become one that no number has, so that only their row is lost
_EMPTY = b"\x01"
_ASCII = bytes(ord(_EMPTY) if i in (0, 255) else i if i < 128 else ord("?") for i in range(256))


def read(paths, columns=None):
    """Return the RawLog of a text table.

    ``paths["log"]`` is the path of the table or its text as bytes; a compressed file (.gz, .bz2,
    ...) is unpacked. If the path is the folder of a sensor in an EuRoC recording, such as ``imu0``,
    the table is the file `IN_FOLDER` in it. `columns` are the declared columns by quantity.
    """
    path = paths["log"]
    if not isinstance(path, bytes) and Path(path).is_dir():
        path = Path(path) / IN_FOLDER
        if not path.is_file():
            raise RejectedLog(f"the folder holds no {IN_FOLDER}")
    layout = find_layout(path)
    refuse_calibrated(layout.names, {})
    chosen, count = resolve(layout.names, columns, layout.headed), RawLog()
    _refuse_devices(layout, chosen)
    units, nominal, tick = _scaled(layout, chosen)
    skipped = len(layout.before)
    notes = [f"{skipped} line(s) before the table skipped"] if skipped and not nominal else []
    held = text_columns(path, layout, [*chosen.raw().values()], count, chosen.stamps())
    known = {"units": units, "nominal": nominal, "notes": notes}
    log = table_log(layout.names, chosen, held, layout.headed, tick, **known)
    log.lose(count)
    if isinstance(at := chosen.time, int):
        stamps = log.batch[STAMP]
        texts = [row[at] for row in layout.rows if at < len(row) and row[at] not in MISSING]
        if texts and 0 < stamps.null_count == len(stamps):
            fault = no_stamps(layout.names[at])
            raise ImuloopError(f"{fault}; the first stamp is '{texts[0][:80]}'")
    return log


def _refuse_devices(layout, chosen):
    """Raise a RejectedLog if a column says that the first rows are of several devices in turn.

    `layout` is the Layout of the table, and `chosen` are the Columns of the sensors. A row counts
    if it has values of the sensors that are not all zero.
    """
    rows = [[*row, *[""] * len(layout.names)] for row in layout.rows]
    for sensor in filter(None, (chosen.acceleration, chosen.angular_rate)):
        rows = [row for row in rows if {row[at].strip("+-0.,") for at in sensor} - {*MISSING}]
    for at, name in enumerate(layout.names):
        ids = [row[at] for row in rows if row[at]] if layout.headed and names_device(name) else []
        if 1 < len({*ids}) <= sum(one != other for one, other in pairwise(ids)):
            which = ", ".join([*dict.fromkeys(ids)][:4])[:200]
            raise RejectedLog(
                f"the rows are of several devices in turn, as column '{name[:80]}' says ({which}): "
                "split the log, so that each file holds one device"
            )


def _scaled(layout, chosen):
    """Return units, and scales of counts, dicts by quantity, and the tick of the stamps.

    The tick is in the unit of time. A row below the header may name the units, and lines above the
    header the scales. A unit that is a multiple of a unit of the library is a count with a scale.
    `layout` is the Layout of the table, and `chosen` are the Columns that are read.
    """
    units = chosen.units | (stated_units(chosen, layout.units) if layout.units else {})
    multiples = {q: TABLE["multiples"].get(q, {}).get(unit) for q, unit in units.items()}
    scales = {quantity: of for quantity, of in multiples.items() if of}
    said = {row[0]: row[1] for row in layout.before if len(row) == 2}
    with suppress(ValueError):
        for name, (quantity, unit, usual) in TABLE["scales"].items():
            if {*said} & {*TABLE["scales"]}:
                scales[quantity] = float(said.get(name, usual)), unit
    tick, unit = scales.pop("time", (1, None))
    if unit:
        tick *= TIME[unit]
        whole = next((name for name, scale in TIME.items() if scale == tick), None)
        units["time"], tick = whole or "s", 1 if whole else tick
    nominal = {q: {"scale": scale * raw_unit(q, unit).scale} for q, (scale, unit) in scales.items()}
    return units | dict.fromkeys(scales, "count"), nominal, tick


def text_columns(source, layout, positions, log, stamps):
    """Return the columns at `positions` of a text table, a list of Arrow arrays.

    `source` is the path of the table or its text as bytes, and `layout` its Layout. The first
    `stamps` columns are time stamps, int64, float64 or timestamp[ns]; the others are float64. Bad
    lines and their bytes are counted in the RawLog `log`. Raises a RejectedLog if the text cannot
    be parsed.
    """
    kinds = [_stamp_kind(layout, at) for at in positions[:stamps]]
    kinds += [pa.float64()] * len(positions[stamps:])
    # if there is text among the numbers, read all as text, so that only the rows with it are lost
    for types in (kinds, [pa.string()] * len(positions)):
        weights, lost = [], []
        try:
            columns = _parsed(_blocks(source, layout, weights), layout, positions, types, lost)
            break
        except pa.ArrowInvalid as error:
            fault = error
    else:
        raise unreadable(fault)
    if layout.headed:
        _check_headers([layout.names[at] for at in positions], columns)
    log.bad_lines += len(lost)
    log.lost_bytes += sum(map(_weight, lost))
    log.text_bytes += sum(weights)
    if stamps and all(column.null_count for column in columns):
        # drop rows with neither stamp nor value, as at the end of the columns of a slower sensor
        held = pa.array(np.any([column.is_valid() for column in columns], axis=0))
        columns = [column.filter(held) for column in columns]
    return [*map(stamp_array, columns[:stamps]), *map(_numbers, columns[stamps:])]


def _stamp_kind(layout, at):
    """Return the type of the stamps in column `at`: int64, float64, or text for dates."""
    texts = [row[at] for row in layout.rows if len(row) > at and row[at] not in MISSING]
    kind = stamp_array(pa.array(texts, pa.string())).type
    return pa.string() if pa.types.is_timestamp(kind) else kind


def _blocks(source, layout, weights):
    """Yield the rows of a text table in blocks of whole lines, as bytes that pyarrow can parse.

    `source` is the path of the table or its text as bytes, and `layout` its Layout. The number of
    written bytes in each block is added to the list `weights`.
    """
    text, skipped = bytearray(), layout.start
    # an empty part marks the end
    for part in chain(parts_of(source, _BLOCK), [b""]):
        text += part[skipped:]
        skipped, end = 0, len(text)
        if part:
            # the last lines wait: comments may follow them
            end = max(end - _LONGEST_END, 0)
            end = text.rfind(b"\n", max(end - len(part), 0), end) + 1
        elif comments := _LAST_COMMENTS.search(text, max(0, end - _LONGEST_END)):
            end = comments.start() + 1
        block = bytes(text[:end])
        del text[:end]
        if not block.isascii() or b"\0" in block:
            block = block.translate(_ASCII)
        weights.append(_weight(block))
        if b'"' in block:
            block = _OPEN_QUOTE.sub(lambda line: line[0].replace(b'"', _EMPTY), block)
        for pattern, replacement in layout.rewrites:
            block = re.sub(pattern, replacement, block)
        if block:
            yield block


def _parsed(blocks, layout, positions, kinds, lost):
    """Return the columns at `positions` of a text, a list of Arrow arrays of the types `kinds`.

    `blocks` are the blocks of the text, bytes, and `layout` is its Layout. Lines with another
    number of fields are added to the list `lost`.
    """
    names, every = [str(i) for i in positions], [str(i) for i in range(len(layout.names))]
    # its size is no limit of the blocks, so that no line is longer than one
    reading = pyarrow.csv.ReadOptions(column_names=every, block_size=_BLOCK, use_threads=False)
    parsing = pyarrow.csv.ParseOptions(
        delimiter="\t" if layout.separator == BLANKS else layout.separator,
        invalid_row_handler=lambda row: lost.append(row.text.encode()) or "skip",
    )
    converting = pyarrow.csv.ConvertOptions(
        column_types=dict(zip(names, kinds, strict=True)),
        include_columns=list(dict.fromkeys(names)),
        **_CONVERTING,
    )
    file = SimpleNamespace(read=lambda size: next(blocks, b""), closed=False)
    count, numbers, others = 0, {}, {name: [] for name in names}
    for batch in pyarrow.csv.open_csv(file, reading, parsing, converting):
        count += batch.num_rows
        for name in others:
            if (column := batch[name]).type == pa.float64():
                # a column of numbers grows in its place, so that no memory is used twice
                x = numbers.setdefault(name, np.empty(0))
                x.resize(count, refcheck=False)
                x[count - len(column) :] = column.to_numpy(zero_copy_only=False)
            else:
                others[name].append(column)
    found = {name: pa.array(x, from_pandas=True) for name, x in numbers.items()}
    for name, kind in zip(names, kinds, strict=True):
        found.setdefault(name, pa.chunked_array(others[name], kind).combine_chunks())
    return [found[name] for name in names]


def _check_headers(names, columns):
    """Raise a RejectedLog if a column holds the name of another: a second header differs."""
    for name, column in zip(names, columns, strict=True):
        others = pa.array({*names} - {name}, pa.string())
        if column.type == pa.string():
            if pc.any(pc.is_in(pc.utf8_trim_whitespace(column), others)).as_py():
                raise RejectedLog(
                    f"a second header in the log has another column in place of {name[:80]}: make "
                    "a log of each part"
                )


def _numbers(text):
    """Return a column of text as float64; other text than numbers becomes NaN."""
    try:
        return doubles(text)
    except pa.ArrowInvalid:
        return pa.array(pd.to_numeric(text.to_pandas(), errors="coerce").astype(float))


def _weight(text):
    """Return the number of bytes of a text without zeros, erased memory and blanks."""
    return len(text) - sum(text.count(each) for each in (_EMPTY, b" ") if each in text)
