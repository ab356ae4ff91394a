"""How the bias wandered over a static record, before and after correction, with temperature."""

import numpy as np
import pandas as pd

from imuloop.core.samples import TEMPERATURE, TIME
from imuloop.report.figures.drawing import AXES, BLUE, INK, ORANGE, PURPLE, Picture
from imuloop.report.figures.time_series import clock, extremes
from imuloop.report.page import phrase
from imuloop.report.results import XYZ
from imuloop.report.units import data_sheet

# parts that a line is cut into, two points each
BUCKETS = 64
# keys of a point of diagnosis.json
COLUMNS = ["session", "start_s", "floor", "values", "corrected"]


def bias_pictures(device, block):
    """Return pictures of a sensor's bias over each static record, against the floor."""
    points = pd.DataFrame(block.get("points", ()), columns=COLUMNS)
    return [
        _picture(device, name, rows, block) for name, rows in points.groupby("session", sort=False)
    ]


def temperatures(session, start):
    """Return the mean temperature over each window, °C; None if it was not logged.

    A window begins at each `start`, shape (n,), s, and ends where the next may start.
    """
    if TEMPERATURE not in session.samples or len(start) < 2:
        return None
    edges = np.column_stack([start, start + np.median(np.diff(start))])
    edges = np.searchsorted(session.samples[TIME], edges)
    value = session.samples[TEMPERATURE]
    inside = (value[i:j][np.isfinite(value[i:j])] for i, j in edges)
    means = np.array([x.mean() if len(x) else np.nan for x in inside])
    return means if np.isfinite(means).any() else None


def _picture(device, session, points, block):
    sensor, display = block["sensor"], data_sheet(block["residuals"]["bias"]["unit"])
    t, floor = (points[k].to_numpy(float) for k in ("start_s", "floor"))
    before, floor, after = np.stack(points["values"].to_numpy()), floor / np.sqrt(3), None
    if block["effects"] and points["corrected"].notna().all():
        after = np.stack(points["corrected"].to_numpy())
    warmth = temperatures(next(s for s in device.sessions if s.name == session), t)
    numbers = {"start_s": t, "floor": floor, **dict(zip(XYZ, before.T, strict=True))}
    if after is not None:
        numbers |= {f"{axis}_corrected": y for axis, y in zip(XYZ, after.T, strict=True)}
    if warmth is not None:
        numbers["temperature_degC"] = warmth
    unit, size = clock(t[-1])
    # an area for all axes, or one for each; one more for the temperature
    count, warm = 1 if after is None else 3, warmth is not None

    def line(area, y, colour, width=1.0, **looks):
        """Draw a series over time by its extremes."""
        chosen = extremes(y, BUCKETS)
        area.plot(t[chosen] / size, y[chosen], color=colour, lw=width, **looks)

    def plot(areas):
        areas = areas if isinstance(areas, list) else [areas]
        for i, (axis, colour) in enumerate(zip(XYZ, AXES, strict=True)):
            area, old = areas[i % count], before[:, i] * display.factor
            if after is None:
                line(area, old, colour, label=axis)
                area.set_ylabel(f"mean minus bias, {display.unit}")
            else:
                line(area, old, ORANGE, 1.4, label="before")
                line(area, after[:, i] * display.factor, BLUE, label="after")
                area.set_ylabel(f"{axis}, {display.unit}")
        for area in areas[:count]:
            for sign in (1, -1):
                line(area, sign * floor * display.factor, INK, ls="--", label="floor, 1 σ")
        if warm:
            line(areas[-1], warmth, PURPLE, 1.4)
            areas[-1].set_ylabel("°C")
        areas[-1].set_xlabel(f"time, {unit}")

    spans = [np.ptp(x, axis=0) for x in (before, after) if x is not None]
    moved = (" → ".join(display.size(v, 2) for v in pair) for pair in zip(*spans, strict=True))
    caption = phrase(
        "bias",
        session=session,
        sensor=sensor,
        moved=f"{', '.join(moved)} {display.unit}",
        changed=after is not None,
        floor=f"{display.size(np.nanmean(floor), 2)} {display.unit}",
        warmth=(np.nanmin(warmth), np.nanmax(warmth)) if warm else (),
    )
    return Picture(
        f"{device.name}.{session}.bias_{sensor}",
        "Means at rest",
        caption,
        plot,
        numbers,
        size=(440, 270 + 70 * warm + 130 * (count == 3)),
        rows=(3 if count == 1 else 2,) * count + (1.4,) * warm,
    )
