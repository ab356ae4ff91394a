"""A calibration applied to a file of samples piece by piece.

Effects that remember go on from piece to piece (`Channels.past`).
"""

import csv
import json
from collections import Counter
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError
from imuloop.core.files import refuse_overwriting, replaced
from imuloop.core.memory import STEPS, filled, usual_step
from imuloop.core.samples import (
    ATTRS_KEY,
    CALIBRATED,
    CHANNELS,
    METADATA_KEY,
    ROWS,
    SENSORS,
    TEMPERATURE,
    TIME,
    Samples,
    calibrated_attrs,
    check_columns,
    parquet_file,
    read_metadata,
    refuse_calibrated,
)
from imuloop.core.tables import text_cell, text_cells

# samples that a filter reaches beyond `Effect.reach` at least
FEWEST = 16


def apply_file(calibration, source, target, rows=ROWS, shift=0.0):
    """Write the calibrated samples of a file; only time and temperature are read whole.

    Gives what `Calibration.apply` gives of the whole, whatever the rows of a piece. Columns that
    are no samples are kept. Returned is by (sensor, effect) the number of samples at which the
    effect was clamped to the range of its data. `shift`, s, is added to the stamps. The source is
    Parquet as ingest writes it, the target ``.csv`` or ``.parquet``; an ImuloopError if the source
    lacks a column or is calibrated already, or the target is the source or has another ending.
    """
    source, target = Path(source), Path(target)
    if target.suffix not in (".csv", ".parquet"):
        raise ImuloopError(f"{target}: give it the ending .csv or .parquet")
    refuse_overwriting([target], [source])
    samples = Samples(source)
    try:
        check_columns(samples.names)
        refuse_calibrated(samples.names, read_metadata(source))
    except ImuloopError as error:
        raise ImuloopError(f"{source}: {error}") from error
    is_text = target.suffix == ".csv"
    reach = max((effect.effect.reach for effect in calibration.effects), default=0.0)
    step, more = None, 0
    if reach and len(samples) > 1:
        step = usual_step(samples.read((TIME,), 0, min(len(samples), STEPS))[0])
        more = FEWEST + int(2 * reach / step)
    # neighbours of a missing temperature may lie far away
    warm = filled(samples[TIME], samples[TEMPERATURE]) if TEMPERATURE in samples else None
    attrs = calibrated_attrs(calibration.device)
    metadata = {
        METADATA_KEY: json.dumps(attrs[METADATA_KEY.decode()]),
        ATTRS_KEY: json.dumps(attrs),
    }
    pasts, counts, first, writer = ({}, {}), Counter(), 0, None
    with ExitStack() as stack:
        temporary = stack.enter_context(replaced(target))
        # without pre_buffer, which keeps what was read
        file = stack.enter_context(parquet_file(source, pre_buffer=False))
        for table in _tables(file, rows):
            last = first + len(table)
            begin, end = max(first - more, 0), min(last + more, len(samples))
            piece = slice(first - begin, last - begin)
            t, *values = samples.read((TIME, *CHANNELS), begin, end)
            f, w = np.split(np.transpose(values), 2, axis=1)
            temperature, clamped = None if warm is None else warm[begin:end], ({}, {})
            f, w = calibration.calibrated(f, w, t, temperature, pasts, step, clamped)
            for sensor, effects in zip(SENSORS, clamped, strict=True):
                counts.update(
                    {(sensor, name): int(at[piece].sum()) for name, at in effects.items()}
                )
            for name, column in zip(CHANNELS, np.hstack([f, w])[piece].T, strict=True):
                table = table.set_column(table.column_names.index(name), name, pa.array(column))
            stamps = pa.array(t[piece] + shift)
            table = table.set_column(table.column_names.index(TIME), TIME, stamps)
            table = _as_text(table) if is_text else table.replace_schema_metadata(metadata)
            if writer is None and is_text:
                writer = stack.enter_context(_csv(temporary, table))
            elif writer is None:
                parquet = pq.ParquetWriter(temporary, table.schema, compression="zstd")
                writer = stack.enter_context(parquet)
            writer.write_table(table)
            first = last
    return dict(+counts)


def _tables(file, rows):
    """Yield a file as tables of at most so many rows, one at least."""
    for batch in file.iter_batches(batch_size=rows):
        yield pa.Table.from_batches([batch])
    if not file.metadata.num_rows:
        yield file.schema_arrow.empty_table()


def _as_text(table):
    """Return a table marked as calibrated, with empty cells for temperatures that are missing."""
    if TEMPERATURE in table.column_names:
        column = pa.array(table[TEMPERATURE].to_numpy(), from_pandas=True)
        table = table.set_column(table.column_names.index(TEMPERATURE), TEMPERATURE, column)
    return text_cells(table.append_column(CALIBRATED, pa.array(np.ones(len(table), np.int8))))


@contextmanager
def _csv(path, table):
    """Open a file for tables as text; Arrow would put its header in quotes."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(map(text_cell, table.column_names))
    options = pa.csv.WriteOptions(include_header=False, quoting_style="needed")
    with (
        open(path, "ab") as file,
        pa.csv.CSVWriter(file, table.schema, write_options=options) as out,
    ):
        yield out
