"""Residual of each pose or rotation, before and after the added effects, against the floor."""

import numpy as np
import pandas as pd

from imuloop.report.numbers import RESIDUAL, number, with_unit
from imuloop.report.svg import BLUE, INK, ORANGE, Picture, draw, write_csv
from imuloop.report.verdict import RESIDUAL_WORDS, change

NOTE = (
    "One mark a pose or rotation: what is left after calibration. Marks that scatter at the "
    "dashed floor are noise; marks far above it say that the model lacks something, or that "
    "this pose was disturbed."
)
SHORT_WORDS = {
    "gravity_norm": "magnitude error",
    "pose_rate": "angular rate",
    "rotation": "direction error",
}


def residual_pictures(device, sensor, block, folder):
    """Return a picture for each kind of residual of a sensor that has points.

    Parameters
    ----------
    device : Device
        The device.
    sensor : {'accelerometer', 'gyroscope'}
        Which sensor.
    block : dict
        The diagnosis of its poses.
    folder : Path
        Where the CSV files go.
    """
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
