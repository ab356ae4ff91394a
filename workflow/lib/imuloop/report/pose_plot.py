"""Attitude coverage: where on the sphere specific force pointed while the sensor rested."""

import numpy as np

from imuloop.core.samples import ACCELERATION
from imuloop.core.sphere import fibonacci_lattice
from imuloop.report.numbers import joined, number
from imuloop.report.svg import BLUE, GRID, ORANGE, VERMILLION, Picture, draw, write_csv

MARKS = {"multi_position": ("o", BLUE), "six_position": ("s", ORANGE)}
NOTE = (
    "Each mark is a pose: the direction of “up” in the sensor's frame, seen from +z (left) and "
    "from −z (right), equal areas; rings every 30°. Good: marks all over both halves, no hole "
    "wider than 50°. A direction without marks is one in which errors stay unseen: add poses where "
    "the ring is, the middle of the largest hole."
)
# the six faces, and the cosine of the angle within which a pose is on one, 20 degrees
FACES = {
    f"{sign}{axis}": np.eye(3)[i] * (1 if sign == "+" else -1)
    for i, axis in enumerate("xyz")
    for sign in "+−"
}
NEAR = 0.94


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
    """Return the direction of each pose that feels any, shape (n, 3), by kind of session."""
    found = {}
    for session in device.used:
        if session.kind in MARKS:
            own = device.poses["session"] == session.name
            force = np.column_stack([device.poses[c][own] for c in ACCELERATION])
            norm = np.linalg.norm(force, axis=1, keepdims=True)
            felt = norm[:, 0] > 0
            if felt.any():
                found.setdefault(session.kind, []).append(force[felt] / norm[felt])
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
        {
            **dict(zip(("up_x", "up_y", "up_z"), everything.T, strict=True)),
            "kind": [kind for kind, u in directions.items() for _ in u],
        },
    )

    def plot(axes):
        circle = np.exp(1j * np.linspace(0, 2 * np.pi, 61))
        for ax, sign, title in zip(axes, (1, -1), ("seen from +z", "seen from −z"), strict=True):
            ax.set_axis_off()
            ax.set_xlim(-1.3, 1.3)
            # one unit as long up as aside
            ax.set_ylim(-1.45, 2.6 * ax.height / ax.width - 1.45)
            # rings at 30, 60 and 90 degrees from the pole
            for ring in (30, 60, 90):
                r = np.sqrt(2) * np.sin(np.radians(ring) / 2)
                ax.plot(r * circle.real, r * circle.imag, color=GRID, lw=0.8)
            for kind, u in directions.items():
                mark, colour = MARKS[kind]
                seen = u[:, 2] * sign >= 0
                said = [f"{kind}, “up” {_components(v)}" for v in u[seen]]
                ax.plot(*_project(u[seen], sign), mark, color=colour, ms=6, titles=said)
            if hole[2] * sign >= 0:
                x, y = _project(hole[None], sign)
                ring = 0.12 * circle
                ax.plot(x + ring.real, y + ring.imag, color=VERMILLION, lw=2.5)
            for text, x, y in (
                ("+x" if sign > 0 else "−x", 1.17, 0),
                ("−x" if sign > 0 else "+x", -1.17, 0),
                ("+y", 0, 1.14),
                ("−y", 0, -1.14),
            ):
                ax.text(x, y, text, "center")
            ax.text(0, -1.36, title, "center")

    counts = " and ".join(f"{len(u)} {kind} poses" for kind, u in directions.items())
    missing = [words for words, u in FACES.items() if (everything @ u).max() < NEAR]
    faces = f"no pose within 20° of {joined(missing)}" if missing else "all six faces are covered"
    caption = (
        f"{counts}; {faces}; the largest hole is around {direction_words(hole)}, "
        f"{number(np.degrees(angle), 2)}° from the nearest pose."
    )
    name = f"{device.name}.poses"
    svg = draw(
        name,
        f"Attitudes covered: {caption}",
        440,
        240,
        plot,
        (4, 4, 4, 4),
        columns=(1, 1),
        gap=(8, 0),
    )
    return Picture(name, svg, caption, NOTE, (csv,))


def _components(u):
    return ", ".join(f"{axis} {v:.2f}".replace("-", "−") for axis, v in zip("xyz", u, strict=True))


def _project(u, sign):
    """Return directions of one hemisphere in Lambert's equal-area projection of its pole.

    Seen from outside along the axis; the lower half is turned about y, so x runs to the left.
    """
    r = np.sqrt(1 + np.abs(u[:, 2]))
    return sign * u[:, 0] / r, u[:, 1] / r
