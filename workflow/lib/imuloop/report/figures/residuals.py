"""Residual of each pose or turn, before and after the added effects."""

import numpy as np

from imuloop.core.samples import ACCELERATION, TEMPERATURE
from imuloop.report.figures.drawing import BLUE, INK, ORANGE, PAGE, Picture
from imuloop.report.figures.time_series import clock
from imuloop.report.page import WORDS, phrase
from imuloop.report.results import XYZ
from imuloop.report.units import DEGREE_PER_SECOND, DEGREES, data_sheet

# residuals of a move, and of a window with a reference
OF_MOVES = ("rotation", "velocity_vertical", "velocity_horizontal")
OF_WINDOWS = ("reference_rotation", "reference_force")
# cosine of 30 degrees: a turn about an axis is within this angle of it
ABOUT = 0.87
TURN_AXES = [*(f"{sign}{axis}" for axis in XYZ for sign in "+−"), "mixed"]


def residual_pictures(device, block):
    """Return a picture for each kind of residual of poses, moves or windows with a reference."""
    pictures = []
    for name in block["residuals"] if block["part"] != "static_record" else ():
        table = device.moves if name in OF_MOVES else device.poses
        table = device.reference if name in OF_WINDOWS else table
        # poses on six faces are not diagnosed
        table = table[np.isfinite(table[f"{name}_after"])]
        pictures.append(_picture(device, name, table, block))
    return pictures


def elapsed(table):
    """Return the start of each row, s, with the sessions end to end, and each session's start."""
    length = table.groupby("session", sort=False)["end_s"].max()
    first = length.cumsum() - length
    return (table["start_s"] + table["session"].map(first)).to_numpy(), dict(first)


def against(name, table):
    """Return the quantities on the x axes of the pictures of a kind of residual.

    By the name of a column of the CSV file, each is a label with a unit, and values, (n,).
    """
    time, _ = elapsed(table)
    unit, size = clock(time.max())
    found = {f"time_{unit}": (f"time, {unit}", time / size)}
    if name in OF_MOVES:
        if name != "rotation":
            knock = table["knock_m_s"].to_numpy() * 1e3
            found["knock_mm_s"] = "knock between two samples, mm/s", knock
        angle = table["angle_rad"].to_numpy() * DEGREES.factor
        speed = table["speed_rad_s"].to_numpy() * DEGREE_PER_SECOND.factor
        axes = table[["axis_x", "axis_y", "axis_z"]].to_numpy()
        found["angle_deg"] = "angle turned, °", angle
        found["speed_deg_s"] = "greatest speed, °/s", speed
        found["axis"] = "about axis", np.array([turn_axis(u) for u in axes])
    elif name not in OF_WINDOWS:
        force = table[list(ACCELERATION)].to_numpy()
        up = (force / np.linalg.norm(force, axis=1)[:, None]).T
        found |= {f"up_{a}": (f"{a} of “up”, 1", v) for a, v in zip(XYZ, up, strict=True)}
        if np.isfinite(table[TEMPERATURE]).any():
            found["temperature_degC"] = "temperature, °C", table[TEMPERATURE].to_numpy()
    return found


def turn_axis(direction):
    """Return the index among `TURN_AXES` of the axis of a turn."""
    axis = int(np.abs(direction).argmax())
    mixed = abs(direction[axis]) < ABOUT
    return len(TURN_AXES) - 1 if mixed else 2 * axis + (direction[axis] <= 0)


def draw_residuals(area, x, before, after, floor):
    """Draw the residual of each pose or turn over `x`; `before` is None if the model stayed."""
    order = np.argsort(x, kind="stable")
    signed = min(np.min(e) for e in (before, after) if e is not None) < 0
    for sign in (1, -1) if signed else (1,):
        looks = {"color": INK, "ls": "--", "lw": 1, "label": "floor from noise"}
        area.plot(x[order], sign * floor[order], **looks)
    if before is not None:
        area.plot(x, before, "o", color=ORANGE, mfc=PAGE, mew=1.2, ms=4, label="before")
    words = "residual" if before is None else "after"
    area.plot(x, after, "o", color=BLUE, ms=4.5, label=words)
    if not signed:
        area.set_ylim(0)


def _picture(device, name, table, block):
    """Return the picture of one kind of residual, `name`.

    `table` has a row per pose, move or window; `block` is the diagnosis that the residual is of.
    """
    residual, changed = block["residuals"][name], bool(block["effects"])
    display, (words, short, _) = data_sheet(residual["unit"]), WORDS["residuals"][name]
    errors = {when: table[f"{name}_{when}"].to_numpy() for when in ("before", "after", "floor")}
    before, after, floor = (values * display.factor for values in errors.values())
    panels, (time, sessions) = against(name, table), elapsed(table)
    numbers = {column: table[column] for column in ("session", "pose", "start_s")} | errors
    for key, (_, x) in panels.items():
        numbers[key] = [TURN_AXES[i] for i in x] if key == "axis" else x

    def plot(areas):
        """Draw the residuals against each quantity on an area of its own."""
        areas = np.atleast_1d(areas)
        for area, (key, (label, x)) in zip(areas, panels.items(), strict=True):
            # against time, each mark has its floor; elsewhere that would jump, so draw the median
            level = floor if area is areas[0] else np.full(len(x), np.median(floor))
            draw_residuals(area, x, before if changed else None, after, level)
            area.set_xlabel(label)
            if key == "axis":
                area.set_xlim(-0.6, len(TURN_AXES) - 0.4)
                area.set_xticks(range(len(TURN_AXES)), [*TURN_AXES[:-1], "mix"])
        for session, start in sessions.items() if len(sessions) > 1 else ():
            at, where = start / clock(time.max())[1], areas[0].get_xaxis_transform()
            areas[0].axvline(at, color=INK, lw=0.8)
            areas[0].text(at, 0.98, f" {session}", rotation=90, va="top", transform=where)
        areas[0].set_ylabel(f"{short}, {display.unit}")

    worst = np.abs(after).argmax()
    thing = "turn" if name in OF_MOVES else "window" if name in OF_WINDOWS else "pose"
    place = f"{thing} {table['pose'].iloc[worst]}"
    place += f" of {table['session'].iloc[worst]}" if len(sessions) > 1 else ""
    largest = display.text(abs(errors["after"][worst]))
    caption = phrase(
        "residual", words=words, r=residual, changed=changed, largest=largest, place=place
    )
    widths = (2.2, *(1.3 if k == "axis" else 1 for k in list(panels)[1:]))
    kind, looks = f"Residuals of the {block['sensor']}", {"size": (1000, 270), "columns": widths}
    return Picture(f"{device.name}.{block['sensor']}_{name}", kind, caption, plot, numbers, **looks)
