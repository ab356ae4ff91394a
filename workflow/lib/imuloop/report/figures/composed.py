"""The residual against what a formula adds that a search found beyond the library."""

import numpy as np

from imuloop.report.figures.drawing import BLUE, INK, ORANGE, PAGE, drawn
from imuloop.report.numbers import number
from imuloop.report.units import RESIDUAL
from imuloop.report.verdict import RESIDUAL_WORDS


def composed_pictures(device, sensor, block):
    """Return a picture of each kind of residual against what the formula adds to it."""
    search = block.get("discovered")
    found = []
    for kind, series in (search or {}).get("points", {}).items():
        unit = RESIDUAL[block["residuals"][kind]["unit"]]
        own = {name: unit.factor * np.array(values) for name, values in series.items()}

        def plot(area, own=own, unit=unit):
            ends = np.array([own["input"].min(), own["input"].max()])
            area.plot(ends, ends, color=INK, lw=1, label="the formula")
            for name, colour in (("before", ORANGE), ("after", BLUE)):
                area.plot(own["input"], own[name], "o", color=colour, mec=PAGE, label=name)
            area.set(xlabel=f"what the formula adds, {unit.unit}")
            area.set(ylabel=f"residual, {unit.unit}")

        size = {name: number(np.sqrt(np.mean(v**2)), 2) for name, v in own.items()}
        caption = (
            f"The {RESIDUAL_WORDS[kind]} in the fit, component by component: root mean square "
            f"{size['before']}\u202f{unit.unit} with what the formula "
            f"{search['formula'][:80]} adds, {size['after']}\u202f{unit.unit} without it."
        )
        title = f"{sensor.capitalize()}: residual against the composed input"
        found.append(drawn(device, f"{sensor}_{kind}_composed", title, caption, plot, own))
    return found
