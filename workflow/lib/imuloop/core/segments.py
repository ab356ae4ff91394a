"""Segments: which stretch of a session is static, motion, disturbed or a gap; power cycles.

A pandas DataFrame, a row a stretch in order of time: `start_s`, `end_s` (half-open, on the
samples' clock), `kind`, `pose` (number of the attitude held; -1 where none), `n` samples, and
mean and standard deviation of every channel (SI units); values that are missing do not count.
A gap has no samples, or such as a channel is stuck in.
Of a session of attitudes a rest at which the accelerometer is at the end of its range is disturbed.
`tilt_rad` of a rest is the root mean square of the tilt that both sensors show in it, of one in
the hand that of all its turns.
"""

import numpy as np
import pandas as pd

from imuloop.core.samples import CHANNELS, TEMPERATURE, TIME, Samples

STATIC = "static"
MOTION = "motion"
DISTURBED = "disturbed"
GAP = "gap"
KINDS = (STATIC, MOTION, DISTURBED, GAP)
# deviation over mean that rounding alone gives a value that never changes
_ROUNDING = 1e-14


def segment_table(samples, start_s, end_s, kinds, poses):
    """Return the segments of samples, a DataFrame, with the statistics of every channel.

    Start and end of each stretch are in s, half-open; kinds and numbers of poses are of as many.
    """
    rows, start_s, end_s = Samples(samples), np.asarray(start_s, float), np.asarray(end_s, float)
    ranges = np.searchsorted(rows[TIME], np.column_stack([start_s, end_s]))
    columns = {
        "start_s": start_s,
        "end_s": end_s,
        "kind": list(kinds),
        "pose": np.asarray(poses, dtype=np.int64),
        "n": np.diff(ranges, axis=1).ravel(),
        "tilt_rad": np.zeros(len(ranges)),
    }
    for name in (*CHANNELS, *[TEMPERATURE] * (TEMPERATURE in rows)):
        statistics = np.array([_statistics(rows, name, i, j) for i, j in ranges], float)
        mean, deviation = statistics.reshape(-1, 2).T
        deviation[deviation <= _ROUNDING * np.abs(mean)] = 0.0
        columns |= {f"{name}_mean": mean, f"{name}_std": deviation}
    return pd.DataFrame(columns)


def _statistics(rows, name, first, last):
    """Return mean and standard deviation of a channel over a range of rows."""
    x = rows[name][first:last]
    # values that are missing do not count
    known = x[np.isfinite(x)] if name == TEMPERATURE else x
    return (known.mean(), known.std()) if len(known) else (np.nan, np.nan)


def power_cycles(segments):
    """Return the number of the power cycle that each row lies in, shape (n,), from 0.

    A gap longer than all that was recorded ends one: the device was off, or its clock was set. What
    lies between is not known to be time, and noise is not followed across.
    """
    start, end = (np.asarray(segments[name], dtype=float) for name in ("start_s", "end_s"))
    gap = np.asarray(segments["kind"]) == GAP
    return np.cumsum(gap & (end - start > (end - start)[~gap].sum()))
