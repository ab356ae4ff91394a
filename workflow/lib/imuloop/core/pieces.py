"""A calibration applied to a file of samples piece by piece.

Effects that remember go on from piece to piece (`Channels.past`).
"""

import csv
import io
import json
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


def apply_file(calibration, source, target, rows=ROWS):
    """Write the calibrated samples of a file, of which time and temperature alone are read whole.

    Gives what `Calibration.apply` gives of the whole, whatever the rows of a piece. Columns that
    are no samples are kept. Returned is by (sensor, effect) the number of samples at which the
    effect was held to the range of its data. The source is Parquet as ingest writes it, the target
    ``.csv`` or ``.parquet``; an ImuloopError if the source lacks a column or is calibrated already,
    or the target is the source or has another ending.
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
    reach = max((effect.effect.reach for effect in calibration.effects), default=0.0)
    step, more = None, 0
    if reach and len(samples) > 1:
        step = usual_step(samples.read((TIME,), 0, min(len(samples), STEPS))[0])
        more = FEWEST + int(2 * reach / step)
    attrs = calibrated_attrs(calibration.device)
    metadata = {METADATA_KEY: attrs[METADATA_KEY.decode()], ATTRS_KEY: attrs}
    metadata = {key: json.dumps(content) for key, content in metadata.items()}
    pasts, counts = ({}, {}), {}
    columns = _with_surroundings(samples, rows, more)
    with replaced(target) as temporary, _writer(temporary, target.suffix, metadata) as write:
        for table in _pieces(source, rows):
            own, values = next(columns)
            held = {}, {}
            f, w = calibration.calibrated(**values, pasts=pasts, step=step, held=held)
            for sensor, found in zip(("accelerometer", "gyroscope"), held, strict=True):
                for name, at in found.items():
                    counts[sensor, name] = counts.get((sensor, name), 0) + int(at[own].sum())
            calibrated = np.hstack([f, w])[own]
            for name, column in zip(CHANNELS, calibrated.T, strict=True):
                place = table.column_names.index(name)
                table = table.set_column(place, name, pa.array(column))
            write(table)
    return {key: count for key, count in counts.items() if count}


def _pieces(path, rows):
    """Yield a file as tables of so many rows, fewer in the last."""
    # without pre_buffer, which keeps what was read
    with parquet_file(path, pre_buffer=False) as file:
        waiting = None
        for batch in file.iter_batches(batch_size=rows):
            more = pa.Table.from_batches([batch])
            # Arrow writes text of an empty chunk wrongly
            waiting = pa.concat_tables([waiting, more]) if waiting else more
            while len(waiting) >= rows:
                yield waiting.slice(0, rows)
                waiting = waiting.slice(rows)
        if waiting or not file.metadata.num_rows:
            yield waiting or file.schema_arrow.empty_table()


def _with_surroundings(samples, rows, more):
    """Yield the own rows of each piece and its arrays, with so many samples more on each side."""
    warm, count = None, len(samples)
    if TEMPERATURE in samples:
        # neighbours of a missing temperature may lie far away
        warm = filled(samples[TIME], samples[TEMPERATURE])
    for first in range(0, max(count, 1), rows):
        begin, last = max(first - more, 0), min(first + rows, count)
        end = min(last + more, count)
        t, *values = samples.read((TIME, *CHANNELS), begin, end)
        temperature = None if warm is None else warm[begin:end]
        f, w = np.array(values[:3]).T, np.array(values[3:]).T
        own = slice(first - begin, last - begin)
        yield own, {"f": f, "w": w, "t": t, "temperature": temperature}


@contextmanager
def _writer(path, ending, metadata):
    """Give a function that writes calibrated tables to a file, marked, one after the other."""
    with ExitStack() as stack:
        opened = []

        def write(table):
            if ending == ".parquet":
                table = table.replace_schema_metadata(metadata)
                if not opened:
                    writer = pq.ParquetWriter(path, table.schema, **_encodings(table))
                    opened.append(stack.enter_context(writer))
                opened[0].write_table(table)
                return
            table = table.append_column(CALIBRATED, pa.array(np.ones(len(table), np.int8)))
            if not opened:
                opened.append(stack.enter_context(open(path, "wb")))
                header = io.StringIO()
                names = [text_cell(name) for name in table.column_names]
                csv.writer(header, lineterminator="\n").writerow(names)
                opened[0].write(header.getvalue().encode())
            options = pa.csv.WriteOptions(include_header=False, quoting_style="needed")
            pa.csv.write_csv(text_cells(_without_nan(table)), opened[0], options)

        yield write


def _encodings(table):
    """Return how Parquet is to hold the columns: doubles byte by byte."""
    doubles = [field.name for field in table.schema if field.type == pa.float64()]
    others = [name for name in table.column_names if name not in doubles]
    return {"compression": "zstd", "use_dictionary": others, "use_byte_stream_split": doubles}


def _without_nan(table):
    """Return a table with empty cells where a temperature is not a number."""
    if TEMPERATURE not in table.column_names:
        return table
    column = pa.array(table[TEMPERATURE].to_numpy(), from_pandas=True)
    return table.set_column(table.column_names.index(TEMPERATURE), TEMPERATURE, column)
