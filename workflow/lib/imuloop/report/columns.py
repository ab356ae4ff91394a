"""Tables as dicts of arrays, one a column: read from Parquet, made of records, cut to rows."""

import numpy as np
from pyarrow.parquet import ParquetFile


def read_columns(path):
    """Return the columns of a Parquet file by name, each an array of a value a row."""
    with ParquetFile(path) as file:
        table = file.read(use_threads=False)
    return {name: table[name].to_numpy() for name in table.column_names}


def from_records(records):
    """Return the columns of dicts, a row each, as arrays; what one lacks is None."""
    names = dict.fromkeys(name for record in records for name in record)
    return {name: [record.get(name) for record in records] for name in names}


def rows(table, where):
    """Return the rows of a table that a mask or an index chooses."""
    return {name: values[where] for name, values in table.items()}


def groups(keys):
    """Return the distinct values of an array in order, each with the mask of its rows."""
    return {key: keys == key for key in np.unique(keys).tolist()}
