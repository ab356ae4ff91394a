"""How the bias wandered over a static record, before and after correction, with temperature."""

import numpy as np
import pandas as pd

from imuloop.core.samples import TEMPERATURE, TIME
from imuloop.report.figures.drawing import AXES, BLUE, INK, ORANGE, PURPLE, picture, write_csv
from imuloop.report.figures.time_series import clock, extremes
from imuloop.report.numbers import RESIDUAL, number
from imuloop.report.results import XYZ

# stretches that a line is cut into, two points each
BUCKETS = 64


def bias_pictures(device, sensor, block):
    """Return how a sensor's bias wandered over each static record, against the floor."""
    points = block.get("points")
    if not points:
        return []
    return [
        _picture(device, sensor, session, found, block)
        for session, found in pd.DataFrame(points).groupby("session", sort=False)
    ]


def temperatures(session, start):
    """Return the mean temperature over each window, °C; None where it was not logged.

    Parameters
    ----------
    session : Session
    start : ndarray, shape (n,)
        Start of each window, s; a window ends where the next may start.
    """
    if TEMPERATURE not in session.samples or len(start) < 2:
        return None
    edges = np.column_stack([start, start + np.median(np.diff(start))])
    edges = np.searchsorted(session.samples[TIME], edges)
    value = session.samples[TEMPERATURE]
    known = np.isfinite(value)
    value[~known] = 0.0
    total, count = (np.add.reduceat(np.append(v, 0.0), edges.ravel())[::2] for v in (value, known))
    count[edges[:, 0] == edges[:, 1]] = 0
    if not count.any():
        return None
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def draw_bias(areas, t, before, after, floor, logged=None, size=1.0):
    """Draw the means of the three axes, corrected ones too, their floor, and temperature.

    Parameters
    ----------
    areas : list of Axes
        One for all axes, or one for each where there is an `after`; one more for temperature.
    t : ndarray, shape (n,)
        Start of each mean, s, shown in units of `size`.
    before, after : ndarray, shape (n, 3), or None
        Means about one level, in the unit shown.
    floor : ndarray, shape (n,)
        Standard deviation by noise alone.
    logged : ndarray, shape (n,), optional
        Temperature, °C.
    """

    def line(area, y, colour, width=1.0, ls="-"):
        chosen = extremes(y, BUCKETS)
        return area.plot(t[chosen] / size, y[chosen], color=colour, lw=width, ls=ls)

    for area in areas[: 1 if after is None else 3]:
        for sign in (1, -1):
            limit = line(area, sign * floor, INK, ls="--")
    if after is None:
        handles = [
            h for colour, y in zip(AXES, before.T, strict=True) for h in line(areas[0], y, colour)
        ]
    else:
        for area, old, new in zip(areas, before.T, after.T, strict=False):
            handles = line(area, old, ORANGE, 1.4) + line(area, new, BLUE)
    if logged is not None:
        line(areas[-1], logged, PURPLE, 1.4)
        areas[-1].set_ylabel("°C")
    return handles + limit, [*(XYZ if after is None else ("before", "after")), "floor, 1 σ"]


def _picture(device, sensor, session, points, block):
    display = RESIDUAL[block["residuals"]["bias"]["unit"]]
    t, floor = (points[k].to_numpy(float) for k in ("start_s", "floor"))
    before, floor, after = np.stack(points["values"].to_numpy()), floor / np.sqrt(3), None
    if block.get("effects") and "corrected" in points and points["corrected"].notna().all():
        after = np.stack(points["corrected"].to_numpy())
    logged = temperatures(next(s for s in device.sessions if s.name == session), t)
    columns = {"start_s": t, "floor": floor, **dict(zip(XYZ, before.T, strict=True))}
    if after is not None:
        columns |= {f"{axis}_corrected": y for axis, y in zip(XYZ, after.T, strict=True)}
    if logged is not None:
        columns["temperature_degC"] = logged
    unit, size = clock(t[-1])
    count, warm = 1 if after is None else 3, logged is not None

    def plot(areas):
        areas = areas if isinstance(areas, list) else [areas]
        for area, axis in zip(areas, XYZ[:count], strict=False):
            area.set_ylabel(f"{axis if count == 3 else 'mean minus bias'}, {display.unit}")
        areas[-1].set_xlabel(f"time, {unit}")
        shown = (None if y is None else y * display.factor for y in (before, after, floor))
        return draw_bias(areas, t, *shown, logged, size)

    return picture(
        f"{device.name}.{session}.bias_{sensor}",
        "Means at rest",
        _finding(session, sensor, before, after, floor, logged, display),
        plot,
        (440, 270 + 70 * warm + 130 * (count == 3)),
        write_csv(device.figures, f"{session}_bias_{sensor}", columns),
        rows=(3 if count == 1 else 2,) * count + (1.4,) * warm,
        sharex=True,
    )


def _finding(session, sensor, before, after, floor, logged, display):
    """Return how far the bias moved, before and after, and over which temperatures."""
    spans = [
        [number(v, 2) for v in np.ptp(x, axis=0) * display.factor]
        for x in (before, after)
        if x is not None
    ]
    moved = ", ".join(" → ".join(pair) for pair in zip(*spans, strict=True))
    text = (
        f"{session}, {sensor}: the bias moves by {moved} {display.unit} from peak to peak "
        f"(x, y, z{'; before → after' if after is not None else ''}); noise alone, 1 σ, "
        f"{number(np.nanmean(floor) * display.factor, 2)} {display.unit}"
    )
    if logged is not None:
        low, high = (number(f(logged)) for f in (np.nanmin, np.nanmax))
        text += f"; temperature {low} to {high} °C"
    return f"{text}."
