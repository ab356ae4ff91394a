"""Attitude coverage: where on the sphere specific force pointed while the sensor rested."""

import numpy as np
import pandas as pd

from imuloop.core.samples import ACCELERATION
from imuloop.core.sphere import fibonacci_lattice
from imuloop.report.numbers import number
from imuloop.report.svg import BLUE, GRID, INK, ORANGE, VERMILLION, Picture, draw, write_csv

MARKS = {"multi_position": ("o", BLUE), "six_position": ("s", ORANGE)}
NOTE = (
    "Each mark is a pose: the direction of “up” in the sensor's frame, seen from +z (left) and "
    "from −z (right), equal areas. A direction without marks is a direction in which errors "
    "stay unseen; the orange ring is the largest such hole."
)


def largest_hole(directions):
    """Return the direction farthest from all poses, and its angle to the nearest, rad.

    Parameters
    ----------
    directions : array_like, shape (n, 3)
        Unit vectors.
    """
    # some 4 degrees apart
    grid = fibonacci_lattice(2000)
    nearest = (grid @ np.asarray(directions).T).max(axis=1)
    worst = nearest.argmin()
    return grid[worst], float(np.arccos(np.clip(nearest[worst], -1, 1)))


def direction_words(vector):
    """Return a direction in words: the axes it leans on, as ``+x −z``."""
    parts = [
        f"{'+' if v > 0 else '−'}{axis}"
        for v, axis in zip(vector, "xyz", strict=True)
        if abs(v) > 0.35
    ]
    return "\u202f".join(parts)


def pose_directions(device):
    """Return the direction of each pose, shape (n, 3), by kind of session."""
    found = {}
    for session in device.used:
        if session.kind in MARKS and len(session.poses):
            f = session.poses[[f"{c}_mean" for c in ACCELERATION]].to_numpy()
            found.setdefault(session.kind, []).append(f / np.linalg.norm(f, axis=1, keepdims=True))
    return {kind: np.concatenate(parts) for kind, parts in found.items()}


def pose_picture(device, folder):
    """Return the picture of the attitudes covered, or None where there is no pose."""
    directions = pose_directions(device)
    if not directions:
        return None
    everything = np.concatenate(list(directions.values()))
    hole, angle = largest_hole(everything)
    csv = write_csv(
        folder,
        "poses",
        pd.concat(
            pd.DataFrame(u, columns=["up_x", "up_y", "up_z"]).assign(kind=kind)
            for kind, u in directions.items()
        ),
    )

    def plot(axes):
        circle = np.exp(1j * np.linspace(0, 2 * np.pi, 61))
        for ax, sign, title in zip(axes, (1, -1), ("seen from +z", "seen from −z"), strict=True):
            ax.set_axis_off()
            ax.set_aspect("equal")
            # rings at 30, 60 and 90 degrees from the pole
            for ring in (30, 60, 90):
                r = np.sqrt(2) * np.sin(np.radians(ring) / 2)
                ax.plot(r * circle.real, r * circle.imag, color=GRID, lw=0.8)
            for kind, u in directions.items():
                mark, colour = MARKS[kind]
                x, y = _project(u, sign)
                ax.plot(x, y, mark, color=colour, ms=5, mew=0)
            x, y = _project(hole[None], sign)
            ax.plot(x, y, "o", color=VERMILLION, ms=15, mfc="none", mew=2)
            for text, x, y in (
                ("+x" if sign > 0 else "−x", 1.17, 0),
                ("−x" if sign > 0 else "+x", -1.17, 0),
                ("+y", 0, 1.14),
                ("−y", 0, -1.14),
            ):
                ax.text(x, y, text, ha="center", va="center")
            ax.text(0, -1.33, title, ha="center", va="center", color=INK)
            ax.set_xlim(-1.25, 1.25)
            ax.set_ylim(-1.42, 1.22)

    counts = " and ".join(f"{len(u)} {kind} poses" for kind, u in directions.items())
    caption = (
        f"{counts}; the largest hole is around {direction_words(hole)}, "
        f"{number(np.degrees(angle), 2)}° from the nearest pose."
    )
    name = f"{device.name}.poses"
    svg = draw(name, f"Attitudes covered: {caption}", 440, 240, plot, (4, 4, 4, 4), 1, 2)
    return Picture(name, svg, caption, NOTE, (csv,))


def _project(u, sign):
    """Return directions of one hemisphere in Lambert's equal-area projection of its pole.

    Seen from outside along the axis; the lower half is turned about y, so x runs to the left.
    """
    u = u[u[:, 2] * sign >= 0]
    r = np.sqrt(1 + np.abs(u[:, 2]))
    return sign * u[:, 0] / r, u[:, 1] / r
