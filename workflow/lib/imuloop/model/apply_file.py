"""A calibration applied to a file of samples."""

import csv
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError
from imuloop.core.files import refuse_overwriting, replaced
from imuloop.core.samples import (
    ATTRS_KEY,
    CALIBRATED,
    CHANNELS,
    METADATA_KEY,
    SENSORS,
    TEMPERATURE,
    TIME,
    Samples,
    calibrated_attrs,
    check_columns,
    filled,
    read_metadata,
    refuse_calibrated,
)
from imuloop.core.tables import text_cell, text_cells


def apply_file(calibration, source, target, shift=0.0):
    """Write the calibrated samples of a file; the values equal the result of `Calibration.apply`.

    Other columns of the file are kept.

    Parameters
    ----------
    calibration : Calibration
        The calibration of the device.
    source, target : path
        Parquet file of samples that ingest wrote, and file to write, ``.csv`` or ``.parquet``.
    shift : float, optional
        Seconds to add to the time stamps.

    Returns
    -------
    dict
        For each (sensor, effect), the number of samples at which the effect was clamped to the
        range of its data, if any.

    Raises
    ------
    ImuloopError
        If the source lacks a column or is calibrated already, or if the target is the source or has
        another ending.
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
    t, *values = samples.read((TIME, *CHANNELS), 0, len(samples))
    f, w = np.split(np.transpose(values), 2, axis=1)
    warm = filled(t, samples[TEMPERATURE]) if TEMPERATURE in samples else None
    clamped = {}, {}
    f, w = calibration.calibrated(f, w, t, warm, clamped)
    table = pq.read_table(source)
    for name, column in zip((TIME, *CHANNELS), (t + shift, *f.T, *w.T), strict=True):
        table = table.set_column(table.column_names.index(name), name, pa.array(column))
    attrs = calibrated_attrs(calibration.device)
    with replaced(target) as temporary:
        if target.suffix == ".csv":
            _write_text(temporary, _as_text(table))
        else:
            marks = {METADATA_KEY: json.dumps(attrs[METADATA_KEY.decode()])}
            marked = table.replace_schema_metadata(marks | {ATTRS_KEY: json.dumps(attrs)})
            pq.write_table(marked, temporary, compression="zstd")
    masks = {(s, n): x for s, of in zip(SENSORS, clamped, strict=True) for n, x in of.items()}
    return {key: int(mask.sum()) for key, mask in masks.items() if mask.any()}


def _as_text(table):
    """Return a table marked as calibrated, with empty cells for temperatures that are missing."""
    if TEMPERATURE in table.column_names:
        column = pa.array(table[TEMPERATURE].to_numpy(), from_pandas=True)
        table = table.set_column(table.column_names.index(TEMPERATURE), TEMPERATURE, column)
    return text_cells(table.append_column(CALIBRATED, pa.array(np.ones(len(table), np.int8))))


def _write_text(path, table):
    """Write a table as text; Arrow would put its header in quotes."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(map(text_cell, table.column_names))
    options = pa.csv.WriteOptions(include_header=False, quoting_style="needed")
    with open(path, "ab") as file:
        pa.csv.write_csv(table, file, options)
