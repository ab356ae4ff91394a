"""The turns from pose to pose: how far, how fast, and about which axis."""

import numpy as np
import pandas as pd

from imuloop.core.samples import ANGULAR_RATE, TEMPERATURE, TIME
from imuloop.report.results import XYZ

# cosine of the angle within which a turn is about one axis, 30 degrees
ABOUT = 0.87
MIXED = "mixed"


def pose_sessions(device):
    """Return the sessions that the diagnosis took its poses from."""
    return [s for s in device.used if s.kind == "multi_position"]


def turns(device):
    """Return the turns of a device, a row each, by the number of the pose that it starts from.

    Returns
    -------
    DataFrame
        ``angle_rad``, the way turned, that is the integral of the size of the angular rate;
        ``speed_rad_s``, its greatest value; ``axis``, as ``+z``, or `MIXED`.
    """
    gyroscope, rows, before = device.calibrations["final"].gyroscope, {}, 0
    for session in pose_sessions(device):
        rests = session.segments[session.segments["pose"] >= 0].groupby("pose")
        samples = session.samples((TIME, *ANGULAR_RATE))
        t, raw = samples[TIME].to_numpy(), samples[list(ANGULAR_RATE)].to_numpy()
        # from the last sample of a pose to the first of the next
        first = np.searchsorted(t, rests["end_s"].max()) - 1
        last = np.searchsorted(t, rests["start_s"].min()) + 1
        for k, (i, j) in enumerate(zip(first[:-1], last[1:], strict=True), before):
            rows[k] = _turn(t[i:j], gyroscope.output(raw[i:j]))
        before += len(first)
    return pd.DataFrame.from_dict(rows, orient="index")


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
        rests = session.segments[session.segments["pose"] >= 0]
        means.append(rests.groupby("pose")[column].mean().to_numpy())
    mean = np.concatenate(means or [[]])
    return mean if np.isfinite(mean).any() else None
