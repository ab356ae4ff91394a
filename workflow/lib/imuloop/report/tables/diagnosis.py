"""The diagnosis in tables: held-out errors, the effects that were added and what they gained."""

import re

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.samples import ACCELERATION
from imuloop.effects.delays import TimeOffset
from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.report.numbers import (
    NO_NUMBER,
    duration,
    interval_text,
    missing,
    number,
    probability,
    text_of,
    typeset,
    with_sigma,
)
from imuloop.report.results import XYZ
from imuloop.report.tables.candidates import constants_text
from imuloop.report.tables.table import Sized, Table, sized
from imuloop.report.units import RESIDUAL, data_sheet
from imuloop.report.verdict import PARTS, RESIDUAL_WORDS, blocks

# cosine of the angle within which a session lies on an axis, 20 degrees
ON_AXIS = 0.94


def heldout_table(device):
    """Return held-out residuals before and after, their floor and reduced χ²."""
    found = [
        (f"{sensor}, {PARTS[part]}: {RESIDUAL_WORDS[name]}", RESIDUAL[r["unit"]], r)
        for sensor, part, block in blocks(device.diagnosis)
        for name, r in block["residuals"].items()
    ]
    return Table(
        "Held-out residuals, root mean square",
        ("Residual", "Unit", "Count", "Floor", "Before", "After", "χ² before", "χ² after"),
        [
            (
                words,
                display.unit,
                Sized(text_of(r["n"]), r["n"]),
                *(sized(r[k], display.factor) for k in ("floor", "before", "after")),
                *(sized(r[k]) for k in ("chi2_before", "chi2_after")),
            )
            for words, display, r in found
        ],
        "Held-out: each pose or block of time is predicted by a calibration that never saw it. "
        "Floor: what the noise alone gives. Reduced χ² is 1 where the residual is noise.",
        sortable=True,
    )


def steps_table(sensor, part, block):
    """Return the effects in the order in which they were added; None without any."""
    residuals, rows = block["residuals"], []
    for place, effect in enumerate(block["effects"], 1):
        # the residual that it was judged by; of one that the block lacks the unit is not known
        name, errors = effect["residual"], (NO_NUMBER, NO_NUMBER)
        if name in residuals:
            unit = RESIDUAL[residuals[name]["unit"]]
            errors = (unit.text(effect[f"heldout_{when}"]) for when in ("before", "after"))
        rows.append(
            (
                f"{place}. {effect['name']}",
                probability(effect["p_value"]),
                RESIDUAL_WORDS[name],
                *errors,
                interval_text(effect["ratio_ci95"]),
            )
        )
    return rows and Table(
        f"{sensor.capitalize()}, {PARTS[part]}: effects added, in order",
        (
            *("Effect", "p-value", "Held-out error of", "Before", "After"),
            "Ratio after/before, 95 %",
        ),
        rows,
        "An effect is added only if it is no chance in the fit (its p-value is averaged over what "
        "is known of the noise) and lowers the error on data that the fit never saw: the interval "
        "of the ratio lies below 1. Then the rest is tested again.",
    )


def parameter_rows(effect):
    """Return the parameters of an effect: name, value ± σ and unit of data sheets, both in SI."""
    rows = []
    for name, value in effect["parameters"].items():
        unit, sigma = effect["units"][name], effect["std"].get(name)
        display = data_sheet(unit)
        shown = with_sigma(value, sigma, display.factor), display.unit
        si = with_sigma(value, sigma), typeset(unit)
        rows.append((f"{name}{_place(name, effect)}", *shown, *si))
    return rows


def effect_table(sensor, part, effect):
    """Return the table of an effect that was added: its parameters ± σ."""
    known, units, rows = Effect.library.get(effect["name"]), effect["units"], parameter_rows(effect)
    if effect["name"] == TurnOnBias.name:
        si = next(iter(units.values()))
        shown = data_sheet(si)
        run_to_run, interval = TurnOnBias(**effect["constants"]).run_to_run(effect["parameters"])
        for axis, value, low, high in zip(XYZ, run_to_run, *interval, strict=True):
            ends = f"{shown.size(low)} to {shown.size(high)} {shown.unit}"
            label = f"run to run, {axis}: 1 σ, 95 % interval {ends}"
            rows.append((label, shown.size(value), shown.unit, number(value), typeset(si)))
    note = f"{known.equation} ({known.reference})." if known else ""
    if effect["constants"].get("marker"):
        note = note.replace(known.equation, known.of_place)
    elif part == "reference" and effect["name"] == TimeOffset.name:
        note += " What is stamped t was there at t + dt by the reference's clock."
    if constants := constants_text(effect["constants"]):
        note = f"{note} Of the shapes that were tried this one is best: {constants}.".strip()
    return Table(
        f"{effect['name']}, added to the {sensor} ({PARTS[part]})",
        ("Parameter", "Value ± 1 σ", "Unit", "Value ± 1 σ, SI", "SI unit"),
        rows,
        note,
    )


def _place(name, effect):
    """Return when and in which session the step that a parameter belongs to was."""
    constants = effect["constants"]
    steps = list(zip(constants.get("sessions", ()), constants.get("times", ()), strict=False))
    count = re.search(r"\d+", name)
    if not count or not 0 < int(count[0]) <= len(steps):
        return ""
    session, time = steps[int(count[0]) - 1]
    return f", {session} at {duration(time)}"


def orientations(device):
    """Return which axis pointed up in each session at rest, as ``+z up``, where one did."""
    found = {}
    for session in device.used:
        still = session.segments[session.segments["kind"] == "static"]
        if session.kind == "static" and len(still):
            up = np.average(still[[f"{c}_mean" for c in ACCELERATION]], axis=0, weights=still["n"])
            axis = int(np.abs(up).argmax())
            if abs(up[axis]) >= ON_AXIS * np.linalg.norm(up):
                found[session.name] = f"{'+' if up[axis] > 0 else '−'}{XYZ[axis]} up"
    return found


def heldout_by_session(device, sensor, block):
    """Return the held-out error of each session and axis with its floor; None where not given."""
    residual = block["residuals"].get("bias", {})
    if "sessions" not in residual:
        return None
    unit, up = RESIDUAL[residual["unit"]], orientations(device)
    rows, gains = [], []
    for session, axes in residual["sessions"].items():
        for axis, figures in axes.items():
            ratio = figures["before"] / figures["after"] if figures["after"] else None
            gains += [(ratio, f"{session}, {axis[-1]}")] if ratio else []
            cells = (sized(figures[k], unit.factor) for k in ("before", "after", "floor"))
            gain = Sized(f"{number(ratio, 2)} ×", ratio) if ratio else NO_NUMBER
            rows.append((session, up.get(session, NO_NUMBER), axis[-1], *cells, gain))
    most = ""
    if gains:
        ratio, where = max(gains)
        most = f" Most is gained by {where}: {number(ratio, 2)} times."
    return Table(
        f"{sensor.capitalize()}, static record: held-out error of the means, root mean square, "
        f"{unit.unit}",
        (
            *("Session", "Attitude", "Axis"),
            *(f"{w}, {unit.unit}" for w in ("Before", "After", "Floor")),
            "Smaller by",
        ),
        rows,
        "Each block of time is predicted by a bias and effects that were fitted to the other "
        f"blocks. Floor: what the noise alone gives.{most}",
        sortable=True,
    )


def session_tables(device, sensor, block):
    """Return a table for each effect of a static record: its parameters in each session alone."""
    units = {}
    for entry in [*block["candidates"], *block["effects"]]:
        units.setdefault(entry["name"], {}).update(entry.get("units", {}))
    up, tables = orientations(device), []
    for effect, sessions in block.get("by_session", {}).items():
        if len(sessions) < 2:
            continue
        rows = []
        for name in dict.fromkeys(name for fitted in sessions.values() for name in fitted):
            display = data_sheet(units.get(effect, {}).get(name))
            fits = [fitted.get(name, {}) for fitted in sessions.values()]
            cells = (with_sigma(f.get("value"), f.get("std"), display.factor) for f in fits)
            rows.append((name, display.unit, *cells, number(largest_difference(fits), 2)))
        heads = (f"{s}, {up[s]}" if s in up else s for s in sessions)
        tables.append(
            Table(
                f"{sensor.capitalize()}: {effect}, fitted to each session alone, value ± 1 σ",
                ("Parameter", "Unit", *heads, "Largest difference, σ"),
                rows,
                "An effect of the bias alone has the same parameters in every attitude. Where two "
                "sessions differ by many σ, the scale factor changes too (the axis that points up "
                "differs from the others), or the cause is another one that went along.",
            )
        )
    return tables


def largest_difference(fits):
    """Return the largest difference of two estimates in units of its standard error."""
    known = [(f["value"], f["std"]) for f in fits if not missing(f.get("std")) and f["std"] > 0]
    return max(
        (abs(a - b) / np.hypot(s, r) for i, (a, s) in enumerate(known) for b, r in known[:i]),
        default=None,
    )
