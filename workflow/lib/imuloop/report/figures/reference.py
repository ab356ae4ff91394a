"""A sensor beside a reference: its errors over time, over durations, and where the marker is."""

import numpy as np

from imuloop.report.figures.arms import ellipse
from imuloop.report.figures.drawing import BLUE, INK, ORANGE, PAGE, drawn
from imuloop.report.figures.residuals import elapsed
from imuloop.report.figures.time_series import clock
from imuloop.report.numbers import number
from imuloop.report.results import XYZ
from imuloop.report.tables.table import Table
from imuloop.report.units import RESIDUAL
from imuloop.report.verdict import RESIDUAL_WORDS, change

STAGES = {"logged": "As logged", "calibrated": "Calibrated", "final": "With the effects"}


def duration_table(block):
    """Return the errors of attitude and of the vertical over durations; None without any."""
    rows = [
        (
            f"{entry['seconds']:g}\u202fs",
            what,
            *(RESIDUAL["rad"].size(entry[k][what], 3) for k in (*STAGES, "floor")),
            str(entry["n"]),
        )
        for what in ("rotation", "vertical")
        for entry in block.get("by_duration", ())
    ]
    heads = ("Over", "Of the", *(f"{v}, °" for v in STAGES.values()), "Noise alone, °", "Count")
    caption = "Error of the integrated attitude beside the reference, held out, root mean square"
    return Table(caption, heads, rows) if rows else None


def reference_pictures(device, sensor, block):
    """Return the errors of each window over time, and the arm from the marker where one is."""
    found = []
    for name, residual in block["residuals"].items():
        table = device.reference[device.reference["residual"] == name].reset_index(drop=True)
        found.append(_over_time(device, sensor, name, residual, table, bool(block["effects"])))
    arms = [e for e in block["effects"] if e["constants"].get("marker")]
    return found + [_arm(device, effect) for effect in arms]


def _over_time(device, sensor, name, residual, table, changed):
    display, (seconds, starts) = RESIDUAL[residual["unit"]], elapsed(table)
    unit, size = clock(seconds.max())
    columns = {key: table[key] for key in ("session", "start_s", "end_s")}
    columns |= {key: table[f"{name}_{key}"] for key in ("before", "after", "floor")}
    before, after, floor = (columns[k].to_numpy() * display.factor for k in list(columns)[3:])

    def plot(area):
        if changed:
            area.plot(
                seconds / size, before, "o", color=ORANGE, mfc=PAGE, mew=1, ms=3, label="before"
            )
        area.plot(seconds / size, after, "o", color=BLUE, ms=3, label="after")
        area.plot(seconds / size, floor, color=INK, ls="--", lw=1, label="floor from noise")
        for session, start in starts.items() if len(starts) > 1 else ():
            area.axvline(start / size, color=INK, lw=0.8)
            where = area.get_xaxis_transform()
            area.text(start / size, 0.98, f" {session}", rotation=90, va="top", transform=where)
        area.set_yscale("log")
        area.set(xlabel=f"time, {unit}", ylabel=f"error, {display.unit}")

    words = RESIDUAL_WORDS[name]
    caption = f"{words[0].upper()}{words[1:]}, held out: {change(residual, changed)}."
    kind = f"The {sensor} beside a reference"
    return drawn(device, f"{sensor}_{name}", kind, caption, plot, columns, size=(1000, 270))


def _arm(device, effect):
    at = 1e3 * np.array([effect["parameters"][f"r{k}"] for k in XYZ])
    std = 1e3 * np.array([effect["std"][f"r{k}"] for k in XYZ])
    span = 1.2 * (np.abs(at) + std).max()

    def plot(areas):
        for area, view in zip(areas, ([0, 1], [0, 2], [1, 2]), strict=True):
            area.plot(0, 0, "s", color=INK, ms=6, label=None if view[1] == 2 else "marker")
            looks = {"color": BLUE, "label": None if view[1] == 2 else "sensor, 1 σ"}
            area.plot(*(at[view][:, None] + ellipse(np.diag(std[view] ** 2))), **looks)
            area.plot(*at[view], "o", color=BLUE, ms=5)
            area.set(xlim=(-span, span), ylim=(-span, span), box_aspect=1)
            area.set(xlabel=f"{XYZ[view[0]]}, mm", ylabel=f"{XYZ[view[1]]}, mm")

    places, errors = (", ".join(number(v, 2) for v in x) for x in (at, std))
    caption = (
        f"The sensor, from the reference's marker, on its own axes: ({places})\u202fmm, σ {errors}."
    )
    columns = {"axis": XYZ, "mm": at, "std_mm": std}
    looks = {"size": (1000, 330), "columns": (1, 1, 1)}
    return drawn(device, "reference_arm", "Where the sensor sits", caption, plot, columns, **looks)
