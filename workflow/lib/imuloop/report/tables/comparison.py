"""The comparison of devices: the tables on the first screen, and comparison.csv."""

from typing import NamedTuple

import pandas as pd

from imuloop.core.errors import one_line
from imuloop.core.tables import text_cell
from imuloop.report.numbers import NO_NUMBER, missing, with_sigma
from imuloop.report.results import SENSORS, XYZ
from imuloop.report.summary import FIGURE_UNITS, PAIRS
from imuloop.report.units import (
    DEGREE_PER_SECOND,
    DEGREES,
    MILLI_G,
    MILLIRADIAN,
    PERCENT,
    RESIDUAL,
    Display,
    quantities,
)
from imuloop.report.verdict import rank


class Column(NamedTuple):
    """A column of the comparison: the figure of summary.json, what it is, and the unit shown."""

    key: str
    header: str
    display: Display


NOISE = {"N": "White noise", "B": "Bias instability", "K": "Random walk"}
COLUMNS = {
    sensor: [
        Column(f"{sensor}_quoted", "Held-out residual", residual),
        Column(f"{sensor}_bias", "Bias", bias),
        Column(f"{sensor}_scale", "Scale factor error", PERCENT),
        Column(f"{sensor}_misalignment", "Misalignment", MILLIRADIAN),
        *(Column(f"{sensor}_{k}", w, quantities(sensor)[k].sheet[0]) for k, w in NOISE.items()),
    ]
    for sensor, residual, bias in (
        ("accelerometer", MILLI_G, MILLI_G),
        ("gyroscope", DEGREES, DEGREE_PER_SECOND),
    )
}


class Cell(NamedTuple):
    """A cell of the comparison: its text, what stands below in small, and what it is sorted by."""

    text: str
    below: str = ""
    value: float | None = None


def cells(summaries, sensor):
    """Return the cells of a sensor's columns, a list per device."""
    columns = []
    for key, _, display in COLUMNS[sensor]:
        columns.append([_cell(s["figures"].get(key), display) for s in summaries])
    return list(zip(*columns, strict=True))


def _cell(figure, display):
    if not figure:
        return Cell(NO_NUMBER)
    value, upper, logged, floor = (
        figure.get(k) for k in ("value", "upper95", "as_logged", "floor")
    )
    unit = ""
    # a residual may be of another kind than the column
    if floor is not None and (own := RESIDUAL[figure["unit"]]) != display:
        display, unit = own, f"\u202f{own.unit}"
    limit = "" if missing(upper) else f"<\u202f{display.size(upper, 2)}"
    unseen = missing(value)
    below = [
        not missing(floor) and f"floor {display.size(floor, 2)}",
        figure.get("axis") and f"axis {figure['axis']}",
        limit and not unseen and f"{figure['upper95_axis']} {limit}",
        unseen and f"axis {figure['upper95_axis']}, 95 % limit",
        not missing(logged) and f"as logged {display.size(logged, 2)}",
    ]
    below = "; ".join(filter(None, below))
    if unseen:
        return Cell(limit, below, upper)
    text = with_sigma(value, figure["std"], display.factor) + unit
    return Cell(text, below, abs(value))


# kinds of records of every device
PARTS = {
    "poses": "poses",
    "static_record": "at\u00a0rest",
    "motion": "motion",
    "reference": "reference",
}


def verdict_rank(verdicts):
    """Return what the column of verdicts is sorted by: poses, then the others."""
    order = [rank(verdicts[part]) if part in verdicts else 0 for part in PARTS]
    return sum(10**k * each for k, each in enumerate(reversed(order)))


def verdict_parts(verdicts):
    """Return the parts of a sensor's diagnosis that have a verdict: (part, words)."""
    known = ((p, words) for p, words in PARTS.items() if p in verdicts)
    return [(p, words) for p, words in known if verdicts[p] != "not_testable"]


def filter_cells(summary):
    """Return a device's rate and its noise as a filter takes it, SI, in digits for programs.

    White noise and random walk of the accelerometer, then of the gyroscope.
    """
    content = summary["filter"]
    rate = content["rate_hz"]
    row = [Cell(NO_NUMBER if missing(rate) else f"{rate:.4g}", value=rate)]
    for found in (content.get(f"{sensor}_{term}") for sensor in SENSORS for term in "NK"):
        if not found:
            row.append(Cell(NO_NUMBER))
            continue
        axis, raised = found["axis"], found["raised_from"]
        words = f"{axis}, not seen: 95 % limit" if found["limit"] else f"axis {axis}"
        words += "" if raised is None else f", raised from {raised:.2e}"
        row.append(Cell(f"{found['value']:.2e}", words, value=found["value"]))
    return row


def write_comparison(path, summaries, failures=()):
    """Write comparison.csv: a row per summary.json of a device, SI, units in the headers.

    Before them a row for each Failure of a device, with its reason alone.
    """
    rows = [
        _text_cells(
            device=f.device, label=f.label, status="failed", why=f"{f.stage} failed: {f.why}"
        )
        for f in failures
        if f.device
    ]
    table = pd.DataFrame([*rows, *map(_row, summaries)])
    table.to_csv(path, index=False, lineterminator="\n")


def _text_cells(**texts):
    return {key: text_cell(one_line(text)) for key, text in texts.items()}


def _row(summary):
    """Return a row of comparison.csv by its headers, the same for every device."""
    why = [f"{r['session']}: {reason}" for r in summary["rejected"] for reason in r["reasons"]]
    named = {key: summary[key] for key in ("device", "label", "status")}
    row = _text_cells(**named, why="; ".join(why))
    row["simulated"] = str(summary["simulated"]).lower()
    for sensor, units in FIGURE_UNITS.items():
        for part in PARTS:
            verdict = summary["verdicts"][sensor].get(part, "not_testable")
            row[f"{sensor}_{part}_verdict"] = verdict
        for name, unit in units.items():
            figure = summary["figures"].get(f"{sensor}_{name}", {})
            for key in ("value", "std", "upper95") if name in "NBK" else ("value", "std"):
                ending = "" if key == "value" else f"_{key}"
                row[f"{sensor}_{name}{ending} [{unit}]"] = figure.get(key)
        for name, axes in (("bias", XYZ), ("scale", XYZ), ("misalignment", PAIRS)):
            content = summary["axes"].get(f"{sensor}_{name}")
            for i, axis in enumerate(axes):
                for key, ending in (("value", ""), ("std", "_std")):
                    value = content and content[key][i]
                    row[f"{sensor}_{name}_{axis}{ending} [{units[name]}]"] = value
    return row
