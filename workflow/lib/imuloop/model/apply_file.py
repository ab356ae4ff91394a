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
    """Write a copy of a file of samples with calibrated specific force and angular rate.

    The values equal the result of `Calibration.apply`. Other columns of the file are kept.

    Parameters
    ----------
    calibration : Calibration
        The calibration of the device.
    source : path
        Parquet file of samples that ingest wrote.
    target : path
        File to write, with the ending ``.csv`` or ``.parquet``.
    shift : float, optional
        Seconds to add to the time stamps.

    Returns
    -------
    dict
        Number of samples at which an effect was clamped, by (sensor, effect), both names. At these
        samples the input of the effect, such as the temperature, is outside its range in the data
        of the fit. Effects that were never clamped are left out.

    Raises
    ------
    ImuloopError
        If the source lacks a column or is calibrated already, or if the target is the source or has
        another ending.
    """
    source, target = Path(source), Path(target)
    if target.suffix not in (".csv", ".parquet"):
        raise ImuloopError(f"{target}: give it the ending .csv or .parquet")
    if not source.is_file():
        raise ImuloopError(f"{source}: there is no such file")
    refuse_overwriting([target], [source])
    samples = Samples(source)
    try:
        check_columns(samples.names)
        refuse_calibrated(samples.names, read_metadata(source))
    except ImuloopError as error:
        raise ImuloopError(f"{source}: {error}") from error
    t, *values = samples.read((TIME, *CHANNELS), 0, len(samples))
    f, w = np.split(np.transpose(values), 2, axis=1)
    temperature = filled(t, samples[TEMPERATURE]) if TEMPERATURE in samples else None
    # by sensor, a dict that is filled by name of the effect with the samples where it was clamped
    clamped = {}, {}
    f, w = calibration.calibrated(f, w, t, temperature, clamped)
    table = pq.read_table(source)
    for name, column in zip((TIME, *CHANNELS), (t + shift, *f.T, *w.T), strict=True):
        table = table.set_column(table.column_names.index(name), name, pa.array(column))
    attrs = calibrated_attrs(calibration.device)
    with replaced(target) as temporary:
        if target.suffix == ".csv":
            _write_text(temporary, _mark_calibrated(table))
        else:
            # the mark in the project's own entry of the metadata, and in the one that pandas reads
            marks = {METADATA_KEY: json.dumps(attrs[METADATA_KEY.decode()])}
            marked = table.replace_schema_metadata(marks | {ATTRS_KEY: json.dumps(attrs)})
            pq.write_table(marked, temporary, compression="zstd")
    by_sensor = zip(SENSORS, clamped, strict=True)
    masks = {(s, effect): mask for s, of_sensor in by_sensor for effect, mask in of_sensor.items()}
    return {key: int(mask.sum()) for key, mask in masks.items() if mask.any()}


def _mark_calibrated(table):
    """Return an Arrow table for a CSV file, with a column that marks the samples as calibrated.

    `table` is the Arrow table of the calibrated samples. A CSV file has no metadata, so the mark is
    a column of ones. Missing temperatures become empty cells.
    """
    if TEMPERATURE in table.column_names:
        column = pa.array(table[TEMPERATURE].to_numpy(), from_pandas=True)
        table = table.set_column(table.column_names.index(TEMPERATURE), TEMPERATURE, column)
    return text_cells(table.append_column(CALIBRATED, pa.array(np.ones(len(table), np.int8))))


def _write_text(path, table):
    """Write the Arrow table `table` as a CSV file at `path`, the names of the columns first."""
    # the header is written apart, as Arrow would put it in quotes
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(map(text_cell, table.column_names))
    options = pa.csv.WriteOptions(include_header=False, quoting_style="needed")
    with open(path, "ab") as file:
        pa.csv.write_csv(table, file, options)
