"""Tables, which are dicts of arrays; their Parquet files; and cells of text in CSV files."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.files import replaced
from imuloop.core.samples import METADATA_KEY, read_columns

# first characters of a formula of a spreadsheet, and characters that it skips
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")


def table(names, *values):
    """Return a table, a dict of arrays by the name of the column, from the values of each column.

    `names` are the names of the columns, and `values` has an array of texts or numbers for each. A
    single text or number instead of an array is repeated in all rows.
    """
    columns = [np.asarray(x, object if isinstance(x, str) else float) for x in values]
    return dict(zip(names, np.broadcast_arrays(*columns), strict=True))


def joined(tables):
    """Return one table, a dict of arrays, with the rows of all `tables`, in their order.

    `tables` is a list of one or more such dicts, which have the same columns.
    """
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def write_table(path, columns, metadata=None):
    """Write a table, a dict of arrays or a DataFrame, as a Parquet file at `path`.

    `columns` is the table. `metadata` is a dict, which is kept in the file as JSON.
    """
    arrays = {name: np.asarray(columns[name]) for name in columns}
    # a column of objects has texts; the kind of others follows from the array
    kinds = {name: pa.large_string() if x.dtype == object else None for name, x in arrays.items()}
    table = pa.table({name: pa.array(x, kinds[name]) for name, x in arrays.items()})
    if metadata:
        table = table.replace_schema_metadata({METADATA_KEY: json.dumps(metadata).encode()})
    with replaced(path) as temporary:
        pq.write_table(table, temporary)


def write_sessions(path, tables):
    """Write the tables of several sessions as one Parquet file at `path`.

    `tables` is a dict: the table of each session, with the same columns, by the name of the
    session. The first column of the file, ``session``, has this name in each row.
    """
    lengths = [len(next(iter(table.values()))) for table in tables.values()]
    names = {"session": np.repeat(np.array([*tables], object), lengths)}
    write_table(path, names | joined([*tables.values()]))


def read_session(path, session):
    """Return the table of one session, a dict of arrays, from a Parquet file of several sessions.

    `session` is the name of the session, which the column ``session`` of the file has in its rows.
    `path` is the path of the file. The table lacks this column.
    """
    columns = read_columns(path)
    rows = columns.pop("session") == session
    return {name: x[rows] for name, x in columns.items()}


def text_cell(text):
    """Return `text` for a cell of a CSV file, so that a spreadsheet does not execute it.

    A text that looks like a formula gets an apostrophe in front.
    """
    return f"'{text}" if text.startswith(_FORMULA) else text


def text_cells(table):
    """Return the Arrow table `table` with texts that no spreadsheet executes (`text_cell`)."""
    for index, field in enumerate(table.schema):
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            # a missing text stays missing
            texts = [text and text_cell(text) for text in table.column(index).to_pylist()]
            table = table.set_column(index, field.name, pa.array(texts, kind))
    return table
