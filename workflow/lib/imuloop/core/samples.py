"""Samples: the one table from ingest to the end, SI units, one clock.

A pandas DataFrame of float64 columns: `t` (s from the first sample), specific force `ax ay az`
(m/s^2), angular rate `gx gy gz` (rad/s) and, where logged, `temperature` (degC). Where `t` was
rebuilt, `t_logged` is the time as stamped.
"""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError

# time, s from the first sample
TIME = "t"
# specific force along the sensor's axes, m/s^2
ACCELERATION = ("ax", "ay", "az")
# angular rate about the sensor's axes, rad/s
ANGULAR_RATE = ("gx", "gy", "gz")
# the six axes in the order of every table
CHANNELS = ACCELERATION + ANGULAR_RATE
# the columns of each sensor
SENSORS = {"accelerometer": ACCELERATION, "gyroscope": ANGULAR_RATE}
# temperature, degC
TEMPERATURE = "temperature"
# time as the log's stamps have it, s from the first sample; beside a `t` that was rebuilt
LOGGED_TIME = "t_logged"
# a step of time longer than this many median steps is a gap: one sample lost makes it two
GAP_STEPS = 1.5
# over a gap of fewer, samples before and after it belong together; a clock that starts again goes
# on after ten
LONG_GAP_STEPS = 9.5

# key of the project's own entry in a Parquet file's metadata
METADATA_KEY = b"imuloop"


def lost_samples(steps, usual):
    """Return how many samples are missing in steps of time; a step below `GAP_STEPS` lacks none.

    Parameters
    ----------
    steps : ndarray
        s.
    usual : float
        Usual step, s.
    """
    wide = steps > GAP_STEPS * usual
    return np.where(wide, np.rint(steps / usual), 1).astype(int) - 1


def schema(temperature, metadata, rebuilt=False):
    """Return the Parquet schema of a samples file.

    Parameters
    ----------
    temperature : bool
        Whether the log holds a temperature.
    metadata : dict
        Source, units, hashes; kept as JSON in the file.
    rebuilt : bool
        Whether `t` is not that of the stamps.
    """
    names = [TIME, *CHANNELS, *[TEMPERATURE] * temperature, *[LOGGED_TIME] * rebuilt]
    fields = [pa.field(name, pa.float64()) for name in names]
    return pa.schema(fields, metadata={METADATA_KEY: json.dumps(metadata).encode()})


def check_columns(names):
    """Refuse a table that lacks a column of samples.

    Raises
    ------
    ImuloopError
        If one is missing.
    """
    lacking = [name for name in (TIME, *CHANNELS) if name not in names]
    if lacking:
        raise ImuloopError(
            f"no column {', '.join(lacking)}; samples have t (s), ax ay az (m/s^2), gx gy gz "
            "(rad/s)"
        )


def parquet_file(path, **options):
    """Return an open Parquet file; the error of one that is not whole names it."""
    try:
        return pq.ParquetFile(path, **options)
    except pa.ArrowInvalid as error:
        raise ImuloopError(
            f"{path}: no whole Parquet file; if it is a result, delete the device's folder and "
            "results/report.html, and run again"
        ) from error


def read_samples(path, columns=None):
    """Return samples of a Parquet file as a DataFrame, all columns or only those named."""
    with parquet_file(path) as file:
        return file.read(columns and list(columns)).to_pandas()


def read_columns(path, columns=None):
    """Return columns of a Parquet file, all or only those named, as a dict of arrays."""
    # a data set's machinery and a second thread cost more than a session's file
    with parquet_file(path) as file:
        table = file.read(columns and list(columns), use_threads=False)
    return {name: values(table[name]) for name in table.column_names}


def values(column):
    """Return the values of an Arrow array or column, not-a-number where one is missing.

    Arrow's own `to_numpy` loads pandas, which takes longer than a session's file.
    """
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        return np.array(column.to_pylist(), dtype=object)
    if column.null_count:
        column = column.cast(pa.float64()).fill_null(np.nan)
    chunks = column.chunks if isinstance(column, pa.ChunkedArray) else [column]
    parts = [np.from_dlpack(chunk) for chunk in chunks]
    return np.concatenate(parts) if parts else np.zeros(0, column.type.to_pandas_dtype())


class Columns:
    """Columns of a samples file by name, each read when it is asked for, none kept.

    Serves as a DataFrame does where one column at a time is enough: ``np.asarray(samples[name])``,
    ``name in samples`` and ``len(samples)``, the number of rows.

    Parameters
    ----------
    path : path-like
        Samples, Parquet.
    """

    def __init__(self, path):
        self.path = path
        with parquet_file(path) as file:
            metadata = file.metadata
        self.names = tuple(metadata.schema.names)
        self.rows = metadata.num_rows

    def __getitem__(self, name):
        """Return a column, shape (rows,), not-a-number where a value is missing."""
        if name not in self.names:
            raise KeyError(name)
        column, first = np.empty(self.rows), 0
        with parquet_file(self.path) as file:
            # batches, or threads, would keep a file's worth of memory
            for group in range(file.num_row_groups):
                part = values(file.read_row_group(group, [name], use_threads=False).column(0))
                last = first + len(part)
                column[first:last] = part
                first = last
        return column

    def __contains__(self, name):
        return name in self.names

    def __len__(self):
        return self.rows


def read_metadata(path):
    """Return the project's metadata of a Parquet file; empty if it has none."""
    with parquet_file(path) as file:
        entries = file.schema_arrow.metadata or {}
    return json.loads(entries.get(METADATA_KEY, b"{}"))
