"""The columns of a text table on one clock, as arrays."""

import numpy as np

from imuloop.ingest.delimited import text_batches
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.stamps import stamp_values


def read_series(source, layout, positions, batch_rows, most):
    """Return the stamps in the first of the columns, the numbers in the others, what is left out.

    `source` and `layout` are as of `text_batches`, `positions` the columns, of which no more are
    read after `most` bytes, -1 is all. What is left out is a RawLog with the bad lines and bytes
    lost, and the number of rows without a stamp.
    """
    count = RawLog(batches=iter(()), temperature=False, found={})
    parts, unstamped, held = [], 0, 0
    for batch in text_batches(source, layout, positions, batch_rows, count, stamps=1):
        stamps, readable, dates = stamp_values(batch[0])
        readable = readable & (not dates)
        unstamped += int((~readable).sum())
        columns = [x.to_numpy(zero_copy_only=False) for x in batch.columns[1:]]
        parts.append([x[readable] for x in (stamps, *columns)])
        held += batch.nbytes
        if 0 <= most < held:
            break
    joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
    stamps, *values = joined or [np.empty(0)] * len(positions)
    return stamps, values, count, unstamped
