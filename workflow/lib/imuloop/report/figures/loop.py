"""The loop in one picture: errors as logged, calibrated, with the effects found, over the noise."""

import numpy as np

from imuloop.core.errors import plural
from imuloop.core.files import read_json
from imuloop.core.samples import ACCELERATION, SENSORS
from imuloop.core.units import DEGREE
from imuloop.report.figures.drawing import BLUE, GREEN, GRID, INK, ORANGE, PAGE, Picture, write_csv
from imuloop.report.numbers import joined, number
from imuloop.report.units import RESIDUAL
from imuloop.report.verdict import block_of, effect_words, motion_of, rank

# what an error was before and after, its words in the key, and its mark
STAGES = {
    "logged": ("as logged", GREEN, "s"),
    "calibrated": ("calibrated", ORANGE, "D"),
    "final": ("with the effects found", BLUE, "o"),
}
# of the words beside a mark, px: two marks may lie side by side
PLACES = {
    "logged": ((9, 0), "left", "center"),
    "calibrated": ((0, 8), "center", "bottom"),
    "final": ((0, -9), "center", "top"),
}
# factor from which on an error is said to have fallen
WORTH_SAYING = 1.1


def loop_errors(device):
    """Return the held-out errors of a device that a user feels, the first one most.

    Each a dict of ``what``, ``unit``, ``logged``, ``calibrated``, ``final``, ``floor`` (SI, root
    mean squares, None where there is none), ``effects``, and whether the floor takes ``slow_noise``
    that the rests do not show.
    """
    found, poses = [], {s: block_of(device.diagnosis, s) for s in SENSORS}
    if residual := poses["gyroscope"]["residuals"].get("rotation"):
        attitude = read_json(device.folder / "attitude.json")
        logged = None
        if attitude["status"] == "ok":
            logged = DEGREE * attitude["methods"]["rotation"]["models"]["raw"]["rms_deg"]
        found.append(_of_residual("vertical after a turn", residual, poses["gyroscope"], logged))
    if residual := poses["accelerometer"]["residuals"].get("gravity_norm"):
        table = device.poses[np.isfinite(device.poses["gravity_norm_after"])]
        norm = np.linalg.norm(table[list(ACCELERATION)], axis=1)
        logged = np.sqrt(np.mean((norm - device.calibrations["final"].gravity) ** 2))
        found.append(_of_residual("gravity at rest", residual, poses["accelerometer"], logged))
    motion = motion_of(device.diagnosis)
    if residual := motion["residuals"].get("velocity_vertical"):
        found.append(_of_residual("velocity after a move", residual, motion))
    block = block_of(device.diagnosis, "gyroscope", "reference")
    if residual := block["residuals"].get("reference_rotation"):
        [second] = (e for e in block["by_duration"] if e["seconds"] == 1)
        logged = second["logged"]["rotation"]
        found.append(_of_residual("rotation over 1 s", residual, block, logged))
    block = block_of(device.diagnosis, "accelerometer", "reference")
    if residual := block["residuals"].get("reference_force"):
        found.append(_of_residual("specific force", residual, block))
    for sensor in SENSORS:
        block = block_of(device.diagnosis, sensor, "static_record")
        if residual := block["residuals"].get("bias"):
            found.append(_of_residual(f"{sensor}'s bias at rest", residual, block))
    return found


def _of_residual(what, residual, block, logged=None):
    names = list(dict.fromkeys(effect_words(e["name"]) for e in block["effects"]))
    sizes = {"logged": logged, "calibrated": residual["before"]}
    sizes |= {"final": residual["after"] if names else None, "floor": residual["floor"]}
    known = {"effects": names, "slow_noise": bool(block.get("slow_noise"))}
    return {"what": what, "unit": residual["unit"]} | sizes | known


def fall(error):
    """Return how many times an error is smaller with the effects found."""
    return error["calibrated"] / error["final"] if error["final"] else 1.0


def loop_words(errors):
    """Return what the loop found in a sentence: of the error that fell most, else of the first."""
    if not errors:
        return ""
    error = max(errors, key=fall)
    display = RESIDUAL[error["unit"]]
    path = [
        f"{display.text(error[stage], 2)} {words}"
        for stage, words in (("logged", "as logged"), ("calibrated", "calibrated"))
        if error[stage] is not None
    ]
    if error["final"] is not None:
        effects = joined(error["effects"])
        path.append(f"{display.text(error['final'], 2)} with {effects}")
    text = f"{error['what'].capitalize()}: {', '.join(path)}"
    if fall(error) >= WORTH_SAYING:
        text += f", {number(fall(error), 2)} times less"
    gives = "may give" if error["slow_noise"] else "gives"
    return f"{text}. Noise alone {gives} {display.text(error['floor'], 2)}."


def headline(summaries):
    """Return what was found in all devices in a line, given summary.json: the fall that is largest.

    An effect that lowers no error by `WORTH_SAYING` is no news.
    """
    found = [(fall(error), error, s) for s in summaries for error in s["loop"]]
    found = [each for each in found if each[1]["effects"] and each[0] >= WORTH_SAYING]
    if found:
        _, error, summary = max(found, key=lambda each: each[0])
        display = RESIDUAL[error["unit"]]
        before, after = (display.text(error[stage], 2) for stage in ("calibrated", "final"))
        what = error["what"].capitalize()
        effects = joined(error["effects"])
        return f"{summary['label']}: undeclared {effects}. {what} {before} → {after}"
    every = {verdict for s in summaries for _, verdict, _ in s["answers"]}
    verdicts = every - {"not_testable"}
    named = summaries[0]["label"] if len(summaries) == 1 else plural(len(summaries), "device")
    if not verdicts:
        return f"{named}: too few data to tell whether anything is missing"
    worst = max(verdicts, key=rank)
    words = {"consistent": "nothing is missing", "explained": "what was missing is small"}
    tested = ", where it could be tested" if every > verdicts else ""
    return f"{named}: {words.get(worst, 'something is still missing')}{tested}"


def draw_loop(area, errors):
    """Draw a row per error: its sizes over the floor of its noise, on a logarithmic axis."""
    labelled, smallest, largest = set(), 1.0, 1.0
    for row, error in enumerate(errors):
        sizes = {s: error[s] / error["floor"] for s in STAGES if error[s] is not None}
        smallest, largest = min(smallest, *sizes.values()), max(largest, *sizes.values())
        area.plot([*sizes.values()], [row] * len(sizes), color=GRID, lw=2, zorder=1)
        for stage, size in sizes.items():
            words, colour, mark = STAGES[stage]
            key = {} if words in labelled else {"label": words}
            labelled.add(words)
            area.plot(size, row, mark, color=colour, mec=PAGE, mew=1, ms=9, **key)
            where, across, upright = PLACES[stage]
            area.annotate(
                RESIDUAL[error["unit"]].text(error[stage], 2),
                (size, row),
                where,
                textcoords="offset points",
                ha=across,
                va=upright,
                fontsize=10,
                # the line of the noise does not strike it through
                bbox={"fc": PAGE, "ec": "none", "pad": 1},
            )
    area.axvline(1, color=INK, lw=1, ls="--", label="noise alone", zorder=1)
    area.set_xscale("log")
    area.set_xlim(smallest / 2 or 0.5, max(4 * largest, 8))
    area.set_ylim(len(errors) - 0.4, -0.6)
    area.set_yticks(range(len(errors)), [error["what"] for error in errors])
    area.grid(False, axis="y")
    area.set_xlabel("error, in multiples of what the noise alone gives")


def loop_picture(name, errors):
    """Return the picture of a device's errors by its name, or None without any."""
    if not errors:
        return None
    return Picture(
        f"{name}.loop",
        "Error as logged, calibrated and with the effects found",
        loop_words(errors),
        lambda area: draw_loop(area, errors),
        (500, 80 + 36 * len(errors)),
        f"{name}/figures/loop.csv",
    )


def device_loop(device):
    """Return the picture of a device's errors, the numbers of which are written; None without."""
    errors = loop_errors(device)
    if errors:
        keys = ("what", "unit", *STAGES, "floor")
        write_csv(device.figures, "loop", {k: [e[k] for e in errors] for k in keys})
    return loop_picture(device.name, errors)
