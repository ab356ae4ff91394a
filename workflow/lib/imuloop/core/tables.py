"""Tables as dicts of arrays, one a column: made, joined and written to Parquet."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.files import replaced
from imuloop.core.samples import read_columns


def table(names, *values):
    """Return a table of columns; a text or a number stands for a column of it beside arrays."""
    columns = [np.asarray(each, object if isinstance(each, str) else float) for each in values]
    return dict(zip(names, np.broadcast_arrays(*columns), strict=True))


def joined(tables):
    """Return the rows of tables of the same columns, one below the other."""
    return {name: np.concatenate([each[name] for each in tables]) for name in tables[0]}


def write_table(path, columns):
    """Write a table as Parquet, in one step."""
    arrays = {
        name: pa.array(x, pa.large_string() if x.dtype == object else None)
        for name, x in columns.items()
    }
    with replaced(path) as temporary:
        pq.write_table(pa.table(arrays), temporary)


def write_sessions(path, tables):
    """Write tables by session as one, with the session's name in its first column."""
    parts = [
        {"session": np.full(len(next(iter(each.values()))), name, object), **each}
        for name, each in tables.items()
    ]
    write_table(path, joined(parts))


def read_session(path, session):
    """Return the rows of one session of such a table, without its name."""
    columns = read_columns(path)
    own = columns.pop("session") == session
    return {name: x[own] for name, x in columns.items()}
