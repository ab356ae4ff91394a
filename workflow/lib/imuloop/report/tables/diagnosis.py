"""The diagnosis in tables: held-out errors, the effects that were added and what they gained."""

import re

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.samples import ACCELERATION
from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.report.effect_units import data_sheet
from imuloop.report.numbers import (
    NO_NUMBER,
    RESIDUAL,
    duration,
    missing,
    number,
    probability,
    text_of,
    typeset,
    with_sigma,
    with_unit,
)
from imuloop.report.results import XYZ
from imuloop.report.tables.candidates import constants_text
from imuloop.report.tables.table import Sized, Table, sized
from imuloop.report.verdict import PARTS, RESIDUAL_WORDS, blocks

# cosine of the angle within which a session lies on an axis, 20 degrees
ON_AXIS = 0.94


def heldout_table(device):
    """Return held-out residuals before and after, their floor and reduced χ²."""
    rows = []
    for sensor, part, block in blocks(device.diagnosis):
        for name, r in (block.get("residuals") or {}).items():
            display = RESIDUAL[r["unit"]]
            rows.append(
                (
                    f"{sensor}, {PARTS[part]}: {RESIDUAL_WORDS.get(name, name)}",
                    display.unit,
                    Sized(text_of(r.get("n")), r.get("n")),
                    *(sized(r.get(k), display.factor) for k in ("floor", "before", "after")),
                    *(sized(r.get(k)) for k in ("chi2_before", "chi2_after")),
                )
            )
    return Table(
        "Held-out residuals, root mean square",
        ("Residual", "Unit", "Count", "Floor", "Before", "After", "χ² before", "χ² after"),
        rows,
        "Held-out: each pose or block of time is predicted by a calibration that never saw it. "
        "Floor: what the noise alone gives. Reduced χ² is 1 where the residual is noise.",
        sorts=range(8),
    )


def steps_table(sensor, part, block):
    """Return the effects in the order in which they were added; None without any."""
    effects, residuals = block.get("effects") or [], block.get("residuals") or {}
    if not effects:
        return None
    rows = []
    for place, effect in enumerate(effects, 1):
        # the residual that it was judged by
        name = effect.get("residual")
        name = name if name in residuals else next(iter(residuals))
        unit = RESIDUAL[residuals[name]["unit"]]
        errors = (
            NO_NUMBER if missing(v) else with_unit(number(v * unit.factor), unit.unit)
            for v in (effect.get("heldout_before"), effect.get("heldout_after"))
        )
        ratio = effect.get("ratio_ci95") or (None, None)
        rows.append(
            (
                f"{place}. {effect['name']}",
                probability(effect.get("p_value")),
                RESIDUAL_WORDS.get(name, name),
                *errors,
                NO_NUMBER if any(map(missing, ratio)) else " to ".join(number(r, 2) for r in ratio),
            )
        )
    return Table(
        f"{sensor.capitalize()}, {PARTS[part]}: effects added, in order",
        (
            *("Effect", "p-value", "Held-out error of", "Before", "After"),
            "Ratio after/before, 95 %",
        ),
        rows,
        "An effect is added only if it is no chance in the fit and lowers the error on data that "
        "the fit never saw: the interval of the ratio lies below 1. Then the rest is tested again.",
    )


def effect_tables(sensor, part, block):
    """Return a table for each effect that was added: its parameters ± σ."""
    return [_effect_table(sensor, part, e) for e in block.get("effects") or []]


def _effect_table(sensor, part, effect):
    known = Effect.library.get(effect["name"])
    units, std = effect.get("units") or {}, effect.get("std") or {}
    rows = []
    for name, value in effect["parameters"].items():
        display = data_sheet(units.get(name))
        in_sheet, in_si = (_pm(value, std.get(name), f) for f in (display.factor, 1.0))
        label = f"{name}{_place(name, effect)}"
        rows.append((label, in_sheet, display.unit, in_si, typeset(units.get(name) or "SI")))
    if effect["name"] == TurnOnBias.name:
        si = next(iter(units.values()))
        shown = data_sheet(si)
        run_to_run, interval = TurnOnBias(**effect["constants"]).run_to_run(effect["parameters"])
        for axis, value, *ends in zip(XYZ, run_to_run, *interval, strict=True):
            low, high = (number(end * shown.factor) for end in ends)
            label = f"run to run, {axis}: 1 σ, 95 % interval {low} to {high} {shown.unit}"
            cells = (number(value * shown.factor), shown.unit, number(value), typeset(si))
            rows.append((label, *cells))
    note = f"{known.equation} ({known.reference})." if known else ""
    if constants := constants_text(effect.get("constants")):
        note = f"{note} Of the shapes that were tried this one is best: {constants}.".strip()
    return Table(
        f"{effect['name']}, added to the {sensor} ({PARTS[part]})",
        ("Parameter", "Value ± 1 σ", "Unit", "Value ± 1 σ, SI", "SI unit"),
        rows,
        note,
    )


def _pm(value, std, factor):
    return with_sigma(value * factor, None if missing(std) else std * factor)


def _place(name, effect):
    """Return when and in which session the step that a parameter belongs to was."""
    constants = effect.get("constants") or {}
    steps = list(zip(constants.get("sessions") or [], constants.get("times") or [], strict=False))
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
    residual = (block.get("residuals") or {}).get("bias") or {}
    sessions = residual.get("sessions")
    if not sessions:
        return None
    unit, up = RESIDUAL[residual["unit"]], orientations(device)
    rows, gains = [], []
    for session, axes in sessions.items():
        for axis, figures in axes.items():
            errors = [figures.get(k) for k in ("before", "after", "floor")]
            gain = NO_NUMBER
            if not any(map(missing, errors[:2])) and errors[1] > 0:
                ratio = errors[0] / errors[1]
                gains.append((ratio, f"{session}, {axis[-1]}"))
                gain = Sized(f"{number(ratio, 2)} ×", ratio)
            cells = (sized(v, unit.factor) for v in errors)
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
        sorts=range(7),
    )


def session_tables(device, sensor, block):
    """Return a table for each effect of a static record: its parameters in each session alone."""
    units = {}
    for entry in [*(block.get("candidates") or []), *(block.get("effects") or [])]:
        units.setdefault(entry["name"], {}).update(entry.get("units") or {})
    up, tables = orientations(device), []
    for effect, sessions in (block.get("by_session") or {}).items():
        if len(sessions) < 2:
            continue
        rows = []
        for name in dict.fromkeys(name for fitted in sessions.values() for name in fitted):
            display = data_sheet((units.get(effect) or {}).get(name))
            fits = [fitted.get(name) or {} for fitted in sessions.values()]
            cells = (
                NO_NUMBER
                if missing(f.get("value"))
                else _pm(f["value"], f.get("std"), display.factor)
                for f in fits
            )
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
    known = [
        (f["value"], f["std"])
        for f in fits
        if not missing(f.get("value")) and not missing(f.get("std")) and f["std"] > 0
    ]
    return max(
        (abs(a - b) / np.hypot(s, r) for i, (a, s) in enumerate(known) for b, r in known[:i]),
        default=None,
    )
