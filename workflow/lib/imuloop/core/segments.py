"""Segments of a session: stretches that are static, motion, disturbed or a gap; and power cycles.

Segments are the rows of a pandas DataFrame, in order of time. Its columns are:

- `start_s` and `end_s`, half-open, on the clock of the samples;
- `kind`; a gap has no samples, or samples in which a channel is stuck; in a session of attitudes, a
  rest with a clipped specific force is disturbed;
- `pose`: number of the pose, -1 without one;
- `n`: number of samples;
- mean and standard deviation of every channel, SI, without missing values;
- `tilt_rad`: root mean square of the tilt that both sensors show in a rest; for a rest in the hand
  it includes the rotation about the vertical.
"""

import numpy as np
import pandas as pd

from imuloop.core.samples import CHANNELS, TEMPERATURE, TIME, Samples

STATIC = "static"
MOTION = "motion"
DISTURBED = "disturbed"
GAP = "gap"
KINDS = (STATIC, MOTION, DISTURBED, GAP)
# ratio of deviation to mean that rounding gives a constant value
_ROUNDING = 1e-14


def segment_table(samples, start_s, end_s, kinds, poses):
    """Return the table of k segments, a DataFrame, with the statistics of every channel.

    The column `tilt_rad` is set to zero.

    Parameters
    ----------
    samples : Samples or DataFrame
        The samples of the session.
    start_s, end_s : array_like, shape (k,)
        Start and end of each segment, s, half-open.
    kinds : sequence of str
        Kind of each segment: ``static``, ``motion``, ``disturbed`` or ``gap``.
    poses : array_like of int, shape (k,)
        Number of the pose of each segment, -1 without one.
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
    for name in (*CHANNELS, TEMPERATURE):
        if name in rows:
            # missing temperatures do not count
            parts = [x[np.isfinite(x)] for x in (rows[name][i:j] for i, j in ranges)]
            mean = np.array([x.mean() if len(x) else np.nan for x in parts])
            deviation = np.array([x.std() if len(x) else np.nan for x in parts])
            deviation[deviation <= _ROUNDING * np.abs(mean)] = 0.0
            columns |= {f"{name}_mean": mean, f"{name}_std": deviation}
    return pd.DataFrame(columns)


def power_cycles(segments):
    """Return the number of the power cycle of each of n segments, (n,) of int, from 0.

    In a power cycle the device was on without a break. If a gap is longer than all segments of
    other kinds together, a new power cycle begins with it: the device was off, or the clock was
    set. The true duration of such a gap is not known, so the noise before the gap is taken as
    independent of the noise after it. `segments` is the table of the n segments.
    """
    duration = np.asarray(segments["end_s"], float) - np.asarray(segments["start_s"], float)
    is_gap = np.asarray(segments["kind"]) == GAP
    return np.cumsum(is_gap & (duration > duration[~is_gap].sum()))
