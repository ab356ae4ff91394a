"""The loop in one picture: errors as logged, calibrated, with the effects found, over the noise."""

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator

from imuloop.core.files import read_json
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import DEGREE
from imuloop.report.figures.drawing import BLUE, GREEN, GRID, INK, ORANGE, PAGE, Picture, write_csv
from imuloop.report.units import RESIDUAL
from imuloop.report.verdict import BOTH, UNTESTED, blocks, effect_words, quoted, residual_names

# what an error was before and after, its words in the key, and its mark
STAGES = {
    "logged": ("as logged", GREEN, "s"),
    "calibrated": ("calibrated", ORANGE, "D"),
    "final": ("effects corrected", BLUE, "o"),
}
# as wide as a small screen, px, on which its words are of 12 px
WIDTH = 328
# height of a row and of what is around all rows, px
ROW, AROUND = 29, 67
# the records in the order in which a user feels their errors
RECORDS = (
    ("gyroscope", "poses"),
    ("accelerometer", "poses"),
    (BOTH, "motion"),
    ("gyroscope", "reference"),
    ("accelerometer", "reference"),
    ("accelerometer", "static_record"),
    ("gyroscope", "static_record"),
)
# the errors by the name of the residual
WHAT = {
    "rotation": "vertical after a turn",
    "pose_rate": "rate at rest",
    "gravity_norm": "gravity at rest",
    "velocity_vertical": "vertical velocity after a move",
    "velocity_horizontal": "horizontal velocity after a move",
    "reference_rotation": "rotation over 1 s",
    "reference_force": "specific force",
    "bias": "{}'s bias at rest",
}
# of the axis beyond the least and the greatest error, a factor
BEYOND = 1.6


def loop_errors(device):
    """Return the held-out errors of a device that a user feels, the first one most.

    Of each record the residual that its verdict quotes, and the one that a user feels first. Each
    is a dict of ``what``, ``unit``, ``logged``, ``calibrated``, ``final``, ``floor`` (SI, root mean
    squares, None where there is none) and ``effects``.
    """
    known = {(sensor, part): block for sensor, part, block in blocks(device.diagnosis)}
    found = []
    for sensor, part in RECORDS:
        block = known.get((sensor, part), UNTESTED)
        for name in dict.fromkeys([quoted(sensor, block)[0], *residual_names(sensor, block)[:1]]):
            if name:
                logged = _as_logged(device, name)
                what = WHAT[name].format(sensor)
                found.append(_of_residual(what, block["residuals"][name], block, logged))
    return found


def _as_logged(device, name):
    """Return the error as logged, SI, root mean square, in place of a residual; None if unknown."""
    if name == "rotation":
        attitude = read_json(device.folder / "attitude.json")
        if attitude["status"] == "ok":
            return DEGREE * attitude["methods"]["rotation"]["models"]["raw"]["rms_deg"]
    elif name == "gravity_norm":
        table = device.poses[np.isfinite(device.poses["gravity_norm_after"])]
        norm = np.linalg.norm(table[list(ACCELERATION)], axis=1)
        return np.sqrt(np.mean((norm - device.calibrations["final"].gravity) ** 2))
    elif name == "pose_rate":
        table = device.poses[np.isfinite(device.poses["pose_rate_after"])]
        return np.sqrt(np.mean((table[list(ANGULAR_RATE)] ** 2).sum(axis=1)))
    return None


def _of_residual(what, residual, block, logged=None):
    names = list(
        dict.fromkeys(effect_words(e["name"], e.get("constants")) for e in block["effects"])
    )
    sizes = {"logged": logged, "calibrated": residual["before"]}
    sizes |= {"final": residual["after"] if names else None, "floor": residual["floor"]}
    return {"what": what, "unit": residual["unit"]} | sizes | {"effects": names}


def reach(errors):
    """Return the least and the greatest multiple of its floor that any error has, one included."""
    sizes = [e[stage] / e["floor"] for e in errors for stage in STAGES if e[stage] is not None]
    return min([1.0, *sizes]), max([1.0, *sizes])


def _sizes(error):
    """Return an error's sizes from step to step, in words."""
    texts = [RESIDUAL[error["unit"]].text(error[s], 2) for s in STAGES if error[s] is not None]
    return " → ".join(texts)


def draw_loop(area, errors, ends):
    """Draw a row per error: its sizes over the floor of its noise, on a logarithmic axis."""
    looks = {"transform": area.get_yaxis_transform(), "va": "center"}
    # no line strikes words through
    looks["bbox"] = {"fc": PAGE, "ec": "none", "pad": 0}
    for row, error in enumerate(errors):
        sizes = {s: error[s] / error["floor"] for s in STAGES if error[s] is not None}
        area.text(0, row - 0.3, error["what"], ha="left", **looks)
        area.text(1, row - 0.3, _sizes(error), ha="right", **looks)
        area.plot([*sizes.values()], [row + 0.15] * len(sizes), color=GRID, lw=2, zorder=1)
        area.plot([1, 1], [row - 0.15, row + 0.45], color=INK, ls=(0, (3, 2)), zorder=1)
        for stage, size in sizes.items():
            _, colour, mark = STAGES[stage]
            area.plot(size, row + 0.15, mark, color=colour, mec=PAGE, mew=1, ms=9)
    area.set_xscale("log")
    area.set_xlim(ends[0] / BEYOND, ends[1] * BEYOND)
    area.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
    area.xaxis.set_major_formatter(FuncFormatter(lambda size, _: f"{size:g}"))
    area.minorticks_off()
    area.set_ylim(len(errors) - 0.5, -0.65)
    area.set_yticks([])
    area.spines["left"].set_visible(False)
    area.set_xlabel("error, in multiples of what the noise alone gives")
    shown = [STAGES[s] for s in STAGES if any(e[s] is not None for e in errors)]
    keys = [Line2D([], [], color=c, marker=mark, ls="", ms=8) for _, c, mark in shown]
    area.legend(
        keys,
        [words for words, *_ in shown],
        loc="lower right",
        bbox_to_anchor=(1, 1),
        ncols=len(keys),
        fontsize=11,
        handletextpad=0,
        borderpad=0,
    )


def loop_picture(name, errors, ends=None):
    """Return the picture of a device's errors by its name, or None without any.

    `ends` of the axis are those of several devices, which are compared; else its own, see `reach`.
    """
    if not errors:
        return None
    said = (
        f"{e['what']} {_sizes(e)}, noise alone {RESIDUAL[e['unit']].text(e['floor'], 2)}"
        for e in errors
    )
    return Picture(
        f"{name}.loop",
        "Errors as logged, calibrated and with the effects corrected",
        f"{'; '.join(said)}.",
        lambda area: draw_loop(area, errors, ends or reach(errors)),
        (WIDTH, AROUND + ROW * len(errors)),
        f"{name}/figures/loop.csv",
    )


def device_loop(device):
    """Return the picture of a device's errors, the numbers of which are written; None without."""
    errors = loop_errors(device)
    if errors:
        keys = ("what", "unit", *STAGES, "floor")
        write_csv(device.figures, "loop", {k: [e[k] for e in errors] for k in keys})
    return loop_picture(device.name, errors)
