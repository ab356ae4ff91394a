"""Attitude coverage: the upward directions, on body axes, in which the device rested."""

import numpy as np

from imuloop.core.samples import ACCELERATION
from imuloop.plan.directions import direction_words, largest_hole
from imuloop.report.figures.drawing import BLUE, GRID, ORANGE, VERMILLION, Picture
from imuloop.report.page import phrase
from imuloop.report.results import XYZ

MARKS = {"multi_position": ("o", BLUE), "six_position": ("s", ORANGE)}
# the six faces, and the cosine of 20 degrees: a pose on a face is within this angle of it
FACES = {
    f"{sign}{axis}": np.eye(3)[i] * (1 if sign == "+" else -1)
    for i, axis in enumerate(XYZ)
    for sign in "+−"
}
NEAR = 0.94


def pose_directions(device):
    """Return the upward direction in each pose, on the axes of the device, by kind of session.

    The result is a dict of arrays, (n, 3) each: a unit vector with x, y and z for each of n poses.
    `device` is a DeviceResults. Poses without specific force are left out.
    """
    directions = {}
    for session in device.used:
        if session.kind in MARKS:
            force = device.poses[device.poses["session"] == session.name]
            force = force[list(ACCELERATION)].to_numpy(float)
            norm = np.linalg.norm(force, axis=1)
            if (norm > 0).any():
                directions.setdefault(session.kind, []).append((force.T / norm).T[norm > 0])
    return {kind: np.concatenate(parts) for kind, parts in directions.items()}


def draw_poses(area, directions, sign, hole):
    """Draw the upward directions on one half of the sphere, seen from outside.

    It is seen from +z if `sign` is 1, and from −z if it is -1. `area` is the matplotlib Axes,
    `directions` are unit vectors by kind of session, (n, 3) for n poses each, and `hole` is the
    direction farthest from all poses, a unit vector (3,), which gets a ring.
    """
    area.set_axis_off()
    area.set_aspect("equal")
    area.set(xlim=(-1.35, 1.35), ylim=(-1.5, 1.25))
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 61))
    # rings at 30, 60 and 90 degrees from the pole
    for ring in np.sqrt(2) * np.sin(np.radians([15, 30, 45])):
        area.plot(ring * circle.real, ring * circle.imag, color=GRID, lw=0.8)
    for kind, u in directions.items():
        mark, colour = MARKS[kind]
        area.plot(*_project(u[u[:, 2] * sign >= 0], sign), mark, color=colour, ms=6)
    if hole[2] * sign >= 0:
        x, y = _project(hole[None], sign)
        area.plot(x + 0.12 * circle.real, y + 0.12 * circle.imag, color=VERMILLION, lw=2.5)
    plus, minus = ("+x", "−x") if sign > 0 else ("−x", "+x")
    for text, x, y in ((plus, 1.2, 0), (minus, -1.2, 0), ("+y", 0, 1.14), ("−y", 0, -1.14)):
        area.text(x, y, text, ha="center", va="center")
    area.text(0, -1.4, f"seen from {'+' if sign > 0 else '−'}z", ha="center", va="center")


def pose_pictures(device):
    """Return the Picture of the upward directions in all poses of a device, in a list.

    `device` is a DeviceResults. The list is empty without poses.
    """
    directions = pose_directions(device)
    if not directions:
        return []
    everything = np.concatenate(list(directions.values()))
    hole, angle = largest_hole(everything)

    def plot(areas):
        """Draw the upper and the lower hemisphere; `areas` are their two Axes."""
        for area, sign in zip(areas, (1, -1), strict=True):
            draw_poses(area, directions, sign, hole)

    caption = phrase(
        "attitudes",
        counts={kind: len(u) for kind, u in directions.items()},
        missing=[words for words, u in FACES.items() if (everything @ u).max() < NEAR],
        hole=direction_words(hole),
        degrees=np.degrees(angle),
    )
    numbers = dict(zip(("up_x", "up_y", "up_z"), everything.T, strict=True))
    numbers["kind"] = [kind for kind, u in directions.items() for _ in u]
    looks = {"size": (356, 200), "columns": (1, 1)}
    name = f"{device.name}.poses"
    return [Picture(name, "Attitudes covered", caption, plot, numbers, **looks)]


def _project(u, sign):
    """Return x and y of directions in Lambert's equal-area projection of a hemisphere, (n,) each.

    `u` are n unit vectors, (n, 3), of the upper hemisphere if `sign` is 1, of the lower one if it
    is -1. The hemisphere is seen from outside, so the x axis points to the left for the lower one.
    """
    r = np.sqrt(1 + np.abs(u[:, 2]))
    return sign * u[:, 0] / r, u[:, 1] / r
