"""The logs that `imuloop.calibrate` takes, such as arrays, as paths or tables."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from imuloop.core.errors import ImuloopError, nearest
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TEMPERATURE, TIME
from imuloop.ingest.formats import PAIR

# types of a path
FILE = (str, PathLike)
# the arrays of a log in their order, and the columns that they become
ARRAYS = {
    "t": TIME,
    "acceleration": ACCELERATION,
    "angular_rate": ANGULAR_RATE,
    "temperature": TEMPERATURE,
}


def log_of(log, columns=None, name="log"):
    """Return a log as a path or a DataFrame, or as a dict with one of these for each sensor.

    `log` is a path, a DataFrame, arrays, or a mapping, as `imuloop.calibrate` takes it. `columns`
    are the declared columns; with them, `log` may be one array with a row per sample. `name` is the
    name of the log in messages. Raises an ImuloopError for a value that is not a log.
    """
    if isinstance(log, FILE):
        if not Path(log).exists():
            raise ImuloopError(f"{log}: there is no such file")
        return log if isinstance(log, str) else Path(log)
    several = isinstance(log, (tuple, list)) and len(log) in (3, 4)
    if several and not all(isinstance(values, FILE) for values in log):
        log = {k: v for k, v in zip(ARRAYS, log, strict=False) if v is not None}
    if isinstance(log, Mapping):
        # without t, each sensor may have a file or a table with its own stamps
        tables = (*FILE, pd.DataFrame, Mapping)
        if "t" not in log and any(isinstance(v, tables) for v in log.values()):
            if {*log} != {*PAIR}:
                raise ImuloopError(
                    f"{name}: a table or file each under {', '.join(map(str, log))}; name them "
                    f"{' and '.join(PAIR)}"
                )
            return {quantity: log_of(log[quantity], columns, quantity) for quantity in PAIR}
        # the arrays of the sensors, or columns by their own names
        arrays = {k: _array(k, v) for k, v in log.items() if v is not None}
        columnar = all(values.ndim == 1 for values in arrays.values())
        if columnar and not {*log} <= {*ARRAYS}:
            log = _table_of_columns(log, name)
        else:
            log = _table_of_arrays(arrays)
    if isinstance(log, np.ndarray) and log.ndim == 2 and columns:
        log = pd.DataFrame(log)
    if isinstance(log, pd.DataFrame):
        return _make_storable(_with_index(log), name)
    shape = f" of shape {log.shape}" if isinstance(log, np.ndarray) else ""
    raise ImuloopError(
        f"{name}: {type(log).__name__}{shape} is not a log; a log is a path, a DataFrame, (t, "
        "acceleration, angular_rate[, temperature]) of arrays, or one array with columns by "
        "number, {'time': 0, 'acceleration': [1, 2, 3], …}; of two files {'acceleration': path, "
        "'angular_rate': path}"
    )


def _table_of_columns(columns, name):
    """Return columns by their names, a mapping, as a DataFrame; `name` names the log in messages.

    Raises an ImuloopError if the columns differ in length.
    """
    try:
        return pd.DataFrame(dict(columns))
    except ValueError as error:
        raise ImuloopError(f"{name}: {error}") from error


def _table_of_arrays(arrays):
    """Return the DataFrame of a log that is given as arrays.

    `arrays` is a dict of them by their names in `ARRAYS`. Raises an ImuloopError for an array that
    is missing, or has another name or a wrong shape.
    """
    for name in {*arrays} - {*ARRAYS}:
        raise ImuloopError(f"{name}: no array of a log{nearest(str(name), ARRAYS)}")
    for quantity in PAIR:
        if quantity not in arrays:
            raise ImuloopError(f"{quantity}: none is given")
    first, table = next(iter(arrays)), {}
    n = len(np.atleast_1d(arrays[first]))
    for name, values in arrays.items():
        shape = (n, 3) if name in PAIR else (n,)
        if values.shape != shape:
            raise ImuloopError(
                f"{name}: an array of shape {values.shape}; as many rows as {first} has, {shape}, "
                "are needed"
            )
        named = ARRAYS[name] if name in PAIR else (ARRAYS[name],)
        table |= dict(zip(named, np.atleast_2d(values.T), strict=True))
    return pd.DataFrame(table)


def _array(name, values):
    """Return `values`, array_like, as an array with nan for masked values.

    `name` is the name of the array in a message. Raises an ImuloopError if rows differ in length.
    """
    if isinstance(values, np.ma.MaskedArray):
        return values.astype(float).filled(np.nan)
    try:
        return np.asarray(values)
    except ValueError as error:
        raise ImuloopError(f"{name}: its rows differ in length") from error


def _with_index(table):
    """Return a DataFrame, `table`, with its index as a column if the index has times or a name.

    Any other index only numbers the rows and stays as it is. So does an index with a name that a
    column already has.
    """
    name = table.index.name
    if name is None and isinstance(table.index, pd.DatetimeIndex):
        name = TIME
    return table if name is None or name in table else table.rename_axis(name).reset_index()


def _make_storable(table, name):
    """Return a DataFrame that a Parquet file can hold, from any DataFrame, `table`.

    A column that the file cannot hold becomes float64 if it has numbers, otherwise text. `name` is
    the name of the log in messages. Raises an ImuloopError if two columns have the same name.
    """
    if not table.columns.is_unique:
        [twice, *_] = table.columns[table.columns.duplicated()]
        raise ImuloopError(f"{name}: two columns are named {twice}")
    kinds = {}
    for column in table:
        try:
            pa.array(table[column])
        except pa.ArrowException:
            kinds[column] = float if table[column].dtype.kind in "iuf" else str
    return table.astype(kinds)
