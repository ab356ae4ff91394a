"""The columns of a text table on one clock, as arrays."""

from types import SimpleNamespace

import numpy as np

from imuloop.ingest.delimited import numbers, text_batches
from imuloop.ingest.stamps import parse_stamps, stamp_values


def read_series(source, layout, positions, batch_rows, most):
    """Return the stamps in the first of the columns, the numbers in the others, what is left out.

    Parameters
    ----------
    source : path-like or file object
        The table.
    layout : Layout
        Of `imuloop.ingest.text_layout.find_layout`.
    positions : list of int
        Columns, the stamps' first.
    batch_rows : int
        Rows read at once, about.
    most : int
        Bytes of text after which reading ends; -1 is all.

    Returns
    -------
    stamps : ndarray, shape (n,)
    values : list of ndarray, shape (n,)
    count : namespace
        ``bad_lines``, ``lost_bytes`` and ``text_bytes``, as in `RawLog`.
    unstamped : int
        Rows without a stamp, left out.
    """
    count = SimpleNamespace(bad_lines=0, lost_bytes=0, text_bytes=0)
    stamps, values, unstamped, held = [], [], 0, 0
    for text in text_batches(source, layout, positions, batch_rows, count):
        x, readable, dates = stamp_values(parse_stamps(text[0]))
        readable = readable & (not dates)
        unstamped += int((~readable).sum())
        stamps.append(x[readable])
        rows = [numbers(column).to_numpy(zero_copy_only=False) for column in text.columns[1:]]
        values.append([column[readable] for column in rows])
        held += text.nbytes
        if 0 <= most < held:
            break
    if not stamps:
        return np.empty(0), [np.empty(0)] * (len(positions) - 1), count, unstamped
    joined = [np.concatenate(column) for column in zip(*values, strict=True)]
    return np.concatenate(stamps), joined, count, unstamped
