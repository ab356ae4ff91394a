"""Residual of each pose or turn, before and after the added effects, and what it goes with."""

import numpy as np

from imuloop.report.columns import from_records
from imuloop.report.numbers import DEGREE_PER_SECOND, DEGREES, RESIDUAL, number, with_unit
from imuloop.report.results import XYZ
from imuloop.report.svg import BLUE, INK, ORANGE, Picture, draw, write_csv
from imuloop.report.time_series import clock
from imuloop.report.turns import MIXED, pose_temperatures, turns
from imuloop.report.verdict import RESIDUAL_WORDS, change

NOTE = (
    "One mark a pose or turn, predicted by a calibration that never saw it. Good: marks that "
    "scatter at the dashed floor alike in every panel are noise. Marks far above it in one place, "
    "or a slope, say that the model lacks something there, or that this one was disturbed."
)
SHORT_WORDS = {
    "gravity_norm": "magnitude error",
    "pose_rate": "angular rate",
    "rotation": "direction error",
}
TURN_AXES = [*(f"{sign}{axis}" for axis in XYZ for sign in "+−"), MIXED]
# standard deviations of a rank correlation that chance does not reach in a dozen panels
SURE = 3.5


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
    kinds = {}
    for point in sorted(block.get("points") or [], key=lambda point: point["index"]):
        kinds.setdefault(point["residual"], []).append(point)
    return [
        _picture(device, sensor, name, from_records(kinds[name]), block, folder) for name in kinds
    ]


def against(device, name, points):
    """Return what the residuals of one kind are shown against.

    Parameters
    ----------
    device : Device
        The device.
    name : str
        Kind of residual.
    points : dict of str to list
        Its points, a column each.

    Returns
    -------
    dict of str to (str, ndarray, shape (n,))
        By the name of a column of the CSV file: words with unit, and values in it.
    """
    start, index = np.array(points["start_s"], float), points["index"]
    session = np.array(points.get("session", [0] * len(start)))
    # sessions one after the other
    length = [start[session == s].max(initial=0.0) for s in range(session.max() + 1)]
    elapsed = start + np.concatenate([[0.0], np.cumsum(length)])[session]
    unit, size = clock(elapsed.max())
    found = {f"time_{unit}": (f"time, {unit}", elapsed / size)}
    if name == "rotation":
        known = turns(device)
        if not set(index) <= set(known):
            return found
        turned = [known[i] for i in index]
        angle, speed = (
            np.array([turn[c] for turn in turned], float) * d.factor
            for c, d in (("angle_rad", DEGREES), ("speed_rad_s", DEGREE_PER_SECOND))
        )
        axis = np.array([TURN_AXES.index(turn["axis"]) for turn in turned])
        return found | {
            "angle_deg": ("angle turned, °", angle),
            "speed_deg_s": ("greatest speed, °/s", speed),
            "axis": ("about axis", axis),
        }
    direction = np.array(points["direction"], float)
    for axis, values in zip(XYZ, direction.T, strict=True):
        found[f"up_{axis}"] = f"{axis} of “up”, 1", values
    warm = pose_temperatures(device)
    if warm is not None and max(index, default=0) < len(warm):
        found["temperature_degC"] = "temperature, °C", warm[index]
    return found


def goes_with(panels, error):
    """Return with which panel's values the errors go most, in words.

    Spearman's rank correlation ρ of the size of the error; its standard deviation is
    1/√(n − 1) where nothing is there.
    """
    size = np.abs(error)
    found = [
        (np.corrcoef(_ranks(size), _ranks(values))[0, 1], words.partition(",")[0])
        for key, (words, values) in panels.items()
        if key != "axis" and np.ptp(values) > 0 and np.ptp(size) > 0
    ]
    rho, words = max(found, key=lambda f: abs(f[0]), default=(0.0, ""))
    named = ", ".join(w.partition(",")[0] for key, (w, _) in panels.items() if key != "axis")
    if abs(rho) * np.sqrt(max(len(error) - 1, 0)) < SURE:
        return f"its size goes with none of {named} beyond chance"
    verb = "grows" if rho > 0 else "falls"
    return f"its size {verb} with {words} (rank correlation {number(rho, 2)})"


def _ranks(values):
    """Return the rank of each value; equal ones share the mean of theirs."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - (count - 1) / 2)[place]


def _picture(device, sensor, name, points, block, folder):
    residual = block["residuals"].get(name, {})
    display = RESIDUAL[residual.get("unit") or "rad"]
    index = points["index"]
    before, after, floor = (
        np.array(points[c], float) * display.factor for c in ("before", "after", "floor")
    )
    panels = against(device, name, points)
    columns = {k: v for k, v in points.items() if k not in ("direction", "residual", "components")}
    for key, (_, x) in panels.items():
        columns[key] = [TURN_AXES[v] for v in x] if key == "axis" else x
    csv = write_csv(folder, f"{sensor}_{name}", columns)
    words, changed = RESIDUAL_WORDS[name], bool(block.get("effects"))
    thing = "turn" if name == "rotation" else "pose"
    signed = np.nanmin(np.concatenate([before, after])) < 0
    said = [
        f"{thing} {i}: {f'{number(b)} → ' if changed else ''}{number(a)} {display.unit}"
        for i, b, a in zip(index, before, after, strict=True)
    ]

    def plot(axes):
        axes = axes if isinstance(axes, list) else [axes]
        for ax, (key, (label, x)) in zip(axes, panels.items(), strict=True):
            order = np.argsort(x, kind="stable")
            handles = []
            # over time the floor of each; elsewhere it would jump from mark to mark
            level = floor if key.startswith("time") else np.full(len(x), np.nanmedian(floor))
            for sign in (1, -1) if signed else (1,):
                handles = ax.plot(x[order], sign * level[order], color=INK, ls="--", lw=1)
            names = ["floor from noise"]
            if changed:
                handles += ax.plot(x, before, "o", color=ORANGE, hollow=True, ms=5)
                names.append("before")
            titles = said if ax is axes[0] else None
            handles += ax.plot(x, after, "o", color=BLUE, ms=4.5, titles=titles)
            names.append("after" if changed else "residual")
            if not signed:
                ax.set_ylim(0)
            ax.set_xlabel(label)
            if key == "axis":
                ax.set_xlim(-0.6, len(TURN_AXES) - 0.4)
                ax.set_xticks(range(len(TURN_AXES)), [*TURN_AXES[:-1], "mix"])
        axes[0].set_ylabel(f"{SHORT_WORDS[name]}, {display.unit}")
        axes[-1].legend(handles, names)

    worst = np.nanargmax(np.abs(after))
    caption = (
        f"{words[0].upper()}{words[1:]}: {change(residual, changed)}. Largest left: "
        f"{with_unit(number(np.nanmax(np.abs(after))), display.unit)}, {thing} {index[worst]}; "
        f"{goes_with(panels, after)}."
    )
    identity = f"{device.name}.{sensor}_{name}"
    svg = draw(
        identity,
        f"{sensor}: {caption}",
        1000 if len(panels) > 1 else 440,
        270,
        plot,
        margins=(58, 12, 28, 42),
        columns=(2.2, *(1.3 if k == "axis" else 1 for k in list(panels)[1:])),
        sharey=True,
    )
    return Picture(identity, svg, caption, NOTE, (csv,), wide=len(panels) > 1)
