"""Residual of each pose or turn, before and after the added effects."""

import numpy as np

from imuloop.core.samples import ACCELERATION, TEMPERATURE
from imuloop.report.figures.drawing import BLUE, INK, ORANGE, PAGE, drawn, entitle
from imuloop.report.figures.time_series import clock
from imuloop.report.numbers import number
from imuloop.report.results import XYZ
from imuloop.report.units import DEGREE_PER_SECOND, DEGREES, RESIDUAL
from imuloop.report.verdict import RESIDUAL_WORDS, change

SHORT_WORDS = {
    "gravity_norm": "magnitude error",
    "pose_rate": "angular rate",
    "rotation": "direction error",
    "velocity_vertical": "vertical",
    "velocity_horizontal": "horizontal",
    "reference_rotation": "rotation over 1 s",
    "reference_force": "specific force",
}
# residuals of a move, and of a window beside a reference
OF_MOVES = ("rotation", "velocity_vertical", "velocity_horizontal")
OF_WINDOWS = ("reference_rotation", "reference_force")
# cosine of the angle within which a turn is about one axis, 30 degrees
ABOUT = 0.87
MIXED = "mixed"
TURN_AXES = [*(f"{sign}{axis}" for axis in XYZ for sign in "+−"), MIXED]


def residual_pictures(device, sensor, block):
    """Return a picture for each kind of residual of a sensor's poses."""
    found = []
    for name in block["residuals"]:
        table = device.moves if name in OF_MOVES else device.poses
        table = device.reference if name in OF_WINDOWS else table
        # poses on six faces are not diagnosed
        table = table[np.isfinite(table[f"{name}_after"])]
        found.append(_picture(device, sensor, name, table, block))
    return found


def elapsed(table):
    """Return the start of each row with the sessions one after the other, s, and theirs by name."""
    length = table.groupby("session", sort=False)["end_s"].max()
    first = length.cumsum() - length
    return (table["start_s"] + table["session"].map(first)).to_numpy(), dict(first)


def against(name, table):
    """Return what the residuals of one kind, of poses or moves of a table, are shown against.

    By the name of a column of the CSV file: words with unit, and values in it.
    """
    time, _ = elapsed(table)
    unit, size = clock(time.max())
    found = {f"time_{unit}": (f"time, {unit}", time / size)}
    if name in OF_MOVES:
        axes = table[["axis_x", "axis_y", "axis_z"]].to_numpy()
        speed = table["speed_rad_s"].to_numpy() * DEGREE_PER_SECOND.factor
        if name != "rotation":
            knock = table["knock_m_s"].to_numpy() * 1e3
            found["knock_mm_s"] = "knock between two samples, mm/s", knock
        return found | {
            "angle_deg": ("angle turned, °", table["angle_rad"].to_numpy() * DEGREES.factor),
            "speed_deg_s": ("greatest speed, °/s", speed),
            "axis": ("about axis", np.array([TURN_AXES.index(turn_axis(u)) for u in axes])),
        }
    if name in OF_WINDOWS:
        return found
    force = table[list(ACCELERATION)].to_numpy()
    for axis, values in zip(XYZ, (force / np.linalg.norm(force, axis=1)[:, None]).T, strict=True):
        found[f"up_{axis}"] = f"{axis} of “up”, 1", values
    if np.isfinite(table[TEMPERATURE]).any():
        found["temperature_degC"] = "temperature, °C", table[TEMPERATURE].to_numpy()
    return found


def turn_axis(direction):
    """Return the axis of a turn, as ``+z``, or `MIXED`."""
    axis = int(np.abs(direction).argmax())
    if abs(direction[axis]) < ABOUT:
        return MIXED
    return f"{'+' if direction[axis] > 0 else '−'}{XYZ[axis]}"


def draw_residuals(area, x, before, after, floor):
    """Draw the residual of each pose or turn over `x`; without `before` the model did not change.

    Returns the marks of what is left.
    """
    order = np.argsort(x, kind="stable")
    signed = min(np.min(e) for e in (before, after) if e is not None) < 0
    for sign in (1, -1) if signed else (1,):
        looks = {"color": INK, "ls": "--", "lw": 1, "label": "floor from noise"}
        area.plot(x[order], sign * floor[order], **looks)
    if before is not None:
        area.plot(x, before, "o", color=ORANGE, mfc=PAGE, mew=1.2, ms=4, label="before")
    words = "residual" if before is None else "after"
    (marks,) = area.plot(x, after, "o", color=BLUE, ms=4.5, label=words)
    if not signed:
        area.set_ylim(0)
    return marks


def _picture(device, sensor, name, table, block):
    residual, changed = block["residuals"][name], bool(block["effects"])
    display = RESIDUAL[residual["unit"]]
    errors = {when: table[f"{name}_{when}"].to_numpy() for when in ("before", "after", "floor")}
    before, after, floor = (values * display.factor for values in errors.values())
    panels, (time, sessions) = against(name, table), elapsed(table)
    columns = {column: table[column] for column in ("session", "pose", "start_s")} | errors
    for key, (_, x) in panels.items():
        columns[key] = [TURN_AXES[v] for v in x] if key == "axis" else x
    several, words = len(sessions) > 1, RESIDUAL_WORDS[name]
    thing = "turn" if name in OF_MOVES else "window" if name in OF_WINDOWS else "pose"
    things = [
        f"{thing} {i}" + f" of {session}" * several
        for session, i in zip(table["session"], table["pose"], strict=True)
    ]
    said = [
        f"{one}: {f'{number(b)} → ' if changed else ''}{number(a)} {display.unit}"
        for one, b, a in zip(things, before, after, strict=True)
    ]

    def plot(areas):
        areas = np.atleast_1d(areas)
        for area, (key, (label, x)) in zip(areas, panels.items(), strict=True):
            # over time the floor of each; elsewhere it would jump from mark to mark
            first = area is areas[0]
            level = floor if first else np.full(len(x), np.median(floor))
            marks = draw_residuals(area, x, before if changed else None, after, level)
            if first:
                entitle(area, marks, said)
            area.set_xlabel(label)
            if key == "axis":
                area.set_xlim(-0.6, len(TURN_AXES) - 0.4)
                area.set_xticks(range(len(TURN_AXES)), [*TURN_AXES[:-1], "mix"])
        for session, start in sessions.items() if several else ():
            at = start / clock(time.max())[1]
            areas[0].axvline(at, color=INK, lw=0.8)
            where = areas[0].get_xaxis_transform()
            areas[0].text(at, 0.98, f" {session}", rotation=90, va="top", transform=where)
        areas[0].set_ylabel(f"{SHORT_WORDS[name]}, {display.unit}")

    worst = np.abs(after).argmax()
    caption = (
        f"{words[0].upper()}{words[1:]}: {change(residual, changed)}. Largest left: "
        f"{display.text(abs(errors['after'][worst]))}, {things[worst]}."
    )
    widths = (2.2, *(1.3 if k == "axis" else 1 for k in list(panels)[1:]))
    kind, looks = f"Residuals of the {sensor}", {"size": (1000, 270), "columns": widths}
    return drawn(device, f"{sensor}_{name}", kind, caption, plot, columns, **looks)
