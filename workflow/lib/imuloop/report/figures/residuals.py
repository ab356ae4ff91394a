"""Pictures of the residual of each pose or turn, without and with effects or calibration."""

import numpy as np
import pandas as pd

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TEMPERATURE
from imuloop.core.units import DEGREE
from imuloop.report.figures.drawing import BESIDE, BLUE, GREEN, INK, ORANGE, PAGE, Picture
from imuloop.report.figures.time_series import clock
from imuloop.report.page import WORDS, phrase
from imuloop.report.results import XYZ
from imuloop.report.units import DEGREE_PER_SECOND, DEGREES, data_sheet

# residuals of a move, and of a window with a reference
OF_MOVES = ("rotation", "velocity_vertical", "velocity_horizontal")
OF_WINDOWS = ("reference_rotation", "reference_force")
LOGGED = "as logged"
# marks by the words of the key
LOOKS = {
    LOGGED: {"color": GREEN, "marker": "s", "ms": 4},
    "before": {"color": ORANGE, "marker": "o", "ms": 4, "mfc": PAGE, "mew": 1.2},
    "after": {"color": BLUE, "marker": "o", "ms": 4.5},
}


def residual_pictures(device, block):
    """Return a Picture for each kind of residual of a diagnosis, a list; empty for static records.

    `device` is a DeviceResults, and `block` the diagnosis of a sensor in one kind of data, as
    `block_of` returns it.
    """
    names = block["residuals"] if block["part"] != "static_record" else ()
    return [residual_picture(device, block, name) for name in names]


def rows_of(device, name):
    """Return the rows that have the residual `name`, from the table of poses, moves or windows.

    The residual tells which of the three tables is meant. A window is a part of a log that is
    compared with a reference. `device` is a DeviceResults, which has the tables.
    """
    table = device.moves if name in OF_MOVES else device.poses
    table = device.reference if name in OF_WINDOWS else table
    # poses on six faces are not diagnosed, so they have no residuals
    return table[np.isfinite(table[f"{name}_after"])]


def as_logged(device, name):
    """Return the sizes of the residuals of samples as logged, without calibration, (n,), SI.

    There is one for each of n poses or moves. `name` is the name of the residual, and `device` a
    DeviceResults. The result is None if the sizes are not known for this residual.
    """
    if name == "gravity_norm":
        force = np.linalg.norm(rows_of(device, name)[list(ACCELERATION)], axis=1)
        return np.abs(force - device.calibrations["final"].gravity)
    if name == "pose_rate":
        return np.linalg.norm(rows_of(device, name)[list(ANGULAR_RATE)], axis=1)
    if name == "rotation":
        turns = pd.read_parquet(device.folder / "attitude.parquet")
        turns = turns[(turns["method"] == "rotation") & (turns["model"] == "raw")]
        return DEGREE * turns.sort_values("t_s")["error_deg"].to_numpy() if len(turns) else None
    return None


def elapsed(table):
    """Return the start of each row on one clock on which all sessions follow each other, s, (n,).

    The second result is the start of each session on this clock, s, a dict by name. `table` has n
    rows, each a pose, a move or a window, with ``session``, ``start_s`` and ``end_s``.
    """
    length = table.groupby("session", sort=False)["end_s"].max()
    first = length.cumsum() - length
    return (table["start_s"] + table["session"].map(first)).to_numpy(), dict(first)


def against(name, table):
    """Return the quantities over which residuals are drawn, such as time and angle, a dict.

    The keys are the names of columns of the CSV file. A value is a tuple: a label with a unit, and
    the numbers, (n,). `name` is the name of the residual, and `table` has n rows with this
    residual, each a pose, a move or a window that is compared with a reference.
    """
    time, _ = elapsed(table)
    unit, size = clock(time.max())
    columns = {f"time_{unit}": (f"time, {unit}", time / size)}
    if name in OF_MOVES:
        if name != "rotation":
            knock = table["knock_m_s"].to_numpy() * 1e3
            columns["knock_mm_s"] = "knock, mm/s", knock
        angle = table["angle_rad"].to_numpy() * DEGREES.factor
        speed = table["speed_rad_s"].to_numpy() * DEGREE_PER_SECOND.factor
        columns["angle_deg"] = "angle turned, °", angle
        columns["speed_deg_s"] = "greatest speed, °/s", speed
    elif name not in OF_WINDOWS:
        force = table[list(ACCELERATION)].to_numpy()
        up = (force / np.linalg.norm(force, axis=1)[:, None]).T
        columns |= {f"up_{a}": (f"{a} of “up”, 1", v) for a, v in zip(XYZ, up, strict=True)}
        if np.isfinite(table[TEMPERATURE]).any():
            columns["temperature_degC"] = "temperature, °C", table[TEMPERATURE].to_numpy()
    return columns


def draw_residuals(area, x, series, floor):
    """Draw residuals and their floor, which noise alone gives, on the matplotlib Axes `area`.

    `x` are the values of the horizontal axis, (n,), for n poses, moves or windows. `series` are the
    residuals, (n,) each, by the words of the key, and `floor` is their floor, (n,). The vertical
    axis is logarithmic if one series is as logged, because it is far larger than the other series.
    """
    order = np.argsort(x, kind="stable")
    logarithmic = LOGGED in series
    signed = not logarithmic and min(np.min(values) for values in series.values()) < 0
    for sign in (1, -1) if signed else (1,):
        looks = {"color": INK, "ls": "--", "lw": 1, "label": "floor from noise"}
        area.plot(x[order], sign * floor[order], **looks)
    for words, values in series.items():
        sizes = np.abs(values) if logarithmic else values
        area.plot(x, sizes, ls="", label=words, **LOOKS.get(words, LOOKS["after"]))
    if logarithmic:
        area.set_yscale("log")
    elif not signed:
        area.set_ylim(0)


def residual_picture(device, block, name, narrow=False):
    """Return the Picture of one kind of residual of a diagnosis, over time and further quantities.

    `device` is a DeviceResults, `block` the diagnosis of a sensor in one kind of data, as
    `block_of` returns it, and `name` the name of the residual. A `narrow` picture shows the
    residuals over time alone.
    """
    residual, changed, table = (
        block["residuals"][name],
        bool(block["effects"]),
        rows_of(device, name),
    )
    display, (words, short, _) = data_sheet(residual["unit"]), WORDS["residuals"][name]
    errors = {when: table[f"{name}_{when}"].to_numpy() for when in ("before", "after", "floor")}
    logged = None if changed else as_logged(device, name)
    series = {"before": errors["before"]} if changed else {}
    # the errors of rotations as logged may exist for fewer moves than the residuals
    if logged is not None and len(logged) == len(table):
        errors["logged"] = series[LOGGED] = logged
    series["after" if changed else "calibrated"] = errors["after"]
    series = {key: values * display.factor for key, values in series.items()}
    floor = errors["floor"] * display.factor
    panels, (time, sessions) = against(name, table), elapsed(table)
    numbers = {column: table[column] for column in ("session", "pose", "start_s")} | errors
    numbers |= {key: x for key, (_, x) in panels.items()}
    panels = dict([*panels.items()][:1]) if narrow else panels

    def plot(areas):
        """Draw the residuals over each quantity.

        `areas` is one Axes, or a list with one for each.
        """
        areas = np.atleast_1d(areas)
        for area, (label, x) in zip(areas, panels.values(), strict=True):
            # against time, each mark has its floor; elsewhere that would jump, so draw the median
            level = floor if area is areas[0] else np.full(len(x), np.median(floor))
            draw_residuals(area, x, series, level)
            area.set_xlabel(label)
        for session, start in sessions.items() if len(sessions) > 1 else ():
            at, where = start / clock(time.max())[1], areas[0].get_xaxis_transform()
            areas[0].axvline(at, color=INK, lw=0.8)
            areas[0].text(at, 0.98, f" {session}", rotation=90, va="top", transform=where)
        areas[0].set_ylabel(f"{short}, {display.unit}")

    kind = f"Residuals of the {block['sensor']}"
    if narrow:
        caption = phrase("opening", name=name, n=len(table), words=[*series])
        return Picture(f"{device.name}.wrong", kind, caption, plot, numbers, size=BESIDE)
    after = errors["after"]
    worst = np.abs(after).argmax()
    thing = "turn" if name in OF_MOVES else "window" if name in OF_WINDOWS else "pose"
    place = f"{thing} {table['pose'].iloc[worst]}"
    place += f" of {table['session'].iloc[worst]}" if len(sessions) > 1 else ""
    largest = display.text(abs(after[worst]))
    caption = phrase(
        "residual", words=words, r=residual, changed=changed, largest=largest, place=place
    )
    widths = (2.2, *(1,) * (len(panels) - 1))
    name = f"{device.name}.{block['sensor']}_{name}"
    return Picture(name, kind, caption, plot, numbers, size=(1000, 270), columns=widths)
