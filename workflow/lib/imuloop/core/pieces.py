"""A calibration applied to a file of samples piece by piece: how long the log is does not matter.

Effects that remember go on from piece to piece (`Channels.past`). What is known only of the whole
log is found in passes before: the next temperature after a gap, the median step of time.
"""

import csv
import io
import json
from contextlib import contextmanager
from itertools import chain, pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from imuloop.core.cells import text_cell, text_cells
from imuloop.core.errors import ImuloopError
from imuloop.core.files import refuse_overwriting, replaced
from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    METADATA_KEY,
    ROWS,
    TEMPERATURE,
    TIME,
    Samples,
    check_columns,
    read_metadata,
)

# samples that a filter reaches beyond `Effect.reach` at least
FEWEST = 16


def apply_file(calibration, source, target, rows=ROWS):
    """Write the calibrated samples of a samples file, in memory that does not grow with it.

    Gives what `Calibration.apply` gives of the whole. Columns that are no samples are kept.

    Parameters
    ----------
    calibration : Calibration
        To apply.
    source : path-like
        Samples, Parquet, as ingest writes them.
    target : path-like
        ``.csv`` or ``.parquet``; written in one step.
    rows : int
        Rows of a piece; changes nothing in the result.

    Returns
    -------
    dict of (str, str) to int
        By sensor and effect the samples at which the effect was held to the range of its data.

    Raises
    ------
    ImuloopError
        If the source lacks a column or is calibrated already, or the target is the source or has
        another ending.
    """
    source, target = Path(source), Path(target)
    if target.suffix not in (".csv", ".parquet"):
        raise ImuloopError(f"{target}: give it the ending .csv or .parquet")
    refuse_overwriting([target], [source])
    try:
        names = pq.read_schema(source).names
    except pa.ArrowInvalid as error:
        raise ImuloopError(f"{source}: no samples file: {error}") from error
    try:
        check_columns(names)
    except ImuloopError as error:
        raise ImuloopError(f"{source}: {error}") from error
    if read_metadata(source).get("calibrated"):
        raise ImuloopError(f"{source}: its samples are calibrated already")
    reach = max((effect.effect.reach for effect in calibration.effects), default=0.0)
    step = Samples(source).interval if reach else None
    ends = None
    if TEMPERATURE in names and any(TEMPERATURE in e.effect.needs for e in calibration.effects):
        ends = known_ends(source, rows)
    metadata = json.dumps({"calibrated": True, "device": calibration.device}).encode()
    pasts, counts = ({}, {}), {}
    with replaced(target) as temporary, _writer(temporary, target.suffix, metadata) as write:
        arrays = _arrays(_pieces(source, rows), ends)
        for table, columns, own in _with_surroundings(arrays, reach, step):
            held = {}, {}
            f, w = calibration.calibrated(**columns, pasts=pasts, step=step, held=held)
            for sensor, found in zip(("accelerometer", "gyroscope"), held, strict=True):
                for name, at in found.items():
                    counts[sensor, name] = counts.get((sensor, name), 0) + int(at[own].sum())
            for axes, values in ((ACCELERATION, f), (ANGULAR_RATE, w)):
                for name, column in zip(axes, values[own].T, strict=True):
                    place = table.column_names.index(name)
                    table = table.set_column(place, name, pa.array(column))
            write(table)
    return {key: count for key, count in counts.items() if count}


def _pieces(path, rows, columns=None):
    """Yield a file as tables of so many rows, fewer in the last."""
    waiting, count = [], 0
    # without pre_buffer, which keeps what was read
    with pq.ParquetFile(path, pre_buffer=False) as file:
        for batch in file.iter_batches(batch_size=rows, columns=columns):
            while count + len(batch) >= rows:
                waiting.append(batch.slice(0, rows - count))
                batch = batch.slice(rows - count)
                yield pa.Table.from_batches(waiting)
                waiting, count = [], 0
            if len(batch):
                waiting.append(batch)
                count += len(batch)
        if waiting or not file.metadata.num_rows:
            yield pa.Table.from_batches(waiting, file.schema_arrow if columns is None else None)


def _column(table, name):
    return table[name].to_numpy().astype(float, copy=False)


def _arrays(pieces, ends):
    """Yield each piece with its columns, the temperature's gaps filled as in the whole log."""
    for number, table in enumerate(pieces):
        t = _column(table, TIME)
        f, w = (
            np.column_stack([_column(table, name) for name in axes])
            for axes in (ACCELERATION, ANGULAR_RATE)
        )
        temperature = _column(table, TEMPERATURE) if TEMPERATURE in table.column_names else None
        if ends is not None:
            temperature = _filled(t, temperature, ends, number)
        yield table, {"f": f, "w": w, "t": t, "temperature": temperature}


def _filled(t, values, ends, number):
    """Fill what is not a number on a line to the nearest known, in this piece or another."""
    known = np.isfinite(values)
    if known.all():
        return values
    before = [each[-1] for each in ends[:number] if each][-1:]
    after = [each[0] for each in ends[number + 1 :] if each][:1]
    points = [*before, *np.column_stack([t[known], values[known]]), *after]
    return np.interp(t, *np.transpose(points)) if points else values


def known_ends(path, rows=ROWS):
    """Return (t, temperature) of the first and last known temperature of each piece, or None."""
    found = []
    for table in _pieces(path, rows, [TIME, TEMPERATURE]):
        t, values = _column(table, TIME), _column(table, TEMPERATURE)
        known = np.flatnonzero(np.isfinite(values))[[0, -1]] if np.isfinite(values).any() else []
        found.append([(t[i], values[i]) for i in known] or None)
    return found


def _with_surroundings(pieces, reach, step):
    """Yield table, columns and own rows of each piece, with the samples within reach about it."""
    if not reach:
        yield from ((table, columns, slice(None)) for table, columns in pieces)
        return
    more = FEWEST + int(np.ceil(reach / step)) if step else FEWEST
    behind = None
    for (table, columns), following in pairwise(chain(pieces, [None])):
        t, parts = columns["t"], [columns]
        first = 0
        if behind is not None:
            edge = max(np.searchsorted(behind["t"], t[0] - reach) - more, 0)
            parts.insert(0, _cut(behind, slice(edge, None)))
            first = len(parts[0]["t"])
        if following is not None:
            ahead = following[1]
            edge = np.searchsorted(ahead["t"], t[-1] + reach, side="right") + more
            parts.append(_cut(ahead, slice(0, edge)))
        joined = {
            name: None if value is None else np.concatenate([part[name] for part in parts])
            for name, value in columns.items()
        }
        yield table, joined, slice(first, first + len(t))
        behind = columns


def _cut(columns, rows):
    return {name: None if value is None else value[rows] for name, value in columns.items()}


@contextmanager
def _writer(path, ending, metadata):
    """Give a function that writes tables to a file, one after the other."""
    opened = []

    def write(table):
        if ending == ".csv":
            options = pa.csv.WriteOptions(include_header=False, quoting_style="needed")
            if not opened:
                opened.append(open(path, "wb"))
                header = io.StringIO()
                names = [text_cell(name) for name in table.column_names]
                csv.writer(header, lineterminator="\n").writerow(names)
                opened[0].write(header.getvalue().encode())
            pa.csv.write_csv(text_cells(_without_nan(table)), opened[0], options)
        else:
            table = table.replace_schema_metadata({METADATA_KEY: metadata})
            if not opened:
                opened.append(pq.ParquetWriter(path, table.schema, **_encodings(table)))
            opened[0].write_table(table)

    try:
        yield write
    finally:
        for file in opened:
            file.close()


def _encodings(table):
    """Return how Parquet is to hold the columns: doubles byte by byte."""
    doubles = [field.name for field in table.schema if field.type == pa.float64()]
    others = [name for name in table.column_names if name not in doubles]
    return {"compression": "zstd", "use_dictionary": others, "use_byte_stream_split": doubles}


def _without_nan(table):
    """Return a table with empty cells where a temperature is not a number."""
    if TEMPERATURE not in table.column_names:
        return table
    column = pa.array(_column(table, TEMPERATURE), from_pandas=True)
    return table.set_column(table.column_names.index(TEMPERATURE), TEMPERATURE, column)
