"""The picture of the errors of a device: as logged, calibrated, and with effects corrected."""

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator

from imuloop.report.figures.drawing import BLUE, GREEN, GRID, INK, ORANGE, PAGE, Picture
from imuloop.report.figures.residuals import as_logged
from imuloop.report.findings import BOTH, blocks, residual_names
from imuloop.report.page import WORDS
from imuloop.report.units import data_sheet

# stages of an error: words in the key, colour and mark
STAGES = {
    "logged": ("as logged", GREEN, "s"),
    "calibrated": ("calibrated", ORANGE, "D"),
    "final": ("effects corrected", BLUE, "o"),
}
# width of the picture, px: a small screen, on which the text has 12 px
WIDTH = 328
# height of a row, and of the space around all rows, px
ROW, AROUND = 29, 67
# the records in the order in which a user notices their errors
RECORDS = (
    ("gyroscope", "poses"),
    ("accelerometer", "poses"),
    (BOTH, "motion"),
    ("gyroscope", "reference"),
    ("accelerometer", "reference"),
    ("accelerometer", "static_record"),
    ("gyroscope", "static_record"),
)
# margin of the axis beyond the least and the greatest error, a factor
BEYOND = 1.6


def loop_errors(device, diagnoses):
    """Return the errors of a device as logged, calibrated and with effects corrected, a list.

    `device` is a DeviceResults, and `diagnoses` is the result of `blocks` for it. Each diagnosis
    gives up to two errors: the residual that its verdict quotes, and the residual that a user
    notices first. The list is in the order of `RECORDS`. An error is a dict: its words ``what``,
    its SI ``unit``, the root mean squares ``logged``, ``calibrated``, ``final`` and ``floor``, SI,
    and the ``effects`` in words. ``calibrated`` and ``final``, with the effects corrected, are
    held-out errors; ``floor`` is the error from noise alone. A root mean square that is not known
    is None.
    """
    errors = []
    for block in sorted(diagnoses, key=lambda b: RECORDS.index((b["sensor"], b["part"]))):
        for name in dict.fromkeys([block["quoted"], *residual_names(block)[:1]]):
            if name:
                residual, effects = block["residuals"][name], [*dict.fromkeys(block["words"])]
                what = WORDS["residuals"][name][2]
                error = {
                    "what": f"{block['sensor']}'s {what}" if name == "bias" else what,
                    "unit": residual["unit"],
                    "logged": _as_logged(device, name),
                    "calibrated": residual["before"],
                    "final": residual["after"] if effects else None,
                    "floor": residual["floor"],
                    "effects": effects,
                }
                errors.append(error)
    return errors


def _as_logged(device, name):
    """Return the root mean square of a residual of samples as logged, SI; None if it is not known.

    `device` is a DeviceResults, and `name` the name of the residual.
    """
    logged = as_logged(device, name)
    return None if logged is None else float(np.sqrt(np.mean(logged**2)))


def _multiples(error):
    """Return the sizes of an error in multiples of its floor, a dict by stage, as in `STAGES`.

    `error` is a dict of the list that `loop_errors` returns.
    """
    return {s: error[s] / error["floor"] for s in STAGES if error[s] is not None}


def reach(errors):
    """Return the least and the greatest ratio of errors to their floors; 1 is always in this range.

    `errors` is the result of `loop_errors`. The range is used for the axis of the picture.
    """
    sizes = [1.0, *(size for error in errors for size in _multiples(error).values())]
    return min(sizes), max(sizes)


def _sizes(error):
    """Return the sizes of an error as text, stage by stage: "3.1 mg → 0.52 mg".

    `error` is a dict of the list that `loop_errors` returns.
    """
    display = data_sheet(error["unit"])
    return " → ".join(display.text(error[s], 2) for s in STAGES if error[s] is not None)


def draw_loop(area, errors, ends):
    """Draw a row for each error: its sizes in multiples of its floor, on a logarithmic axis.

    `area` is the matplotlib Axes, `errors` is the result of `loop_errors`, and `ends` are the least
    and the greatest multiple that the axis has to show.
    """
    # no line crosses the words
    looks = {"transform": area.get_yaxis_transform(), "va": "center"}
    looks["bbox"] = {"fc": PAGE, "ec": "none", "pad": 0}
    for row, error in enumerate(errors):
        sizes = _multiples(error)
        area.text(0, row - 0.3, error["what"], ha="left", **looks)
        area.text(1, row - 0.3, _sizes(error), ha="right", **looks)
        area.plot([*sizes.values()], [row + 0.15] * len(sizes), color=GRID, lw=2, zorder=1)
        area.plot([1, 1], [row, row + 0.3], color=INK, ls=(0, (3, 2)), zorder=1)
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
    area.set_xlabel("error, in multiples of the noise floor")
    words, colours, marks = zip(
        *(STAGES[s] for s in STAGES if any(e[s] is not None for e in errors)), strict=True
    )
    # a device that only rested has no calibration
    words = words if any(e["logged"] is not None for e in errors) else ("before", *words[1:])
    keys = [
        Line2D([], [], color=colour, marker=mark, ls="", ms=8)
        for colour, mark in zip(colours, marks, strict=True)
    ]
    looks = {"loc": "lower right", "bbox_to_anchor": (1, 1), "ncols": len(keys)}
    area.legend(keys, words, fontsize=11, handletextpad=0, borderpad=0, **looks)


def loop_picture(name, errors, ends=None):
    """Return the Picture of the errors of a device: as logged, calibrated and effects corrected.

    `name` is the name of the device, and `errors` the result of `loop_errors`; if this is empty,
    the result is None. `ends` are the least and the greatest multiple of a floor on the axis, the
    same for all devices that are compared; by default the axis fits the errors.
    """
    if not errors:
        return None

    def plot(area):
        """Draw the errors on the Axes `area`."""
        draw_loop(area, errors, ends or reach(errors))

    said = (
        f"{e['what']} {_sizes(e)}, noise alone {data_sheet(e['unit']).text(e['floor'], 2)}"
        for e in errors
    )
    return Picture(
        f"{name}.loop",
        "Errors as logged, calibrated and with the effects corrected",
        f"{'; '.join(said)}.",
        plot,
        {k: [e[k] for e in errors] for k in ("what", "unit", *STAGES, "floor")},
        size=(WIDTH, AROUND + ROW * len(errors)),
    )


def device_loop(device):
    """Return the Picture of the errors of a device as logged, calibrated and corrected, in a list.

    `device` is a DeviceResults. The list is empty if no residual was tested.
    """
    picture = loop_picture(device.name, loop_errors(device, blocks(device.diagnosis)))
    return [picture] if picture else []
