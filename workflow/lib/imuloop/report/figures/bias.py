"""How the bias wandered over a static record, before and after correction, with temperature."""

import numpy as np
import pandas as pd

from imuloop.core.samples import TEMPERATURE, TIME
from imuloop.report.figures.drawing import AXES, BLUE, INK, ORANGE, PURPLE, drawn
from imuloop.report.figures.time_series import clock, extremes
from imuloop.report.numbers import number
from imuloop.report.results import XYZ
from imuloop.report.units import RESIDUAL

# stretches that a line is cut into, two points each
BUCKETS = 64
# of a point of diagnosis.json what is shown
COLUMNS = ["session", "start_s", "floor", "values", "corrected"]


def bias_pictures(device, sensor, block):
    """Return how a sensor's bias wandered over each static record, against the floor."""
    points = pd.DataFrame(block.get("points", ()), columns=COLUMNS)
    return [
        _picture(device, sensor, session, found, block)
        for session, found in points.groupby("session", sort=False)
    ]


def temperatures(session, start):
    """Return the mean temperature over each window, °C; None where it was not logged.

    A window begins at each `start`, shape (n,), s, and ends where the next may start.
    """
    if TEMPERATURE not in session.samples or len(start) < 2:
        return None
    edges = np.column_stack([start, start + np.median(np.diff(start))])
    edges = np.searchsorted(session.samples[TIME], edges)
    value = session.samples[TEMPERATURE]
    inside = (value[i:j][np.isfinite(value[i:j])] for i, j in edges)
    found = np.array([x.mean() if len(x) else np.nan for x in inside])
    return found if np.isfinite(found).any() else None


def _picture(device, sensor, session, points, block):
    display = RESIDUAL[block["residuals"]["bias"]["unit"]]
    t, floor = (points[k].to_numpy(float) for k in ("start_s", "floor"))
    before, floor, after = np.stack(points["values"].to_numpy()), floor / np.sqrt(3), None
    if block["effects"] and points["corrected"].notna().all():
        after = np.stack(points["corrected"].to_numpy())
    logged = temperatures(next(s for s in device.sessions if s.name == session), t)
    columns = {"start_s": t, "floor": floor, **dict(zip(XYZ, before.T, strict=True))}
    if after is not None:
        columns |= {f"{axis}_corrected": y for axis, y in zip(XYZ, after.T, strict=True)}
    if logged is not None:
        columns["temperature_degC"] = logged
    unit, size = clock(t[-1])
    # an area for all axes, or one for each; one more for the temperature
    count, warm = 1 if after is None else 3, logged is not None

    def line(area, y, colour, width=1.0, **looks):
        chosen = extremes(y, BUCKETS)
        area.plot(t[chosen] / size, y[chosen], color=colour, lw=width, **looks)

    def plot(areas):
        areas = areas if isinstance(areas, list) else [areas]
        for i, (axis, colour) in enumerate(zip(XYZ, AXES, strict=True)):
            area = areas[i % count]
            old = before[:, i] * display.factor
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
            line(areas[-1], logged, PURPLE, 1.4)
            areas[-1].set_ylabel("°C")
        areas[-1].set_xlabel(f"time, {unit}")

    return drawn(
        device,
        f"{session}.bias_{sensor}",
        "Means at rest",
        _finding(session, sensor, before, after, floor, logged, display),
        plot,
        columns,
        size=(440, 270 + 70 * warm + 130 * (count == 3)),
        rows=(3 if count == 1 else 2,) * count + (1.4,) * warm,
    )


def _finding(session, sensor, before, after, floor, logged, display):
    """Return how far the bias moved, before and after, and over which temperatures."""
    spans = [
        [display.size(v, 2) for v in np.ptp(x, axis=0)] for x in (before, after) if x is not None
    ]
    moved = ", ".join(" → ".join(pair) for pair in zip(*spans, strict=True))
    text = (
        f"{session}, {sensor}: the bias moves by {moved} {display.unit} from peak to peak "
        f"(x, y, z{'; before → after' if after is not None else ''}); noise alone, 1 σ, "
        f"{display.size(np.nanmean(floor), 2)} {display.unit}"
    )
    if logged is not None:
        low, high = (number(f(logged)) for f in (np.nanmin, np.nanmax))
        text += f"; temperature {low} to {high} °C"
    return f"{text}."
