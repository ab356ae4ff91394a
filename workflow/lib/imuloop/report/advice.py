"""What to do next with a device, as it follows from its results."""

import numpy as np

from imuloop.report.pose_plot import direction_words, largest_hole, pose_directions
from imuloop.report.results import SENSORS
from imuloop.report.verdict import block_of, verdict_of

# a hole in the attitudes covered that is worth another pose, degrees
WIDE_HOLE = 50.0


def next_steps(device):
    """Return what would help most, a sentence each.

    Parameters
    ----------
    device : Device
        Its results.
    """
    steps = [
        f"Record session {s.name} again, or correct its entry in the config: it was rejected."
        for s in device.sessions
        if s.rejected
    ]
    kinds = {s.kind for s in device.used}
    if "multi_position" not in kinds:
        steps.append(
            "Record a multi_position session: one minute at rest, then 20 or more rests of a few "
            "seconds in attitudes spread over the sphere, turned by hand between them. Without it "
            "misalignment and the gyroscope's scale factor stay unknown."
        )
    else:
        directions = np.concatenate(list(pose_directions(device).values()) or [np.zeros((0, 3))])
        hole, angle = largest_hole(directions) if len(directions) else (None, 0.0)
        if np.degrees(angle) > WIDE_HOLE:
            steps.append(
                f"Add poses with “up” around {direction_words(hole)}: the nearest is "
                f"{np.degrees(angle):.0f}° away."
            )
    if "static" not in kinds:
        steps.append(
            "Record two hours or more at rest: short rests show white noise, but bias "
            "instability and random walk only as upper limits."
        )
    for sensor in SENSORS:
        if verdict_of(block_of(device.diagnosis, sensor)) in ("unexplained", "partly_explained"):
            steps.append(
                f"Look at the {sensor}'s residual pictures: something that this model lacks is "
                "in the data. Poses far from the others were perhaps not at rest."
            )
    return steps
