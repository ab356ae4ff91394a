"""Segments: which stretch of a session is static, motion, disturbed or a gap.

A pandas DataFrame, a row a stretch in order of time: `start_s`, `end_s` (half-open, on the
samples' clock), `kind`, `pose` (number of the attitude held; -1 where none), `n` samples, and
mean and standard deviation of every channel (SI units); values that are missing do not count.
"""

import json

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.files import replaced
from imuloop.core.samples import CHANNELS, METADATA_KEY, TEMPERATURE, TIME

STATIC = "static"
MOTION = "motion"
DISTURBED = "disturbed"
GAP = "gap"
KINDS = (STATIC, MOTION, DISTURBED, GAP)


def segment_table(samples, start_s, end_s, kinds, poses):
    """Return the segments of a session with the statistics of every channel.

    Parameters
    ----------
    samples : DataFrame
        Samples of the session.
    start_s, end_s : array_like, shape (n,)
        Start and end of each stretch, s; a sample belongs to it if ``start <= t < end``.
    kinds : sequence of str, length n
        Kind of each stretch.
    poses : array_like of int, shape (n,)
        Number of the pose held, -1 where none.

    Returns
    -------
    DataFrame
        One row a stretch; not-a-number where a channel has no value in it.
    """
    t = samples[TIME].to_numpy()
    first = np.searchsorted(t, start_s, side="left")
    last = np.searchsorted(t, end_s, side="left")
    table = {
        "start_s": np.asarray(start_s, dtype=float),
        "end_s": np.asarray(end_s, dtype=float),
        "kind": list(kinds),
        "pose": np.asarray(poses, dtype=np.int64),
        "n": last - first,
    }
    for channel in (*CHANNELS, *([TEMPERATURE] if TEMPERATURE in samples else [])):
        x = samples[channel].to_numpy()
        stretches = [x[i:j] for i, j in zip(first, last, strict=True)]
        if channel == TEMPERATURE:
            stretches = [s[np.isfinite(s)] for s in stretches]
        table[f"{channel}_mean"] = np.array([s.mean() if len(s) else np.nan for s in stretches])
        table[f"{channel}_std"] = np.array([s.std() if len(s) else np.nan for s in stretches])
    return pd.DataFrame(table)


def write_segments(path, segments, metadata):
    """Write segments and what the segmentation chose as Parquet, in one step."""
    table = pa.Table.from_pandas(segments, preserve_index=False)
    table = table.replace_schema_metadata({METADATA_KEY: json.dumps(metadata).encode()})
    with replaced(path) as temporary:
        pq.write_table(table, temporary)


def read_segments(path):
    """Return the segments of a Parquet file."""
    return pq.read_table(path).to_pandas()
