"""The diagnosis in tables: held-out residuals, the effects that were added and what they gained."""

import re

from imuloop.core.effect import Effect
from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.report.data_tables import text_of
from imuloop.report.effect_units import data_sheet
from imuloop.report.numbers import (
    NO_NUMBER,
    RESIDUAL,
    duration,
    missing,
    number,
    probability,
    typeset,
    with_sigma,
    with_unit,
)
from imuloop.report.ranking import constants_text
from imuloop.report.results import SENSORS
from imuloop.report.table import Sized, Table, sized
from imuloop.report.verdict import PARTS, RESIDUAL_WORDS, block_of


def blocks(device):
    """Return every part of the diagnosis: (sensor, part, content)."""
    return [
        (sensor, part, block)
        for sensor in SENSORS
        for part in PARTS
        if (block := block_of(device.diagnosis, sensor, part))
    ]


def heldout_table(device):
    """Return held-out residuals before and after, their floor and reduced χ²."""
    rows = []
    for sensor, part, block in blocks(device):
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
        tuple(rows),
        "Held-out: each pose or block of time is predicted by a calibration that never saw it. "
        "Floor: what the noise alone gives. Reduced χ² is 1 where the residual is noise.",
        sorts=tuple(range(8)),
    )


def steps_table(sensor, part, block):
    """Return the effects in the order in which they were added; None without any."""
    effects = block.get("effects") or []
    if not effects:
        return None
    rows = []
    for place, effect in enumerate(effects, 1):
        display, words = _compared(block, effect)
        before, after = (
            NO_NUMBER
            if display is None or missing(effect.get(key))
            else with_unit(number(effect[key] * display.factor), display.unit)
            for key in ("heldout_before", "heldout_after")
        )
        ratio = effect.get("ratio_ci95") or (None, None)
        interval = " to ".join(number(r, 2) for r in ratio)
        rows.append(
            (
                f"{place}. {effect['name']}",
                probability(effect.get("p_value")),
                words,
                before,
                after,
                NO_NUMBER if any(map(missing, ratio)) else interval,
            )
        )
    return Table(
        f"{sensor.capitalize()}, {PARTS[part]}: effects added, in order",
        (
            *("Effect", "p-value", "Held-out error of", "Before", "After"),
            "Ratio after/before, 95 %",
        ),
        tuple(rows),
        "An effect is added only if it is no chance in the fit and lowers the error on data that "
        "the fit never saw: the interval of the ratio lies below 1. Then the rest is tested again.",
    )


def _compared(block, effect):
    """Return unit and words of the residual that an effect was judged by."""
    residuals = block.get("residuals") or {}
    given = effect.get("residual")
    name = given if given in residuals else next(iter(residuals), None)
    if name is None:
        return None, NO_NUMBER
    return RESIDUAL[residuals[name]["unit"]], RESIDUAL_WORDS.get(name, name)


def effect_units(block):
    """Return the SI units of the parameters of each effect of a diagnosis."""
    found = {}
    for entry in [*(block.get("candidates") or []), *(block.get("effects") or [])]:
        found[entry["name"]] = found.get(entry["name"], {}) | (entry.get("units") or {})
    return found


def effect_tables(sensor, part, block):
    """Return a table for each effect that was added: its parameters ± σ."""
    return [_effect_table(sensor, part, e) for e in block.get("effects") or []]


def _effect_table(sensor, part, effect):
    known = Effect.library.get(effect["name"])
    units, std = effect.get("units") or {}, effect.get("std") or {}
    rows = []
    for name, value in effect["parameters"].items():
        si = units.get(name)
        display = data_sheet(si)
        sigma = std.get(name)
        rows.append(
            (
                f"{name}{_place(name, effect)}",
                with_sigma(
                    value * display.factor, None if missing(sigma) else sigma * display.factor
                ),
                display.unit,
                with_sigma(value, sigma),
                typeset(si or "SI"),
            )
        )
    if effect["name"] == TurnOnBias.name:
        rows += _run_to_run(effect, si)
    note = f"{known.equation} ({known.reference})." if known else ""
    if constants := constants_text(effect.get("constants")):
        note = f"{note} Of the shapes that were tried this one is best: {constants}.".strip()
    return Table(
        f"{effect['name']}, added to the {sensor} ({PARTS[part]})",
        ("Parameter", "Value ± 1 σ", "Unit", "Value ± 1 σ, SI", "SI unit"),
        tuple(rows),
        note,
    )


def _run_to_run(effect, si):
    """Return the rows of the run-to-run standard deviation, the interval in the name's place."""
    std, interval = TurnOnBias(**effect["constants"]).run_to_run(effect["parameters"])
    display = data_sheet(si)
    return [
        (
            f"run to run, {axis}: 1 σ, 95 % interval {number(low * display.factor)} to "
            f"{number(high * display.factor)} {display.unit}",
            number(value * display.factor),
            display.unit,
            number(value),
            typeset(si),
        )
        for axis, value, low, high in zip("xyz", std, *interval, strict=True)
    ]


def _place(name, effect):
    """Return when and in which session the step that a parameter belongs to was."""
    constants = effect.get("constants") or {}
    times, sessions = constants.get("times") or [], constants.get("sessions") or []
    count = re.search(r"\d+", name)
    if not count or not 0 < int(count[0]) <= min(len(times), len(sessions)):
        return ""
    k = int(count[0]) - 1
    return f", {sessions[k]} at {duration(times[k])}"
