"""Where the axes of an accelerometer sit: the arms that the motion showed, with their σ."""

import numpy as np

from imuloop.report.figures.drawing import AXES, PAGE, drawn
from imuloop.report.numbers import number
from imuloop.report.results import XYZ

NAME = "lever_arm"


def arm_pictures(device, block):
    """Return the drawing of the arms, of a device in whose motion they were found."""
    if NAME not in (e["name"] for e in block["effects"]):
        return []
    force = device.calibrations["final"].accelerometer
    own = np.array([name.partition(".")[0] == NAME for name in force.names])
    [arms] = (e.vector for e in force.effects if e.name == NAME)
    # mm; z sits at the origin
    places, covariance = np.zeros((3, 3)), np.zeros((9, 9))
    places[:2] = 1e3 * arms.reshape(2, 3)
    covariance[:6, :6] = 1e6 * force.covariance[np.ix_(own, own)]
    std = np.sqrt(np.diag(covariance)).reshape(3, 3)
    span = 1.15 * (np.abs(places) + std).max()

    def plot(areas):
        for area, view in zip(areas, ([0, 1], [0, 2], [1, 2]), strict=True):
            for axis, colour in enumerate(AXES):
                at, rows = places[axis, view], 3 * axis + np.array(view)
                outline = at[:, None] + ellipse(covariance[np.ix_(rows, rows)])
                area.plot(*outline, color=colour, lw=1, label=None if axis else "1 σ")
                area.plot(*at, "o", color=colour, mec=PAGE, ms=6)
                area.annotate(XYZ[axis], at, (5, 5), textcoords="offset points")
            area.set(xlim=(-span, span), ylim=(-span, span), box_aspect=1)
            area.set(xlabel=f"{XYZ[view[0]]}, mm", ylabel=f"{XYZ[view[1]]}, mm")

    x, y = (
        f"{XYZ[k]} at ({', '.join(number(v, 2) for v in places[k])})\u202fmm, σ "
        f"{', '.join(number(s, 2) for s in std[k])}"
        for k in range(2)
    )
    caption = f"Proof masses of the accelerometer, from that of z, on body axes: {x}, and {y}."
    columns = {f"{a}_mm": places[:, k] for k, a in enumerate(XYZ)}
    columns |= {f"{a}_std_mm": std[:, k] for k, a in enumerate(XYZ)}
    kind, looks = "Where the accelerometer's axes sit", {"size": (1000, 330), "columns": (1, 1, 1)}
    return [drawn(device, NAME, kind, caption, plot, {"axis": XYZ} | columns, **looks)]


def ellipse(covariance):
    """Return the outline of 1 σ about a point of the plane, (2, n), from its covariance, (2, 2)."""
    size, axes = np.linalg.eigh(covariance)
    turn = np.linspace(0, 2 * np.pi, 73)
    return axes * np.sqrt(np.maximum(size, 0)) @ [np.cos(turn), np.sin(turn)]
