"""Segments: which stretch of a session is static, motion, disturbed or a gap.

A pandas DataFrame, a row a stretch in order of time: `start_s`, `end_s` (half-open, on the
samples' clock), `kind`, `pose` (number of the attitude held; -1 where none), `n` samples, and
mean and standard deviation of every channel (SI units); values that are missing do not count.
"""

import json
from math import sqrt

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.files import replaced
from imuloop.core.samples import (
    CHANNELS,
    METADATA_KEY,
    TEMPERATURE,
    TIME,
    Samples,
    parquet_file,
)

STATIC = "static"
MOTION = "motion"
DISTURBED = "disturbed"
GAP = "gap"
KINDS = (STATIC, MOTION, DISTURBED, GAP)
# longer stretches are read in parts of so many rows
_PART = 1 << 20
# deviation over mean that rounding alone gives a value that never changes
_ROUNDING = 1e-14


def segment_table(samples, start_s, end_s, kinds, poses):
    """Return the segments of samples, a DataFrame, with the statistics of every channel.

    Start and end of each stretch are in s, half-open; kinds and numbers of poses are of as many.
    """
    samples = Samples(samples)
    edges = [np.searchsorted(samples[TIME], edge, side="left") for edge in (start_s, end_s)]
    ranges = np.column_stack(edges)
    found = statistics(samples, ranges)
    return pd.DataFrame(segment_columns(start_s, end_s, kinds, poses, ranges, *found))


def segment_columns(start_s, end_s, kinds, poses, ranges, means, deviations):
    """Return the columns of a table of segments, of ranges of samples and their `statistics`."""
    columns = {
        "start_s": np.asarray(start_s, dtype=float),
        "end_s": np.asarray(end_s, dtype=float),
        "kind": list(kinds),
        "pose": np.asarray(poses, dtype=np.int64),
        "n": np.diff(ranges, axis=1).ravel(),
    }
    for channel in means:
        columns[f"{channel}_mean"] = means[channel]
        columns[f"{channel}_std"] = deviations[channel]
    return columns


def statistics(rows, ranges):
    """Return mean and standard deviation of every channel in ranges of Samples, (n, 2), half-open.

    Two dicts of arrays, shape (n,), of the values that are not missing; not-a-number without any.
    """
    names = (*CHANNELS, *[TEMPERATURE] * (TEMPERATURE in rows.names))
    found = np.full((2, len(names), len(ranges)), np.nan)
    for k, (i, j) in enumerate(ranges):
        parts = [[] for _ in names]
        for first in range(i, j, _PART):
            x = rows.read(names, first, min(first + _PART, j))
            for name, part, values in zip(names, parts, x, strict=True):
                known = values[np.isfinite(values)] if name == TEMPERATURE else values
                if len(known):
                    part.append((len(known), known.mean(), known.std()))
        found[:, :, k] = np.transpose([_joined(part) for part in parts])
    found[1][found[1] <= _ROUNDING * np.abs(found[0])] = 0.0
    return tuple(dict(zip(names, each, strict=True)) for each in found)


def _joined(parts):
    """Return mean and standard deviation of parts of which number, mean and deviation are given."""
    if not parts:
        return np.nan, np.nan
    if len(parts) == 1:
        return parts[0][1:]
    n, means, deviations = np.array(parts).T
    mean = means @ n / n.sum()
    return mean, sqrt((deviations**2 + (means - mean) ** 2) @ n / n.sum())


def runs(segments):
    """Return the number of the run that each row lies in, shape (n,).

    A gap longer than all that was recorded ends a run: a clock that was set, or a device that was
    off. What lies between is not known to be time, and noise is not followed across.
    """
    start, end = (np.asarray(segments[name], dtype=float) for name in ("start_s", "end_s"))
    gap = np.asarray(segments["kind"]) == GAP
    return np.cumsum(gap & (end - start > (end - start)[~gap].sum()))


def write_segments(path, segments, metadata):
    """Write segments, columns by name, as Parquet, and with them what the segmentation chose."""
    table = {name: np.asarray(segments[name]) for name in segments}
    table["kind"] = pa.array(list(segments["kind"]), pa.large_string())
    table = pa.table(table).replace_schema_metadata({METADATA_KEY: json.dumps(metadata).encode()})
    with replaced(path) as temporary:
        pq.write_table(table, temporary)


def read_segments(path):
    """Return the segments of a Parquet file."""
    with parquet_file(path) as file:
        return file.read().to_pandas()
