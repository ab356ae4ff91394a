"""The comparison of devices: the table on the first screen, and comparison.csv."""

import csv
from dataclasses import dataclass

from imuloop.core.cells import text_cell
from imuloop.core.errors import one_line
from imuloop.report.answer import rank
from imuloop.report.numbers import (
    DEGREE_PER_SECOND,
    DEGREES,
    MILLI_G,
    MILLIRADIAN,
    NO_NUMBER,
    NOISE_UNITS,
    PERCENT,
    Display,
    missing,
    number,
    with_sigma,
)
from imuloop.report.results import SENSORS, XYZ
from imuloop.report.summary import FIGURE_UNITS, PAIRS
from imuloop.report.verdict import PARTS


@dataclass(frozen=True)
class Column:
    """A column of the comparison.

    Attributes
    ----------
    key : str
        Name of the figure in summary.json.
    header : str
        What it is.
    display : Display
        Unit shown.
    """

    key: str
    header: str
    display: Display


_A, _G = NOISE_UNITS["accelerometer"], NOISE_UNITS["gyroscope"]
COLUMNS = {
    "accelerometer": (
        Column("accelerometer_residual", "Held-out residual", MILLI_G),
        Column("accelerometer_bias", "Bias", MILLI_G),
        Column("accelerometer_scale", "Scale factor error", PERCENT),
        Column("accelerometer_misalignment", "Misalignment", MILLIRADIAN),
        Column("accelerometer_N", "White noise", _A["N"][1]),
        Column("accelerometer_B", "Bias instability", _A["B"][1]),
        Column("accelerometer_K", "Random walk", _A["K"][1]),
    ),
    "gyroscope": (
        Column("gyroscope_residual", "Held-out residual", DEGREES),
        Column("gyroscope_bias", "Bias", DEGREE_PER_SECOND),
        Column("gyroscope_scale", "Scale factor error", PERCENT),
        Column("gyroscope_misalignment", "Misalignment", MILLIRADIAN),
        Column("gyroscope_N", "White noise", _G["N"][1]),
        Column("gyroscope_B", "Bias instability", _G["B"][1]),
        Column("gyroscope_K", "Random walk", _G["K"][1]),
    ),
}


@dataclass(frozen=True)
class Cell:
    """A cell of the comparison.

    Attributes
    ----------
    text : str
        What it says.
    below : str
        What stands below it in small.
    best : bool
        Whether it is the best of its column.
    value : float or None
        What the column is sorted by: a size in SI, or a rank.
    """

    text: str
    below: str = ""
    best: bool = False
    value: float | None = None


def best_devices(summaries, key):
    """Return the places of the devices whose figure is smallest; none if fewer than two have it.

    What was not seen counts as large as its limit.
    """
    sizes = {
        i: figure["upper95"] if missing(figure["value"]) else abs(figure["value"])
        for i, s in enumerate(summaries)
        if (figure := s["figures"].get(key))
    }
    least = min(sizes.values(), default=None)
    return {i for i, v in sizes.items() if len(sizes) > 1 and v == least}


def cells(summaries, sensor):
    """Return the cells of a sensor's columns, a list a device."""
    best = {column.key: best_devices(summaries, column.key) for column in COLUMNS[sensor]}
    return [
        [
            _cell(s["figures"].get(column.key), column.display, i in best[column.key])
            for column in COLUMNS[sensor]
        ]
        for i, s in enumerate(summaries)
    ]


def _cell(figure, display, best):
    if not figure:
        return Cell(NO_NUMBER)
    factor = display.factor
    upper, logged, floor = (figure.get(key) for key in ("upper95", "as_logged", "floor"))
    limit = "" if missing(upper) else f"<\u202f{number(upper * factor, 2)}"
    below = [] if missing(logged) else [f"as logged {number(logged * factor, 2)}"]
    if missing(figure["value"]):
        below.insert(0, f"axis {figure['upper95_axis']}, 95 % limit")
        return Cell(limit, "; ".join(below), best, upper)
    if limit:
        below.insert(0, f"{figure['upper95_axis']} {limit}")
    if figure.get("axis"):
        below.insert(0, f"axis {figure['axis']}")
    if not missing(floor):
        below.insert(0, f"floor {number(floor * factor, 2)}")
    std = figure["std"]
    text = with_sigma(figure["value"] * factor, None if missing(std) else std * factor)
    return Cell(text, "; ".join(below), best, abs(figure["value"]))


def verdict_rank(verdicts):
    """Return what the column of verdicts is sorted by: poses first, then the static record."""
    poses, still = (rank(verdicts[part]["verdict"]) for part in PARTS)
    return 10 * poses + still


def verdict_parts(verdicts):
    """Return the parts of a sensor's diagnosis that have a verdict: (part, words)."""
    words = {"poses": "poses", "static_record": "at\u00a0rest"}
    return [(p, words[p]) for p in PARTS if verdicts[p]["verdict"] != "not_testable"]


def rate_cell(summary):
    """Return the rate of a device's logs."""
    rate = summary["filter"].get("rate_hz")
    return Cell(NO_NUMBER if missing(rate) else f"{rate:.4g}", value=rate)


def filter_cells(summary):
    """Return a device's noise as a filter takes it, in SI and in digits that programs read.

    White noise and random walk of the accelerometer, then of the gyroscope.
    """
    return [
        Cell(f"{found['value']:.2e}", _filter_words(found), value=found["value"])
        if (found := summary["filter"].get(f"{sensor}_{term}"))
        else Cell(NO_NUMBER)
        for sensor in SENSORS
        for term in "NK"
    ]


def _filter_words(found):
    """Return which axis it is of, and what it was before it was raised."""
    axis, raised_from = found["axis"], found["raised_from"]
    words = f"{axis}, not seen: 95 % limit" if found["limit"] else f"axis {axis}"
    return words if raised_from is None else f"{words}, raised from {raised_from:.2e}"


def write_comparison(path, summaries):
    """Write comparison.csv: a row a device, SI, units in the headers.

    Parameters
    ----------
    path : path-like
        File to write.
    summaries : list of dict
        Content of summary.json of each device.
    """
    rows = [_row(s) for s in summaries]
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]) if rows else [], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _row(summary):
    """Return a row of comparison.csv by its headers, the same for every device."""
    row = {key: summary[key] for key in ("device", "label", "status")}
    # a rejected session's reasons where nothing failed
    why = [f"{f['stage']} failed: {f['why']}" for f in summary["failed"]] or [
        f"{r['session']}: {reason}" for r in summary["rejected"] for reason in r["reasons"]
    ]
    row["why"] = "; ".join(why)
    row = {key: text_cell(one_line(text)) for key, text in row.items()}
    row["simulated"] = str(summary["simulated"]).lower()
    for sensor, units in FIGURE_UNITS.items():
        for part in PARTS:
            row[f"{sensor}_{part}_verdict"] = summary["verdicts"][sensor][part]["verdict"]
        for name, unit in units.items():
            figure = summary["figures"].get(f"{sensor}_{name}", {})
            for key in ("value", "std", "upper95") if name in "NBK" else ("value", "std"):
                header = f"{sensor}_{name}{'' if key == 'value' else f'_{key}'} [{unit}]"
                row[header] = _digits(figure.get(key))
        for name, axes in (("bias", XYZ), ("scale", XYZ), ("misalignment", PAIRS)):
            content = summary["axes"].get(f"{sensor}_{name}", {})
            for i, axis in enumerate(axes):
                for key, ending in (("value", ""), ("std", "_std")):
                    value = content[key][i] if content else None
                    row[f"{sensor}_{name}_{axis}{ending} [{units[name]}]"] = _digits(value)
    return row


def _digits(value):
    return "" if missing(value) else repr(value)
