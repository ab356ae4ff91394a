"""A sensor beside a reference: its errors over time, over durations, and where the marker is."""

import numpy as np
import pandas as pd

from imuloop.core.errors import joined, plural
from imuloop.report.figures.arms import ellipse
from imuloop.report.figures.drawing import (
    AXES,
    BLUE,
    BROWN,
    GREEN,
    INK,
    ORANGE,
    PAGE,
    PURPLE,
    VERMILLION,
    drawn,
)
from imuloop.report.figures.residuals import elapsed
from imuloop.report.figures.time_series import clock
from imuloop.report.numbers import duration, number
from imuloop.report.results import XYZ
from imuloop.report.tables.table import Table
from imuloop.report.units import RESIDUAL
from imuloop.report.verdict import RESIDUAL_WORDS, change

STAGES = {
    "logged": ("As logged", GREEN),
    "calibrated": ("Calibrated", ORANGE),
    "final": ("With the effects", BLUE),
}
# why stretches of a reference were cut
CUTS = {
    "lost": (BROWN, "lost"),
    "swapped": (PURPLE, "swapped markers"),
    "leaps": (VERMILLION, "leaps of place"),
}


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
    heads = ("Over", "Of the", *(f"{v}, °" for v, _ in STAGES.values()), "Noise alone, °", "Count")
    caption = "Error of the integrated attitude beside the reference, held out, root mean square"
    return Table(caption, heads, rows) if rows else None


def reference_pictures(device, sensor, block):
    """Return pictures of a sensor beside a reference.

    The stretch that turned most, the errors of each window over time, and the arm from the marker
    where one was found.
    """
    found = [_series(device, block)] if "series" in block else []
    for name, residual in block["residuals"].items():
        table = device.reference[device.reference["residual"] == name].reset_index(drop=True)
        found.append(_over_time(device, sensor, name, residual, table, bool(block["effects"])))
    arms = [e for e in block["effects"] if e["constants"].get("marker")]
    return found + [_arm(device, effect) for effect in arms]


def _series(device, block):
    shown = block["series"]
    stages = [k for k in STAGES if k != "final" or block["effects"]]
    errors = {k: np.array(shown[k]) * RESIDUAL["rad"].factor for k in stages}
    t, pair = np.array(shown["t_s"]), [np.array(shown[k]) for k in ("reference", "sensor")]

    def plot(areas):
        for k, colour in enumerate(AXES):
            areas[0].plot(t, pair[0][:, k], color=colour, lw=1, label=XYZ[k])
            areas[0].plot(t, pair[1][:, k], "o", color=colour, ms=2.5)
        areas[0].plot([], [], "o", color=INK, ms=2.5, label="by the gyroscope")
        areas[0].set_ylabel("up on these axes, 1")
        for stage, error in errors.items():
            words, colour = STAGES[stage]
            areas[1].plot(t, error, color=colour, label=words.lower())
        areas[1].set(xlabel="time, s", ylabel="error, °")

    last = stages[-1]
    sizes = [
        f"{RESIDUAL['rad'].text(np.sqrt(np.mean(np.square(shown[k]))), 2)} {STAGES[k][0].lower()}"
        for k in stages
    ]
    caption = (
        f"{shown['session']}, the {np.ptp(t):.0f}\u202fs that turned most. Above: where up is on "
        "the sensor's axes, by the reference (lines) and by the gyroscope "
        f"{STAGES[last][0].lower()} (dots), carried from the start by models that never saw it. "
        f"Below: how far that attitude is off, root mean square {', '.join(sizes)}."
    )
    columns = {"t_s": t, **{f"{k}_deg": e for k, e in errors.items()}}
    for name, vertical in zip(("reference", "gyroscope"), pair, strict=True):
        columns |= {f"{name}_up_{k}": v for k, v in zip(XYZ, vertical.T, strict=True)}
    kind, looks = "Reference and integrated gyroscope", {"size": (1000, 380), "rows": (1, 1)}
    return drawn(device, "gyroscope_reference_series", kind, caption, plot, columns, **looks)


def _over_time(device, sensor, name, residual, table, changed):
    display, stages = RESIDUAL[residual["unit"]], ("before", "after", "floor")
    columns = table[["session", "start_s", "end_s"]].assign(cut="")
    columns = columns.assign(**{k: table[f"{name}_{k}"] for k in stages})
    cuts = _cuts(device, sensor, table)
    columns = pd.concat([columns, cuts], ignore_index=True)
    seconds, starts = elapsed(columns)
    unit, size = clock(seconds.max())
    before, after, floor = (columns[k] * display.factor for k in stages)

    def plot(area):
        if changed:
            area.plot(
                seconds / size, before, "o", color=ORANGE, mfc=PAGE, mew=1, ms=3, label="before"
            )
        area.plot(seconds / size, after, "o", color=BLUE, ms=3, label="after")
        area.plot(seconds / size, floor, color=INK, ls="--", lw=1, label="floor from noise")
        where = area.get_xaxis_transform()
        for session, start in starts.items() if len(starts) > 1 else ():
            area.axvline(start / size, color=INK, lw=0.8)
            area.text(start / size, 0.92, f" {session}", rotation=90, va="top", transform=where)
        for reason in cuts["cut"].unique():
            own = columns["cut"] == reason
            spans = np.column_stack([seconds, columns["end_s"] - columns["start_s"]])[own] / size
            colour, label = CUTS[reason]
            # with an outline, so that a short one shows
            looks = {"color": colour, "lw": 1, "transform": where, "label": label}
            area.broken_barh(spans, (0.95, 0.05), **looks)
        area.set_yscale("log")
        area.set(xlabel=f"time, {unit}", ylabel=f"error, {display.unit}")

    words = RESIDUAL_WORDS[name]
    caption = f"{words[0].upper()}{words[1:]}: {change(residual, changed)}."
    if len(cuts):
        lengths = (cuts["end_s"] - cuts["start_s"]).groupby(cuts["cut"], sort=False)
        parts = [
            f"{CUTS[reason][1]} {duration(own.sum())} in {plural(len(own), 'stretch', 'es')}"
            for reason, own in lengths
        ]
        caption += f" Cut of the reference, the strip on top: {joined(parts)}."
    kind = f"The {sensor} beside a reference"
    return drawn(device, f"{sensor}_{name}", kind, caption, plot, columns, size=(1000, 270))


def _cuts(device, sensor, table):
    """Return what was cut of the reference: a row per stretch, ``session start_s end_s cut``."""
    last, rows = table.groupby("session")["end_s"].max(), []
    for session in device.sessions:
        cut = session.quality.get("reference", {}).get("cut", {})
        for reason in CUTS if session.name in last else ():
            if reason == "leaps" and sensor == "gyroscope":
                continue
            rows += [(session.name, *span, reason) for span in cut.get(reason, ())]
    return pd.DataFrame(rows, columns=["session", "start_s", "end_s", "cut"])


def _arm(device, effect):
    at = 1e3 * np.array([effect["parameters"][f"r{k}"] for k in XYZ])
    std = 1e3 * np.array([effect["std"][f"r{k}"] for k in XYZ])
    span = 1.2 * (np.abs(at) + std).max()

    def plot(areas):
        for area, view in zip(areas, ([0, 1], [0, 2]), strict=True):
            area.plot(0, 0, "s", color=INK, ms=6, label=None if view[1] == 2 else "marker")
            looks = {"color": BLUE, "label": None if view[1] == 2 else "sensor, 1 σ"}
            area.plot(*(at[view][:, None] + ellipse(np.diag(std[view] ** 2))), **looks)
            area.plot(*at[view], "o", color=BLUE, ms=3)
            area.set(xlim=(-span, span), ylim=(-span, span), box_aspect=1)
            area.set(xlabel=f"{XYZ[view[0]]}, mm", ylabel=f"{XYZ[view[1]]}, mm")

    places, errors = (", ".join(number(v, 2) for v in x) for x in (at, std))
    caption = (
        f"The sensor, from the reference's marker, on its own axes: ({places})\u202fmm, σ {errors}."
    )
    columns = {"axis": XYZ, "mm": at, "std_mm": std}
    looks = {"size": (440, 260), "columns": (1, 1)}
    return drawn(device, "reference_arm", "Where the sensor sits", caption, plot, columns, **looks)
