"""The tables of the effects that a diagnosis added or tried."""

import re

from imuloop.core.errors import plural
from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.model.effect import Effect
from imuloop.report.findings import record_title, residual_text
from imuloop.report.numbers import (
    NO_NUMBER,
    duration,
    interval_text,
    percent,
    probability,
    text_of,
    with_sigma,
    with_unit,
)
from imuloop.report.page import RECORDS, RESIDUALS, WORDS, effect_words
from imuloop.report.results import XYZ
from imuloop.report.table import Sized, Table, shade
from imuloop.report.units import data_sheet, spans

# the name of an effect's parameter whose last letter or digit is an axis: G01, c2x, rxy
OF_AXIS, OF_AXES = re.compile(r"(\w+)([xyz0-2])"), re.compile(r"[A-Z][0-2][0-2]")
# status of a candidate effect, best first
UNTRIED = ("not_observable", "not_available")
STATUS = ("added", "confounded", "rejected", *UNTRIED)


def steps_table(block):
    """Return the Table of the effects that a diagnosis added to the model, in order.

    Each row is an effect with its p-value and the held-out errors before and after it was added.
    The result is an empty list if no effect was added. `block` is the diagnosis of a sensor in one
    kind of data, as `block_of` returns it.
    """
    residuals, rows = block["residuals"], []
    for place, effect in enumerate(block["effects"], 1):
        name, errors = effect["residual"], (NO_NUMBER, NO_NUMBER)
        # the unit of a residual that the block lacks is not known
        if name in residuals:
            sizes = {when: effect[f"heldout_{when}"] for when in ("before", "after")}
            errors = [residual_text(residuals[name] | sizes, when) for when in sizes]
        chance, ratio = probability(effect["p_value"]), interval_text(effect["ratio_ci95"])
        rows.append((f"{place}. {effect_words(effect)}", chance, RESIDUALS[name], *errors, ratio))
    return rows and Table(
        f"{record_title(block)}: effects added, in order",
        ("Effect", "p-value", "Held-out error of", "Before", "After", "Ratio after/before, 95 %"),
        rows,
        "Errors of the clearest axis; the verdict’s are of all axes, with effects chosen per fold.",
    )


def parameter_rows(effect):
    """Return a table row for each parameter of an effect, a list of tuples of three texts.

    The texts are the name, value ± 1 σ, and the unit that data sheets use. `effect` is an entry of
    the list ``effects`` in diagnosis.json.
    """
    rows = []
    for name, value in effect["parameters"].items():
        display, sigma = data_sheet(effect["units"][name]), effect["std"].get(name)
        text = with_sigma(value, sigma, display.factor)
        rows.append((f"{name}{_step(effect, name)}", text, display.unit))
    return rows


def matrix_rows(effect):
    """Return the parameters of an effect as rows of a matrix, a list; its columns are x, y and z.

    A row is a tuple: the name of three parameters without their axis, a cell for each axis of the
    sensor, and the unit. The list is empty if the name of any parameter does not end in an axis, as
    then the parameters do not make a matrix. `effect` is an entry of the list ``effects`` in
    diagnosis.json.
    """
    values, units, largest, rows = effect["parameters"], effect["units"], {}, {}
    if not all(map(OF_AXIS.fullmatch, values)):
        return []
    # values of one unit share their colours
    for name, value in values.items():
        largest[units[name]] = max(largest.get(units[name], 0.0), abs(value))
    for name, value in values.items():
        stem, axis = OF_AXIS.fullmatch(name).groups()
        display, axis = data_sheet(units[name]), XYZ[int(axis)] if axis.isdigit() else axis
        # of two axes in a name, the first one is the axis of the sensor
        stem = f"{stem[:-1]}, on {XYZ[int(stem[-1])]}" if OF_AXES.fullmatch(name) else stem
        row = rows.setdefault(stem, dict.fromkeys(XYZ, NO_NUMBER) | {"unit": display.unit})
        row[axis] = shade(value, effect["std"].get(name), largest[units[name]], display)
    return [(f"{stem}{_step(effect, stem)}", *cells.values()) for stem, cells in rows.items()]


def _step(effect, name):
    """Return session and time of a step of the bias as text, such as ", night at 3 h".

    The text goes behind the name of the parameter in a table. `effect` is an entry of the list
    ``effects`` in diagnosis.json, in which the bias may jump at several steps. `name` is the name
    of a parameter, and the number in it is the number of the step. The text is empty if the effect
    has no such step.
    """
    sessions, times = (effect["constants"].get(key, ()) for key in ("sessions", "times"))
    step = int((re.search(r"\d+", name) or ["0"])[0]) - 1
    within = 0 <= step < min(len(sessions), len(times))
    return f", {sessions[step]} at {duration(times[step])}" if within else ""


def effect_table(block, effect):
    """Return the Table of the parameters ± 1 σ of an effect that a diagnosis added to the model.

    `block` is the diagnosis of a sensor in one kind of data, as `block_of` returns it, and `effect`
    is an entry of its list ``effects``.
    """
    kind = Effect.library.get(effect["name"])
    rows, columns = matrix_rows(effect), ("Parameter", *XYZ, "Unit")
    if effect["name"] == TurnOnBias.name or not rows:
        rows, columns = parameter_rows(effect), ("Parameter", "Value ± 1 σ", "Unit")
    if effect["name"] == TurnOnBias.name:
        shown = data_sheet(next(iter(effect["units"].values())))
        std, interval = TurnOnBias(**effect["constants"]).repeatability(effect["parameters"])
        for axis, value, low, high in zip(XYZ, std, *interval, strict=True):
            ends = f"{shown.size(low)} to {shown.text(high)}"
            label = f"over power cycles, {axis}: 1 σ, 95 % interval {ends}"
            rows.append((label, shown.size(value), shown.unit))
    note = f"{kind.equation} ({kind.reference})." if kind else ""
    if block["part"] == "reference":
        note = (
            "The reference's clock shows t + dt where the log is stamped t; r is the vector from "
            "the marker to the IMU."
        )
    if constants := constants_text(effect["constants"]):
        note = f"{note} The variant with the least error: {constants}.".strip()
    place = f"the {block['sensor']} ({RECORDS[block['part']]})"
    return Table(f"{effect_words(effect)}, added to {place}, ± 1 σ", columns, rows, note)


def set_up_table(block):
    """Return the Table of bias and mounting of a sensor in its sessions with a reference.

    The mounting is the rotation between the axes of the body and of the reference. The result is an
    empty list without such a session. `block` is the diagnosis of the sensor in these sessions, as
    `block_of` returns it.
    """
    rows = []
    for session, content in block.get("set_up", {}).items():
        rows += [(f"{session}, {name}", *cells) for name, *cells in parameter_rows(content)]
    note = "b: bias as logged. m: rotation vector from the axes of the body to the reference's."
    title = f"{block['sensor'].capitalize()}, sessions with a reference"
    return rows and Table(title, ("Parameter", "Value ± 1 σ", "Unit"), rows, note)


def ranked(block):
    """Return the candidate effects of a diagnosis, sorted by status in the order of `STATUS`.

    Candidates with the status ``added`` are in the order in which they were added to the model,
    candidates of another status are sorted by p-value. `block` is the diagnosis of a sensor in one
    kind of data, as `block_of` returns it.
    """
    order = [effect["name"] for effect in block["effects"]]
    return sorted(
        block["candidates"],
        key=lambda c: (
            STATUS.index(c["status"]),
            order.index(c["name"]) if c["name"] in order else len(order),
            float("inf") if c["p_value"] is None else c["p_value"],
        ),
    )


def ranking_table(block):
    """Return the Table of the effects that were tested, with status and detection limit.

    The detection limit is the least size of a parameter that would be seen in these data. The
    result is None if no effect was tested. `block` is the diagnosis of a sensor in one kind of
    data, as `block_of` returns it.
    """
    candidates = ranked(block)
    tried = [c for c in candidates if c["status"] not in UNTRIED]
    if not tried:
        return None
    rows, notes, pairs = [], [], {}
    for c in tried:
        status, twin = c["status"].replace("_", " "), c["confounded_with"]
        status += f" with {effect_words({'name': twin})}" if twin else ""
        limits = "; ".join(spans(c["detection_limit"] or {}, c.get("units", {})))
        rank = STATUS.index(c["status"])
        rows.append((effect_words(c), Sized(status, rank), limits or NO_NUMBER))
    if untried := len(candidates) - len(tried):
        count = plural(untried, "more effect")
        notes.append(f"{count} could not be tested with these data; diagnosis.json says why.")
    for pair in block["confounded"]:
        names = frozenset((pair["effect"], pair["with"]))
        words = (effect_words({"name": pair[key]}) for key in ("effect", "with"))
        pairs.setdefault(names, f"{' and '.join(words)} (share in common {percent(pair['share'])})")
    if pairs:
        notes.append(f"Cannot be told apart in these data: {', '.join(pairs.values())}.")
    title = f"{record_title(block)}: candidate effects, by status and p-value"
    heads = ("Effect", "Status", "Would be seen from")
    return Table(title, heads, rows, " ".join(notes), dense=True, sortable=True)


def constants_text(constants):
    """Return the constants of an effect, such as its order or time constant, as text.

    `constants` is a dict by name. The text is empty if there are none.
    """
    parts = []
    for name, value in constants.items():
        if name == "times":
            more = ", …" * (len(value) > 3)
            times = ", ".join(map(duration, value[:3]))
            parts.append(f"{plural(len(value), 'step')}, {times}{more}")
        elif name not in ("sessions", "spans"):
            symbol, unit = WORDS["constants"].get(name, (name.replace("_", " "), ""))
            text = str(value) if isinstance(value, (int, str)) else text_of(value)
            parts.append(f"{symbol} {with_unit(text, unit) if unit else text}")
    return ", ".join(parts)
