"""The comparison of devices: the table on the first screen, and comparison.csv."""

import csv
from dataclasses import dataclass

from imuloop.report.numbers import (
    DEGREE_PER_SECOND,
    DEGREES,
    MILLI_G,
    NO_NUMBER,
    NOISE_UNITS,
    PERCENT,
    Display,
    missing,
    number,
    with_sigma,
)
from imuloop.report.results import SENSORS, XYZ
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
        Column("accelerometer_N", "White noise", _A["N"][1]),
        Column("accelerometer_B", "Bias instability", _A["B"][1]),
    ),
    "gyroscope": (
        Column("gyroscope_residual", "Held-out residual", DEGREES),
        Column("gyroscope_bias", "Bias", DEGREE_PER_SECOND),
        Column("gyroscope_scale", "Scale factor error", PERCENT),
        Column("gyroscope_N", "White noise", _G["N"][1]),
        Column("gyroscope_B", "Bias instability", _G["B"][1]),
    ),
}


@dataclass(frozen=True)
class Cell:
    """A cell of the comparison: text, what stands below it in small, whether it is the best."""

    text: str
    below: str = ""
    best: bool = False


def best_devices(summaries, key):
    """Return the places of the devices whose figure is smallest; none if fewer than two have it."""
    sizes = {
        i: abs(figure["value"])
        for i, s in enumerate(summaries)
        if (figure := s["figures"].get(key)) and not missing(figure["value"])
    }
    return {i for i, v in sizes.items() if len(sizes) > 1 and v == min(sizes.values())}


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
    axis = f"axis {figure['axis']}" if figure.get("axis") else ""
    upper = figure.get("upper95")
    limit = "" if missing(upper) else f"<\u202f{number(upper * factor, 2)}"
    logged = figure.get("as_logged")
    logged = "" if missing(logged) else f"; as logged {number(logged * factor, 2)}"
    if missing(figure["value"]):
        return Cell(limit, f"axis {figure['upper95_axis']}, 95 % limit{logged}")
    if limit:
        axis += f"; {figure['upper95_axis']} {limit}"
    if not missing(figure.get("floor")):
        axis = f"floor {number(figure['floor'] * factor, 2)}"
    axis += logged
    std = figure["std"]
    text = with_sigma(figure["value"] * factor, None if missing(std) else std * factor)
    return Cell(text, axis, best)


def write_comparison(path, summaries):
    """Write comparison.csv: a row a device, SI, units in the headers.

    Parameters
    ----------
    path : path-like
        File to write.
    summaries : list of dict
        Content of summary.json of each device.
    """
    units = {
        "residual": {"accelerometer": "m/s^2", "gyroscope": "rad"},
        "bias": {"accelerometer": "m/s^2", "gyroscope": "rad/s"},
        "scale": {"accelerometer": "1", "gyroscope": "1"},
        "N": {"accelerometer": "m/s^2/sqrt(Hz)", "gyroscope": "rad/s/sqrt(Hz)"},
        "B": {"accelerometer": "m/s^2", "gyroscope": "rad/s"},
    }
    header = ["device", "label", "simulated"]
    for sensor in SENSORS:
        header += [f"{sensor}_{part}_verdict" for part in PARTS]
        for figure, unit in units.items():
            name = f"{sensor}_{figure}"
            header += [f"{name} [{unit[sensor]}]", f"{name}_std [{unit[sensor]}]"]
            if figure in ("N", "B"):
                header.append(f"{name}_upper95 [{unit[sensor]}]")
        for figure in ("bias", "scale"):
            for axis in XYZ:
                name = f"{sensor}_{figure}_{axis}"
                header += [f"{name} [{units[figure][sensor]}]"]
                header += [f"{name}_std [{units[figure][sensor]}]"]
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(_row(s, units) for s in summaries)


def _row(summary, units):
    row = [summary["device"], summary["label"], str(summary["simulated"]).lower()]
    for sensor in SENSORS:
        row += [summary["verdicts"][sensor][part]["verdict"] for part in PARTS]
        for name in units:
            figure = summary["figures"].get(f"{sensor}_{name}", {})
            keys = ("value", "std", "upper95") if name in ("N", "B") else ("value", "std")
            row += ["" if missing(figure.get(key)) else repr(figure[key]) for key in keys]
        for name in ("bias", "scale"):
            content = summary["axes"].get(f"{sensor}_{name}")
            for i in range(3):
                pair = (content["value"][i], content["std"][i]) if content else (None, None)
                row += ["" if missing(v) else repr(v) for v in pair]
    return row
