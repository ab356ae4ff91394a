"""The diagnosis in tables: held-out errors, the effects that were added and what they gained."""

import re

from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.model.effect import Effect
from imuloop.report.numbers import (
    NO_NUMBER,
    duration,
    interval_text,
    probability,
    with_sigma,
)
from imuloop.report.results import XYZ
from imuloop.report.tables.candidates import constants_text
from imuloop.report.tables.table import Table
from imuloop.report.units import RESIDUAL, data_sheet
from imuloop.report.verdict import PARTS, RESIDUAL_WORDS

# what the parameters of a reference's set-up mean
BESIDE = "What is stamped t was there at t + dt by the reference's clock; r is from its marker."


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
        "Added is what is no chance in the fit and lowers the error on data that it never saw.",
    )


def parameter_rows(effect):
    """Return the parameters of an effect: name, value ± σ and unit of data sheets."""
    rows = []
    for name, value in effect["parameters"].items():
        unit, sigma = effect["units"][name], effect["std"].get(name)
        display = data_sheet(unit)
        shown = with_sigma(value, sigma, display.factor), display.unit
        rows.append((f"{name}{_place(name, effect)}", *shown))
    return rows


def effect_table(sensor, part, effect):
    """Return the table of an effect that was added: its parameters ± σ."""
    known, units, rows = Effect.library.get(effect["name"]), effect["units"], parameter_rows(effect)
    if effect["name"] == TurnOnBias.name:
        si = next(iter(units.values()))
        shown = data_sheet(si)
        std, interval = TurnOnBias(**effect["constants"]).repeatability(effect["parameters"])
        for axis, value, low, high in zip(XYZ, std, *interval, strict=True):
            ends = f"{shown.size(low)} to {shown.size(high)} {shown.unit}"
            label = f"over power cycles, {axis}: 1 σ, 95 % interval {ends}"
            rows.append((label, shown.size(value), shown.unit))
    note = f"{known.equation} ({known.reference})." if known else ""
    if part == "reference":
        note = BESIDE
    if constants := constants_text(effect["constants"]):
        note = f"{note} Of the shapes that were tried this one is best: {constants}.".strip()
    return Table(
        f"{effect['name']}, added to the {sensor} ({PARTS[part]})",
        ("Parameter", "Value ± 1 σ", "Unit"),
        rows,
        note,
    )


def set_up_table(sensor, block):
    """Return bias and mounting of each session beside a reference; None without any."""
    found = block.get("set_up", {}).items()
    rows = [(f"{n}, {row[0]}", *row[1:]) for n, own in found for row in parameter_rows(own)]
    note = "b is the bias as logged, m the rotation vector from the body to the reference's."
    heads = ("Parameter", "Value ± 1 σ", "Unit")
    return rows and Table(f"{sensor.capitalize()}, sessions beside a reference", heads, rows, note)


def _place(name, effect):
    """Return when and in which session the step that a parameter belongs to was."""
    constants = effect["constants"]
    steps = list(zip(constants.get("sessions", ()), constants.get("times", ()), strict=False))
    count = re.search(r"\d+", name)
    if not count or not 0 < int(count[0]) <= len(steps):
        return ""
    session, time = steps[int(count[0]) - 1]
    return f", {session} at {duration(time)}"
