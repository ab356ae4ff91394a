"""The turns from pose to pose: how far, how fast, and about which axis."""

import numpy as np

from imuloop.core.rows import Rows
from imuloop.core.samples import ANGULAR_RATE, TEMPERATURE, TIME
from imuloop.report.results import XYZ

# cosine of the angle within which a turn is about one axis, 30 degrees
ABOUT = 0.87
MIXED = "mixed"


def pose_sessions(device):
    """Return the sessions that the diagnosis took its poses from."""
    return [s for s in device.used if s.kind == "multi_position"]


def turns(device):
    """Return the turns of a device by the number of the pose that each starts from.

    Returns
    -------
    dict of int to dict
        ``angle_rad``, the way turned, that is the integral of the size of the angular rate;
        ``speed_rad_s``, its greatest value; ``axis``, as ``+z``, or `MIXED`.
    """
    gyroscope, found, before = device.calibrations["final"].gyroscope, {}, 0
    for session in pose_sessions(device):
        segments, rests = session.segments, session.rests.values()
        t, rows = session.samples[TIME], Rows(session.samples)
        # from the last sample of a pose to the first of the next
        first = np.searchsorted(t, [segments["end_s"][at].max() for at in rests]) - 1
        last = np.searchsorted(t, [segments["start_s"][at].min() for at in rests]) + 1
        for k, (i, j) in enumerate(zip(first[:-1], last[1:], strict=True), before):
            found[k] = _turn(t[i:j], gyroscope.output(rows.read(ANGULAR_RATE, i, j).T))
        before += len(first)
    return found


def _turn(t, rate):
    """Return angle, speed and axis of a turn."""
    size, steps = np.linalg.norm(rate, axis=1), np.diff(t)
    total = steps @ ((rate[1:] + rate[:-1]) / 2)
    direction = total / max(np.linalg.norm(total), 1e-9)
    axis = int(np.abs(direction).argmax())
    alone = abs(direction[axis]) >= ABOUT
    return {
        "angle_rad": steps @ ((size[1:] + size[:-1]) / 2),
        "speed_rad_s": size.max(initial=0.0),
        "axis": f"{'+' if direction[axis] > 0 else '−'}{XYZ[axis]}" if alone else MIXED,
    }


def pose_temperatures(device):
    """Return the mean temperature of each pose, °C; None where a session has none."""
    column, means = f"{TEMPERATURE}_mean", []
    for session in pose_sessions(device):
        if column not in session.segments:
            return None
        warmth = session.segments[column]
        means += [_mean(warmth[at]) for at in session.rests.values()]
    mean = np.array(means, float)
    return mean if np.isfinite(mean).any() else None


def _mean(values):
    """Return the mean of what is a number."""
    known = values[np.isfinite(values)]
    return known.mean() if len(known) else np.nan
