"""Tables as dicts of arrays: made, joined, written to Parquet; cells of text in CSV files."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.files import replaced
from imuloop.core.samples import METADATA_KEY, read_columns

# how a formula begins, with what is skipped before it
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")


def table(names, *values):
    """Return a table of columns; a text or a number stands for a column of it beside arrays."""
    columns = [np.asarray(each, object if isinstance(each, str) else float) for each in values]
    return dict(zip(names, np.broadcast_arrays(*columns), strict=True))


def joined(tables):
    """Return the rows of tables of the same columns, one below the other."""
    return {name: np.concatenate([each[name] for each in tables]) for name in tables[0]}


def write_table(path, columns, metadata=None):
    """Write a table, a DataFrame too, as Parquet in one step; metadata as JSON."""
    arrays = {name: np.asarray(columns[name]) for name in columns}
    kinds = {name: pa.large_string() if x.dtype == object else None for name, x in arrays.items()}
    table = pa.table({name: pa.array(x, kinds[name]) for name, x in arrays.items()})
    if metadata:
        table = table.replace_schema_metadata({METADATA_KEY: json.dumps(metadata).encode()})
    with replaced(path) as temporary:
        pq.write_table(table, temporary)


def write_sessions(path, tables):
    """Write tables by session as one, with the session's name in its first column."""
    lengths = [len(next(iter(each.values()))) for each in tables.values()]
    names = {"session": np.repeat(np.array([*tables], object), lengths)}
    write_table(path, names | joined([*tables.values()]))


def read_session(path, session):
    """Return the rows of one session of such a table, without its name."""
    columns = read_columns(path)
    rows = columns.pop("session") == session
    return {name: x[rows] for name, x in columns.items()}


def text_cell(text):
    """Return a text that no spreadsheet executes: an apostrophe goes before a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def text_cells(table):
    """Return an Arrow table with each column of text as `text_cell` has it."""
    for place, field in enumerate(table.schema):
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            texts = [text and text_cell(text) for text in table.column(place).to_pylist()]
            table = table.set_column(place, field.name, pa.array(texts, kind))
    return table
