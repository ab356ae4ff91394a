"""The diagnosis in tables: residuals, effects added, candidates and why; held-out numbers."""

from imuloop.core.effect import Effect
from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from imuloop.report.data_tables import text_of
from imuloop.report.numbers import (
    NO_NUMBER,
    RESIDUAL,
    Display,
    missing,
    number,
    probability,
    typeset,
    with_sigma,
    with_unit,
)
from imuloop.report.table import Table
from imuloop.report.verdict import PARTS, RESIDUAL_WORDS, block_of, quoted

# data-sheet units of effects' parameters, by their SI unit
EFFECT_UNITS = {
    "rad/s per m/s^2": Display("°/s per g", STANDARD_GRAVITY / DEGREE),
    "m/s^2 per K": Display("mg/K", 1e3 / STANDARD_GRAVITY),
    "rad/s per K": Display("°/s per K", 1 / DEGREE),
}


def blocks(device):
    """Return every part of the diagnosis: (sensor, part, content)."""
    return [
        (sensor, part, block)
        for sensor in ("accelerometer", "gyroscope")
        for part in PARTS
        if (block := block_of(device.diagnosis, sensor, part))
    ]


def heldout_table(device):
    """Return held-out residuals before and after, their floor and reduced χ²."""
    rows = []
    for sensor, part, block in blocks(device):
        for name, r in (block.get("residuals") or {}).items():
            display = RESIDUAL[r["unit"]]
            figures = (
                number(None if missing(r.get(k)) else r[k] * display.factor)
                for k in ("floor", "before", "after")
            )
            rows.append(
                (
                    f"{sensor}, {PARTS[part]}: {RESIDUAL_WORDS.get(name, name)}",
                    display.unit,
                    text_of(r.get("n")),
                    *figures,
                    number(r.get("chi2_before")),
                    number(r.get("chi2_after")),
                )
            )
    return Table(
        "Held-out residuals, root mean square",
        ("Residual", "Unit", "Count", "Floor", "Before", "After", "χ² before", "χ² after"),
        tuple(rows),
        "Held-out: each pose or block of time is predicted by a calibration that never saw it. "
        "Floor: what the noise alone gives. Reduced χ² is 1 where the residual is noise.",
    )


def effect_tables(device):
    """Return a table for each effect that was added: its parameters ± σ."""
    tables = []
    for sensor, part, block in blocks(device):
        for effect in block.get("effects") or []:
            tables.append(_effect_table(sensor, part, block, effect))
    return tables


def _effect_table(sensor, part, block, effect):
    known = Effect.library.get(effect["name"])
    si = effect.get("unit") or "SI"
    display = EFFECT_UNITS.get(si)
    std = effect.get("std") or {}
    rows = []
    for name, value in effect["parameters"].items():
        row = [name, with_sigma(value, std.get(name))]
        if display:
            sigma = std.get(name)
            scaled = None if missing(sigma) else sigma * display.factor
            row.append(with_sigma(value * display.factor, scaled))
        rows.append(tuple(row))
    head = ("Parameter", f"Value ± 1 σ, {typeset(si)}") + (
        (f"Value ± 1 σ, {display.unit}",) * bool(display)
    )
    note = _gain(sensor, block, effect)
    if known:
        note = f"{known.equation} ({known.reference}). {note}"
    return Table(
        f"{effect['name']}, added to the {sensor} ({PARTS[part]})", head, tuple(rows), note
    )


def _gain(sensor, block, effect):
    """Return what an effect gained on held-out data, in a sentence."""
    name, residual = quoted(sensor, block)
    if effect.get("residual") in (block.get("residuals") or {}):
        name, residual = effect["residual"], block["residuals"][effect["residual"]]
    before, after = effect.get("heldout_before"), effect.get("heldout_after")
    parts = []
    if residual and not missing(before) and not missing(after):
        unit = RESIDUAL[residual["unit"]]
        parts.append(
            f"Held-out {RESIDUAL_WORDS.get(name, name)}: {number(before * unit.factor)} → "
            f"{with_unit(number(after * unit.factor), unit.unit)}"
        )
    ratio = effect.get("ratio_ci95") or (None, None)
    if not any(map(missing, ratio)):
        parts.append(f"ratio after/before {number(ratio[0])} to {number(ratio[1])} (95 %)")
    if not missing(effect.get("p_value")):
        parts.append(f"p-value {probability(effect['p_value'])}")
    return ", ".join(parts) + "." if parts else ""


def _limit(detection_limit):
    """Return the detection limits of an effect's parameters, their unit at the end."""
    unit = typeset(detection_limit.get("unit", ""))
    values = {k: v for k, v in detection_limit.items() if k != "unit"}
    return f"{text_of(values)} {unit}".rstrip() if values else NO_NUMBER


def candidate_table(device):
    """Return all effects that were thought of: what became of each, and why."""
    rows = []
    for sensor, part, block in blocks(device):
        # the residual that effects are chosen by comes first
        residual = next(iter((block.get("residuals") or {}).values()), None)
        unit = RESIDUAL[residual["unit"]] if residual else None
        for c in block.get("candidates") or []:
            after = c.get("heldout_after")
            rows.append(
                (
                    c["name"],
                    f"{sensor}, {PARTS[part]}",
                    c["status"].replace("_", " "),
                    c.get("why") or NO_NUMBER,
                    probability(c.get("p_value")),
                    with_unit(number(after * unit.factor), unit.unit)
                    if unit and not missing(after)
                    else NO_NUMBER,
                    _limit(c.get("detection_limit") or {}),
                )
            )
    return Table(
        "Candidate effects",
        ("Effect", "Sensor", "Status", "Why", "p-value", "Held-out after", "Detection limit, SI"),
        tuple(rows),
        "p-value: how often noise alone would look this much like the effect. Not observable: "
        "these data cannot show it, whatever its size below the detection limit.",
    )
