"""The bias over a static record and against temperature, before and after the correction."""

import numpy as np
import pandas as pd
from numpy.polynomial import Polynomial

from imuloop.core.samples import TEMPERATURE, TIME
from imuloop.report.figures.drawing import (
    BLUE,
    INK,
    ORANGE,
    PURPLE,
    SMALL,
    Picture,
    fill,
)
from imuloop.report.figures.time_series import clock, extremes, steps_at
from imuloop.report.page import phrase
from imuloop.report.results import XYZ
from imuloop.report.units import data_sheet

# number of parts that a line is cut into; each part gives two points
BUCKETS = 64
# keys of a point of diagnosis.json
COLUMNS = ["session", "start_s", "floor", "values", "corrected"]


def bias_pictures(device, block):
    """Return the Pictures of the bias over time with its floor, one for each static record, a list.

    The floor is the standard deviation that noise alone gives the plotted means. `device` is a
    DeviceResults, and `block` the diagnosis of a sensor in static records, as `block_of` returns
    it.
    """
    points = pd.DataFrame(block.get("points", ()), columns=COLUMNS)
    return [
        _picture(device, name, rows, block) for name, rows in points.groupby("session", sort=False)
    ]


def temperatures(session, start):
    """Return the mean temperature over each of n windows of a session, °C, (n,).

    `session` is a SessionResults, and `start` are the starts of the windows, s, (n,). All windows
    have the same length, the median of the differences of `start`. The result is None if no
    temperature was logged or there is only one window; a window without temperature is nan.
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
    """Return the Picture of the bias of a sensor over one static record.

    `device` is a DeviceResults, `session` the name of the session, and `block` the diagnosis of the
    sensor, as `block_of` returns it. `points` has the means over time of this session, a DataFrame:
    its rows of the list ``points`` in the diagnosis.
    """
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
    warm = warmth is not None

    def line(area, y, colour, width=1.0, **looks):
        """Draw the series `y` over time as a line through the extreme values of its equal parts.

        `area` is the Axes, `y` has n values, (n,), `colour` and `width` are of the line, and
        `looks` are further arguments of matplotlib.
        """
        chosen = extremes(y, BUCKETS)
        area.plot(t[chosen] / size, y[chosen], color=colour, lw=width, **looks)

    def plot(areas):
        """Draw bias, floor and temperature over time.

        `areas` are the Axes of x, y, z and temperature.
        """
        for i, (area, axis) in enumerate(zip(areas, XYZ, strict=False)):
            words = "means" if after is None else "before"
            line(area, before[:, i] * display.factor, ORANGE, 1.4, label=words)
            if after is not None:
                line(area, after[:, i] * display.factor, BLUE, label="after")
            for sign in (1, -1):
                line(area, sign * floor * display.factor, INK, ls="--", label="floor, 1 σ")
            area.set_ylabel(f"{axis}, {display.unit}")
        if warm:
            line(areas[-1], warmth, PURPLE, 1.4)
            areas[-1].set_ylabel("°C")
        for area in areas:
            for at in steps_at(device, session, sensor):
                area.axvline(at / size, color=PURPLE, ls=":", label="step")
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
        size=(SMALL[0], 340 + 60 * warm),
        rows=(2, 2, 2, *(1.4,) * warm),
    )


def temperature_pictures(device, block):
    """Return the Picture of the bias against temperature, with the fitted curve, in a list.

    The list is empty if the diagnosis has no effect `bias_temperature`. `device` is a
    DeviceResults, and `block` the diagnosis of a sensor in static records, as `block_of` returns
    it.
    """
    effect = next((e for e in block["effects"] if e["name"] == "bias_temperature"), None)
    points = pd.DataFrame(block.get("points", ()), columns=COLUMNS)
    if effect is None or points.empty or points["corrected"].isna().any():
        return []
    display = data_sheet(block["residuals"]["bias"]["unit"])
    theta0, order = (effect["constants"][k] for k in ("reference_temperature", "order"))
    curves = [
        Polynomial([0.0, *(effect["parameters"][f"c{k}{axis}"] for k in range(1, order + 1))])
        for axis in XYZ
    ]
    sessions = []
    for name, part in points.groupby("session", sort=False):
        session = next(s for s in device.sessions if s.name == name)
        warmth = temperatures(session, part["start_s"].to_numpy(float))
        if warmth is None:
            continue
        rows = {"session": name, "temperature_degC": warmth}
        old, new = (np.stack(part[column].to_numpy()) for column in ("values", "corrected"))
        for i, axis in enumerate(XYZ):
            # each record has its own mean, which the curve does not have
            level = np.nanmedian(old[:, i] - curves[i](warmth - theta0))
            rows |= {axis: old[:, i] - level, f"{axis}_corrected": new[:, i]}
        sessions.append(pd.DataFrame(rows).dropna())
    if not sessions:
        return []
    numbers = pd.concat(sessions)
    low, high = numbers["temperature_degC"].min(), numbers["temperature_degC"].max()
    grid = np.linspace(low, high, 100)
    fitted = [curve(grid - theta0) for curve in curves]
    spread = [numbers[f"{axis}_corrected"].std() for axis in XYZ]

    def plot(areas):
        """Draw the bias against temperature, with the fitted curve.

        `areas` are the Axes of x, y and z.
        """
        for area, axis, curve, sigma in zip(areas, XYZ, fitted, spread, strict=True):
            fill(area, grid, *(display.factor * (curve + s * sigma) for s in (-1, 1)), INK)
            for rows in sessions:
                theta, old, new = (rows[k] for k in ("temperature_degC", axis, f"{axis}_corrected"))
                area.plot(theta, old * display.factor, color=ORANGE, label="before")
                area.plot(theta, new * display.factor, color=BLUE, label="after")
            area.plot(
                grid,
                curve * display.factor,
                color=INK,
                ls="--",
                label="fit ± 1 σ of the rest",
            )
            area.set_ylabel(f"{axis}, {display.unit}")
        areas[-1].set_xlabel("temperature, °C")

    changes = ", ".join(display.size(np.ptp(curve), 2) for curve in fitted)
    caption = phrase(
        "over_temperature",
        sensor=block["sensor"],
        low=low,
        high=high,
        changes=f"{changes} {display.unit}",
    )
    name, looks = f"{device.name}.bias_temperature_{block['sensor']}", {"size": (SMALL[0], 340)}
    return [
        Picture(name, "Bias against temperature", caption, plot, numbers, rows=(1,) * 3, **looks)
    ]
