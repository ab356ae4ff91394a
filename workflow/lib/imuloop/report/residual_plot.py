"""Residual of each pose or rotation, before and after the added effects, against the floor."""

import numpy as np
import pandas as pd

from imuloop.report.numbers import RESIDUAL, number, with_unit
from imuloop.report.results import XYZ
from imuloop.report.svg import AXES, BLUE, INK, ORANGE, Picture, draw, write_csv
from imuloop.report.time_series import clock, extremes
from imuloop.report.verdict import RESIDUAL_WORDS, change

NOTE = (
    "One mark a pose or rotation: what is left after calibration. Marks that scatter at the "
    "dashed floor are noise; marks far above it say that the model lacks something, or that "
    "this pose was disturbed."
)

BIAS_NOTE = (
    "Means of consecutive stretches at rest. A bias that stays within the dashed floor is as "
    "steady as the noise allows; steps, slopes and bends are what a noise model lacks."
)
SHORT_WORDS = {
    "gravity_norm": "magnitude error",
    "pose_rate": "angular rate",
    "rotation": "direction error",
}


def residual_pictures(device, sensor, folder):
    """Return a picture for each kind of residual of a sensor that has points.

    Parameters
    ----------
    device : Device
        The device.
    sensor : {'accelerometer', 'gyroscope'}
        Which sensor.
    folder : Path
        Where the CSV files go.
    """
    block = device.diagnosis.get("sensors", {}).get(sensor, {}).get("poses", {})
    points = pd.DataFrame(block.get("points") or [])
    if points.empty:
        return []
    return [
        _picture(device, sensor, name, group.sort_values("index"), block, folder)
        for name, group in points.groupby("residual", sort=False)
    ]


def _picture(device, sensor, name, points, block, folder):
    residual = block["residuals"].get(name, {})
    display = RESIDUAL[residual.get("unit") or "rad"]
    index = points["index"].to_numpy()
    before, after, floor = (
        points[c].astype(float).to_numpy() * display.factor for c in ("before", "after", "floor")
    )
    csv = write_csv(
        folder,
        f"{sensor}_{name}",
        points.drop(columns="direction", errors="ignore").drop(columns="residual"),
    )
    words = RESIDUAL_WORDS[name]
    changed = bool(block.get("effects"))

    def plot(ax):
        signed = np.nanmin(np.concatenate([before, after])) < 0
        handles = ax.plot(index, floor, color=INK, ls="--", lw=1)
        labels = ["floor from noise"]
        if signed:
            ax.plot(index, -floor, color=INK, ls="--", lw=1)
        if changed:
            handles += ax.plot(index, before, "o", color=ORANGE, mfc="none", ms=5)
            labels.append("before")
        handles += ax.plot(index, after, "o", color=BLUE, ms=4)
        labels.append("after" if changed else "residual")
        if not signed:
            ax.set_ylim(0)
        ax.set_xlabel(f"{'rotation' if name == 'rotation' else 'pose'}, number in order of time")
        ax.set_ylabel(f"{SHORT_WORDS[name]}, {display.unit}")
        ax.legend(handles, labels, loc="lower right", ncols=3, bbox_to_anchor=(1, 1), borderpad=0.2)

    worst = index[np.nanargmax(np.abs(after))]
    caption = (
        f"{words[0].upper()}{words[1:]}: {change(residual, changed)}. Largest left: "
        f"{with_unit(number(np.nanmax(np.abs(after))), display.unit)}, number {worst}."
    )
    identity = f"{device.name}.{sensor}_{name}"
    svg = draw(identity, f"{sensor}: {caption}", 440, 270, plot, margins=(58, 12, 28, 42))
    return Picture(identity, svg, caption, NOTE, (csv,))


def bias_pictures(device, sensor, folder):
    """Return how a sensor's bias wandered over each static record, against the floor."""
    block = device.diagnosis.get("sensors", {}).get(sensor, {}).get("static_record", {})
    points = pd.DataFrame(block.get("points") or [])
    if points.empty or "values" not in points:
        return []
    return [
        _bias_picture(device, sensor, session, group, block, folder)
        for session, group in points.groupby("session", sort=False)
    ]


def _bias_picture(device, sensor, session, points, block, folder):
    residual = block["residuals"]["bias"]
    display = RESIDUAL[residual["unit"]]
    t = points["start_s"].to_numpy()
    values = np.array(points["values"].tolist())
    floor = points["floor"].to_numpy() / np.sqrt(3)
    table = pd.DataFrame({"start_s": t, "floor": floor, **dict(zip(XYZ, values.T, strict=True))})
    csv = write_csv(folder, f"{session}_bias_{sensor}", table)
    unit, size = clock(t[-1])

    # the floor is smooth: a few hundred points draw it
    few = slice(None, None, len(t) // 300 + 1)

    def plot(ax):
        handles = []
        for colour, y in zip(AXES, values.T, strict=True):
            chosen = extremes(y, 150)
            handles += ax.plot(t[chosen] / size, y[chosen] * display.factor, color=colour, lw=1)
        for sign in (1, -1):
            limit = ax.plot(
                t[few] / size, sign * floor[few] * display.factor, color=INK, ls="--", lw=1
            )
        ax.set_xlabel(f"time, {unit}")
        ax.set_ylabel(f"mean minus bias, {display.unit}")
        ax.legend(
            [*handles, *limit],
            [*XYZ, "floor, 1 σ"],
            loc="lower right",
            ncols=4,
            bbox_to_anchor=(1, 1),
            borderpad=0.2,
        )

    span = np.ptp(values, axis=0) * display.factor
    caption = (
        f"{session}, {sensor}: the bias moves by {', '.join(number(v, 2) for v in span)} "
        f"{display.unit} from peak to peak (x, y, z); noise alone, 1 σ, "
        f"{number(np.nanmean(floor) * display.factor, 2)} {display.unit}."
    )
    name = f"{device.name}.{session}.bias_{sensor}"
    svg = draw(name, caption, 440, 270, plot, margins=(62, 12, 28, 42))
    return Picture(name, svg, caption, BIAS_NOTE, (csv,))
