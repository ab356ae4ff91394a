"""Samples of a session: a table that ingest writes and all other stages read.

It is a pandas DataFrame of float64 columns in SI: the time `t` (s since the first sample), specific
force `ax ay az` (m/s^2), angular rate `gx gy gz` (rad/s) and, if it was logged, `temperature`
(degC). If ingest rebuilt `t`, `t_logged` is the time stamp of the log. If the sensors have two
clocks, `t` is the time of the faster sensor. Each row then also has the nearest sample of the
slower sensor, whose time stamp is in `t_accelerometer` or `t_gyroscope`.
"""

import json
from contextlib import suppress
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError, RejectedLog

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
# time stamp of the log, s since the first sample, in a table whose `t` was rebuilt
LOGGED_TIME = "t_logged"
# time stamp of a slower sensor's own sample in each row, s
OWN_TIME = {"accelerometer": "t_accelerometer", "gyroscope": "t_gyroscope"}
# columns of a reference: quaternion from body to world, scalar first; position, m
ORIENTATION, POSITION = ("qw", "qx", "qy", "qz"), ("px", "py", "pz")

# number of samples, from the start of a log, that show the step of its values
ROWS = 1 << 17
# key of the project's own entry in a Parquet file's metadata
METADATA_KEY = b"imuloop"
# key of pandas' entry there, which holds a table's `attrs`
ATTRS_KEY = b"PANDAS_ATTRS"
# last column of calibrated samples in a text file, 1 in each row. Text has no metadata. A comment
# or other column names would disturb programs that read the file; a column survives a spreadsheet,
# a cut and a new file name
CALIBRATED = "calibrated_by_imuloop"


def other_sensor(sensor):
    """Return the name of the other sensor than `sensor`: ``gyroscope`` or ``accelerometer``."""
    (other,) = set(SENSORS) - {sensor}
    return other


def at_rail(samples, rails, names):
    """Return at which of n samples any channel is at a rail, an end of its range, a mask, (n,).

    `samples` is a table with a column for each channel, and `names` are the names of the channels
    that count. `rails` is a dict of the ends of the measuring ranges, (low, high) by name; an end
    is None if no sample reaches it.
    """
    clipped = np.zeros(len(samples[TIME]), dtype=bool)
    for name in names:
        low, high = rails.get(name) or (None, None)
        if low is not None:
            clipped |= np.asarray(samples[name]) <= low
        if high is not None:
            clipped |= np.asarray(samples[name]) >= high
    return clipped


def filled(t, values):
    """Return the values of a channel, (n,), with missing ones interpolated.

    `t`, (n,), are the times of the `values`, (n,). A missing value is not-a-number. The
    interpolation is linear, and constant before the first value and after the last. If all values
    are missing, they stay so.
    """
    valid = np.isfinite(values)
    if valid.all() or not valid.any():
        return values
    return np.interp(t, t[valid], values[valid])


def schema(metadata):
    """Return the Parquet schema of a file of samples: time and six channels as float64.

    The dict `metadata` is kept in it, as JSON under the key `METADATA_KEY`.
    """
    fields = [pa.field(name, pa.float64()) for name in (TIME, *CHANNELS)]
    return pa.schema(fields, metadata={METADATA_KEY: json.dumps(metadata).encode()})


def check_columns(names):
    """Raise an ImuloopError if a table lacks a column that samples need.

    `names` are the names of the columns of the table. The needed columns are the time and the six
    channels.
    """
    if lacking := [name for name in (TIME, *CHANNELS) if name not in names]:
        raise ImuloopError(
            f"no column {', '.join(lacking)}; samples have t (s), ax ay az (m/s^2), gx gy gz "
            "(rad/s)"
        )


def calibrated_attrs(device):
    """Return the `attrs` of a DataFrame that mark its samples as calibrated, a dict.

    `device` is the name of the device.
    """
    return {METADATA_KEY.decode(): {"calibrated": True, "device": device}}


def refuse_calibrated(names, metadata):
    """Raise a RejectedLog if the columns or the metadata of a table mark its samples as calibrated.

    `names` are the names of the columns. `metadata` is the dict that imuloop stored in the file,
    empty for other files.
    """
    if CALIBRATED in names or metadata.get("calibrated"):
        # the start of the name is enough: the file may be anyone's, and the name of any length
        device = str(metadata.get("device", ""))[:80]
        by = device and f", by a calibration of {device}"
        raise RejectedLog(
            f"its samples are calibrated already{by}: give the raw log that they were made of"
        )


def parquet_file(path):
    """Return the Parquet file at `path`, open.

    Raises an ImuloopError that names the path if the file is incomplete or not a Parquet file.
    """
    try:
        return pq.ParquetFile(path)
    except pa.ArrowInvalid as error:
        raise ImuloopError(
            f"{path}: no whole Parquet file; if it is a result, delete the device's folder and "
            "results/report.html, and run again"
        ) from error


def read_samples(path):
    """Return the samples in the Parquet file at `path`, a DataFrame."""
    with parquet_file(path) as file:
        return file.read().to_pandas()


def read_columns(path, columns=None):
    """Return columns of the Parquet file at `path`, a dict of arrays by name.

    `columns` are the names of the columns to read, by default all.
    """
    with parquet_file(path) as file:
        table = file.read(columns and list(columns))
    columns = {name: table[name].to_numpy() for name in table.column_names}
    # arrays of Arrow may be read-only
    return {name: np.require(x, requirements="W") for name, x in columns.items()}


class Samples:
    """Samples of a session, whose columns are read from the file when they are first used.

    ``samples[name]`` and ``name in samples`` work as for a DataFrame, and ``len(samples)`` is the
    number of rows. `names` are the names of the columns. The `source` is the path of a Parquet
    file, a DataFrame, a dict of columns or other Samples.
    """

    def __init__(self, source):
        # columns that were read from a file are shared by all Samples made from these
        self._table = source._table if isinstance(source, Samples) else source
        self._columns = source._columns if isinstance(source, Samples) else {}
        if isinstance(self._table, (str, Path)):
            with parquet_file(self._table) as file:
                self.names, self._rows = tuple(file.schema_arrow.names), file.metadata.num_rows
        else:
            self.names = tuple(self._table)
            # the length of a dict is not its number of rows
            self._rows = len(self._table[self.names[0]])

    def __len__(self):
        return self._rows

    def __contains__(self, name):
        return name in self.names

    def __getitem__(self, name):
        """Return the column with a `name`, (n,) for n rows; missing values are not-a-number."""
        if name not in self.names:
            raise KeyError(name)
        if not isinstance(self._table, (str, Path)):
            return np.asarray(self._table[name])
        if name not in self._columns:
            self._columns |= read_columns(self._table, (name,))
        return self._columns[name]

    def read(self, names, first, last):
        """Return the columns `names` in a range of rows, (len(names), last - first).

        `first` is the first row, and `last` the row after the last one.
        """
        return np.array([self[name][first:last] for name in names], float)

    @cached_property
    def interval(self):
        """Median time step, s; None if there are fewer than two samples."""
        if len(self) < 2:
            return None
        return float(np.median(np.diff(self[TIME])))


def holds(source, sensor):
    """Return whether a table of samples has values of a sensor.

    Ingest writes zeros for a sensor that the log lacks, so the result is false if all values are
    zero. Exception: it is true if there are no samples. `source` is anything from which Samples can
    be made, and `sensor` is the name of the sensor.
    """
    samples = Samples(source)
    return not len(samples) or any(samples[name].any() for name in SENSORS[sensor])


def on_own_clock(source, sensor):
    """Return the Samples of one sensor at the time stamps of its own clock, each sample once.

    `source` is anything from which Samples can be made, and `sensor` is the name of the sensor. If
    the sensor has no clock apart from that of the table, the result has all rows and columns of
    `source`.
    """
    samples, stamps = Samples(source), OWN_TIME[sensor]
    if stamps not in samples:
        return samples
    first = own_rows(samples[stamps])
    names = [name for name in (*SENSORS[sensor], TEMPERATURE) if name in samples]
    return Samples({TIME: samples[stamps][first]} | {name: samples[name][first] for name in names})


def own_rows(stamps):
    """Return the first row of each of m own samples of the slower sensor, (m,) of int.

    If the sensors have two clocks, consecutive rows repeat a sample of the slower sensor. `stamps`,
    (n,), has the sample's own time stamp in each of the n rows.
    """
    return np.flatnonzero(np.diff(stamps, prepend=-np.inf) > 0)


def on_gyroscope_clock(columns):
    """Return columns of samples at the time stamps of the gyroscope, a dict of arrays by name.

    `columns` is such a dict at the time stamps of the faster sensor. If the sensors have one clock,
    `columns` is returned unchanged. If the accelerometer is the slower sensor, its specific force
    is interpolated linearly. If it is the faster one, its specific force is averaged over the
    samples nearest to each sample of the gyroscope.
    """
    gyroscope_time, accelerometer_time = OWN_TIME["gyroscope"], OWN_TIME["accelerometer"]
    # only the slower sensor has a column for its time stamps; several rows repeat its sample
    if gyroscope_time in columns:
        first = own_rows(columns[gyroscope_time])
        count = np.diff(np.append(first, len(columns[gyroscope_time])))
        force = {n: np.add.reduceat(np.asarray(columns[n]), first) / count for n in ACCELERATION}
        columns = {name: np.asarray(x)[first] for name, x in columns.items()}
        return {**columns, **force, TIME: columns[gyroscope_time]}
    if accelerometer_time in columns:
        stamps, t = np.asarray(columns[accelerometer_time]), np.asarray(columns[TIME])
        new = own_rows(stamps)
        force = {name: np.interp(t, stamps[new], columns[name][new]) for name in ACCELERATION}
        return {**columns, **force}
    return columns


def sums_over(values, ranges):
    """Return the sum of `values`, (n, …), over each of m ranges of rows, (m, …).

    The half-open `ranges`, (m, 2), are in order and do not overlap. Each has at least one row, and
    only the last range may end with the last row.
    """
    edges = ranges.ravel()
    # reduceat sums from each edge to the next, of which every other sum is that of a range. It
    # takes no edge at the end of the values, and sums from the last edge to there
    edges = edges[edges < len(values)]
    return np.add.reduceat(values, edges, axis=0)[::2]


def read_metadata(path):
    """Return the metadata that imuloop stored in the Parquet file at `path`, a dict.

    The dict is empty if the file has none.
    """
    with parquet_file(path) as file:
        return own_metadata(file.schema_arrow.metadata or {})


def own_metadata(entries):
    """Return the metadata that imuloop stored in a Parquet file, a dict.

    `entries` is the dict of all metadata of the file, bytes by key. If pandas wrote the file, the
    metadata of imuloop are part of the entry in which pandas keeps the `attrs` of the table. The
    result is empty if the file has no metadata of imuloop.
    """
    metadata = json.loads(entries.get(METADATA_KEY, b"{}"))
    # another program may write anything under this key
    with suppress(KeyError, TypeError, ValueError, RecursionError):
        metadata = json.loads(entries[ATTRS_KEY])[METADATA_KEY.decode()] | metadata
    return metadata
