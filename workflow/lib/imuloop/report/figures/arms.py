"""Where the axes of an accelerometer sit: the arms that the motion showed, with their σ."""

import numpy as np

from imuloop.report.figures.drawing import AXES, INK, PAGE, picture, write_csv
from imuloop.report.numbers import joined, number
from imuloop.report.results import XYZ

NAME = "lever_arm"
# axes to the right and up of each view
VIEWS = ((0, 1), (0, 2), (1, 2))


def arm_pictures(device, block):
    """Return the drawing of the arms, of a device in whose motion they were found."""
    if NAME not in (e["name"] for e in block["effects"]):
        return []
    force = device.calibrations["final"].accelerometer
    [fitted] = (e for e in force.effects if e.name == NAME)
    own = [force.names.index(f"{NAME}.{p}") for p in fitted.values]
    places = np.append(fitted.vector, np.zeros(3)).reshape(3, 3) * 1e3
    covariance = np.zeros((3, 3, 3))
    for axis in range(2):
        at = own[3 * axis : 3 * axis + 3]
        covariance[axis] = force.covariance[np.ix_(at, at)] * 1e6
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    span = 1.15 * (np.abs(places) + std).max()

    def plot(areas):
        for area, view in zip(areas, VIEWS, strict=True):
            for axis, colour in enumerate(AXES):
                at = places[axis, view]
                around = at[:, None] + ellipse(covariance[axis][np.ix_(view, view)])
                area.plot(*around, color=colour, lw=1, label=None if axis else "1 σ")
                area.plot(*at, "o", color=colour, mec=PAGE, ms=6)
                area.annotate(XYZ[axis], at, (5, 5), textcoords="offset points", color=INK)
            area.set(xlim=(-span, span), ylim=(-span, span), box_aspect=1)
            area.set(xlabel=f"{XYZ[view[0]]}, mm", ylabel=f"{XYZ[view[1]]}, mm")

    said = (
        f"that of {XYZ[axis]} at ({', '.join(number(v, 2) for v in places[axis])})\u202fmm, σ "
        f"{', '.join(number(s, 2) for s in std[axis])}"
        for axis in range(2)
    )
    table = {"axis": XYZ} | {f"{a}_mm": places[:, k] for k, a in enumerate(XYZ)}
    return [
        picture(
            f"{device.name}.{NAME}",
            "Where the accelerometer's axes sit",
            f"Proof masses of the accelerometer, from that of z, on body axes: {joined([*said])}.",
            plot,
            (1000, 330),
            write_csv(
                device.figures, NAME, table | {f"{a}_std_mm": std[:, k] for k, a in enumerate(XYZ)}
            ),
            columns=(1, 1, 1),
        )
    ]


def ellipse(covariance):
    """Return the outline of 1 σ about a point of the plane, (2, n), from its covariance, (2, 2)."""
    size, axes = np.linalg.eigh(covariance)
    turn = np.linspace(0, 2 * np.pi, 73)
    return axes * np.sqrt(np.maximum(size, 0)) @ [np.cos(turn), np.sin(turn)]
