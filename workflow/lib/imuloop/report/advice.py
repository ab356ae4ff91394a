"""What to do next with a device, as it follows from its results."""

import numpy as np

from imuloop.report.pose_plot import direction_words, largest_hole, pose_directions
from imuloop.report.results import SENSORS
from imuloop.report.verdict import PARTS, block_of, leading, verdict_of

# a hole in the attitudes covered that is worth another pose, degrees
WIDE_HOLE = 50.0

# what a person can do about a residual, by what it goes with
_ATTITUDE = (
    "Add attitudes between those that stand out, and repeat a few of them: what comes back in the "
    "same attitude is the sensor, what does not was the pose."
)
_NEXT = {
    "harmonics_3": _ATTITUDE,
    "harmonics_4": _ATTITUDE,
    "harmonics_5": _ATTITUDE,
    "time": "Let the device warm up first and record the same again: what comes back at the same "
    "time after power-on is the device, what does not is its surroundings or a random walk.",
    "temperature": "Heat and cool slowly within one record, so that each temperature comes twice.",
    "temperature_rate": "Change the temperature at several rates and hold it in between: the "
    "thermometer may lag behind the sensor.",
    "pose_variance": "Lay the device down instead of holding it, on something heavy and away from "
    "fans.",
    "previous_pose": "Wait longer after each turn, and take the same attitudes in another order.",
    "rotation_speed": "Turn at varied speeds, in both senses about every axis, and check the full "
    "scale and the rate of the log.",
}
_LOOK = (
    "Nothing that it was compared with explains much of it: look in the pictures for poses or "
    "times that stand out, and record longer at rest, which gives a surer floor."
)


def what_next(block):
    """Return what a person can do about the residual that is left."""
    probe = leading(block)
    return _NEXT.get(probe["name"], _LOOK) if probe else _LOOK


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
        for part, words in PARTS.items():
            block = block_of(device.diagnosis, sensor, part)
            if verdict_of(block) in ("unexplained", "partly_explained"):
                steps.append(
                    f"{sensor.capitalize()}, {words}: something that the model lacks is in the "
                    f"data. {what_next(block)}"
                )
    return steps
