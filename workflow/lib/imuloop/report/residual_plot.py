"""Residual of each pose or turn, before and after the added effects, and what it goes with."""

import numpy as np

from imuloop.core.samples import ACCELERATION, TEMPERATURE
from imuloop.report.columns import rows
from imuloop.report.numbers import DEGREE_PER_SECOND, DEGREES, RESIDUAL, number, with_unit
from imuloop.report.results import XYZ
from imuloop.report.svg import BLUE, INK, ORANGE, Picture, draw, write_csv
from imuloop.report.time_series import clock
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
# cosine of the angle within which a turn is about one axis, 30 degrees
ABOUT = 0.87
MIXED = "mixed"
TURN_AXES = [*(f"{sign}{axis}" for axis in XYZ for sign in "+−"), MIXED]
# standard deviations of a rank correlation that chance does not reach in a dozen panels
SURE = 3.5


def residual_pictures(device, sensor, block, folder):
    """Return a picture for each kind of residual of a sensor.

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
    found = []
    for name in block["residuals"]:
        table = device.moves if name == "rotation" else device.poses
        # poses on six faces are not diagnosed
        table = rows(table, np.isfinite(table[f"{name}_after"]))
        found.append(_picture(device, sensor, name, table, block, folder))
    return found


def in_line(table):
    """Return the start of each row with the sessions one after the other, s, and theirs by name."""
    length = {name: table["end_s"][table["session"] == name].max() for name in table["session"]}
    first = dict(zip(length, np.cumsum([0.0, *length.values()]).tolist(), strict=False))
    return table["start_s"] + [first[name] for name in table["session"]], first


def against(name, table):
    """Return what the residuals of one kind are shown against.

    Parameters
    ----------
    name : str
        Kind of residual.
    table : dict of str to ndarray, shape (n,)
        Its poses or moves.

    Returns
    -------
    dict of str to (str, ndarray, shape (n,))
        By the name of a column of the CSV file: words with unit, and values in it.
    """
    elapsed, _ = in_line(table)
    unit, size = clock(elapsed.max())
    found = {f"time_{unit}": (f"time, {unit}", elapsed / size)}
    if name == "rotation":
        axes = zip(*(table[f"axis_{axis}"] for axis in XYZ), strict=True)
        return found | {
            "angle_deg": ("angle turned, °", table["angle_rad"] * DEGREES.factor),
            "speed_deg_s": ("greatest speed, °/s", table["speed_rad_s"] * DEGREE_PER_SECOND.factor),
            "axis": ("about axis", np.array([TURN_AXES.index(turn_axis(u)) for u in axes])),
        }
    force = np.array([table[channel] for channel in ACCELERATION])
    for axis, values in zip(XYZ, force / np.linalg.norm(force, axis=0), strict=True):
        found[f"up_{axis}"] = f"{axis} of “up”, 1", values
    if np.isfinite(table[TEMPERATURE]).any():
        found["temperature_degC"] = "temperature, °C", table[TEMPERATURE]
    return found


def turn_axis(direction):
    """Return the axis of a turn, as ``+z``, or `MIXED`."""
    axis = int(np.abs(direction).argmax())
    if abs(direction[axis]) < ABOUT:
        return MIXED
    return f"{'+' if direction[axis] > 0 else '−'}{XYZ[axis]}"


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


def _picture(device, sensor, name, table, block, folder):
    residual = block["residuals"][name]
    display = RESIDUAL[residual["unit"]]
    errors = {when: table[f"{name}_{when}"] for when in ("before", "after", "floor")}
    before, after, floor = (values * display.factor for values in errors.values())
    panels, (elapsed, sessions) = against(name, table), in_line(table)
    columns = {column: table[column] for column in ("session", "pose", "start_s")} | errors
    for key, (_, x) in panels.items():
        columns[key] = [TURN_AXES[v] for v in x] if key == "axis" else x
    csv = write_csv(folder, f"{sensor}_{name}", columns)
    words, changed = RESIDUAL_WORDS[name], bool(block.get("effects"))
    thing = "turn" if name == "rotation" else "pose"
    several = len(sessions) > 1
    things = [
        f"{thing} {i}" + f" of {session}" * several
        for session, i in zip(table["session"], table["pose"], strict=True)
    ]
    signed = min(before.min(), after.min()) < 0
    said = [
        f"{one}: {f'{number(b)} → ' if changed else ''}{number(a)} {display.unit}"
        for one, b, a in zip(things, before, after, strict=True)
    ]

    def plot(axes):
        axes = axes if isinstance(axes, list) else [axes]
        for ax, (key, (label, x)) in zip(axes, panels.items(), strict=True):
            order = np.argsort(x, kind="stable")
            handles = []
            # over time the floor of each; elsewhere it would jump from mark to mark
            level = floor if ax is axes[0] else np.full(len(x), np.median(floor))
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
        if several:
            size = clock(elapsed.max())[1]
            for session, first in sessions.items():
                axes[0].axvline(first / size, label=session)
        axes[0].set_ylabel(f"{SHORT_WORDS[name]}, {display.unit}")
        axes[-1].legend(handles, names)

    worst = np.abs(after).argmax()
    caption = (
        f"{words[0].upper()}{words[1:]}: {change(residual, changed)}. Largest left: "
        f"{with_unit(number(abs(after[worst])), display.unit)}, {things[worst]}; "
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
