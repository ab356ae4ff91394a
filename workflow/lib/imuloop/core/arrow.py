"""Arrays as an Arrow table, without pandas: `pyarrow.array` loads it to see what it is given."""

import numpy as np
import pyarrow as pa


def arrow_table(columns):
    """Return columns, numbers or text by name, as a Table; not-a-number stays what it is.

    Parameters
    ----------
    columns : dict of str to array_like
        Of one length; texts become large strings.
    """
    return pa.table({name: arrow_array(np.asarray(column)) for name, column in columns.items()})


def arrow_array(values):
    """Return an array of numbers or text, shape (n,), as Arrow's."""
    if values.dtype.kind in "fiu":
        buffer = pa.py_buffer(np.ascontiguousarray(values))
        return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [None, buffer])
    texts = [str(value).encode() for value in values]
    ends = np.cumsum([0, *map(len, texts)], dtype=np.int64)
    buffers = [None, pa.py_buffer(ends), pa.py_buffer(b"".join(texts))]
    return pa.Array.from_buffers(pa.large_string(), len(values), buffers)
