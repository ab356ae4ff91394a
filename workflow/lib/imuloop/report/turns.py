"""The turns from pose to pose: how far, how fast, and about which axis."""

import numpy as np
import pandas as pd

from imuloop.calibrate.poses import gather_poses, gather_rotations
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TEMPERATURE, TIME
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
    sessions = pose_sessions(device)
    poses = gather_poses([s.segments for s in sessions])
    columns = [TIME, *ACCELERATION, *ANGULAR_RATE]
    samples = [s.samples(columns) for s in sessions]
    rotations = gather_rotations(poses, samples, [s.segments for s in sessions], np.inf)
    gyroscope, rows = device.calibrations["final"].gyroscope, []
    for w, steps in zip(rotations.w, rotations.steps, strict=True):
        rate = gyroscope.output(w)
        size = np.linalg.norm(rate, axis=1)
        total = steps @ ((rate[1:] + rate[:-1]) / 2)
        direction = total / max(np.linalg.norm(total), 1e-9)
        axis = int(np.abs(direction).argmax())
        alone = abs(direction[axis]) >= ABOUT
        rows.append(
            {
                "angle_rad": steps @ ((size[1:] + size[:-1]) / 2),
                "speed_rad_s": size.max(),
                "axis": f"{'+' if direction[axis] > 0 else '−'}{XYZ[axis]}" if alone else MIXED,
            }
        )
    return pd.DataFrame(rows, index=rotations.first)


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
