"""Noise coefficients in SI and data-sheet units, and the summary statistics of a record."""

from imuloop.report.numbers import NO_NUMBER, NOISE_UNITS, coefficient_text, number
from imuloop.report.results import SENSORS, UNITS, XYZ
from imuloop.report.table import Table

WORDS = {
    "accelerometer": {
        "Q": "Q, quantisation",
        "N": "N, white noise (velocity random walk)",
        "B": "B, bias instability",
        "K": "K, acceleration random walk",
        "R": "R, ramp",
    },
    "gyroscope": {
        "Q": "Q, quantisation",
        "N": "N, white noise (angle random walk)",
        "B": "B, bias instability",
        "K": "K, rate random walk",
        "R": "R, ramp",
    },
}
STATISTICS = {
    "mean": "Mean",
    "std": "Standard deviation",
    "min": "Least",
    "q25": "Quartile 25 %",
    "median": "Median",
    "q75": "Quartile 75 %",
    "max": "Greatest",
    "peak_to_peak": "Peak to peak",
    "std_10s": "Std of 10 s means",
    "std_100s": "Std of 100 s means",
}


def coefficient_table(device, sensor):
    """Return a sensor's noise coefficients, a row a coefficient and unit, a column an axis."""
    axes = device.noise.get("axes", {})
    rows = []
    for key, words in WORDS[sensor].items():
        for unit in NOISE_UNITS[sensor][key]:
            found = (axes.get(c, {}).get(key) for c in SENSORS[sensor])
            rows.append((words, unit.unit, *(coefficient_text(c, unit.factor) for c in found)))
    rows += _processes(axes, sensor)
    return Table(
        f"{sensor.capitalize()}: noise coefficients, value ± 1 σ",
        ("Coefficient", "Unit", *XYZ),
        tuple(rows),
        "“<”: the record does not show this term; with 95 % confidence it is below this number. "
        "B is the flat part of the Allan curve divided by 0.664, not the scatter of means, "
        "which is below.",
    )


def _processes(axes, sensor):
    """Return rows for the Gauss–Markov processes and sinusoids that were found."""
    si = UNITS[sensor]
    layout = {
        "gauss_markov": (
            ("q", "Gauss–Markov drive q", f"{si}/√s"),
            ("tc", "Gauss–Markov time T", "s"),
        ),
        "sinusoid": (
            ("amplitude", "Sinusoid amplitude", si),
            ("frequency", "Sinusoid frequency", "Hz"),
        ),
    }
    rows = []
    for kind, parts in layout.items():
        found = [axes.get(c, {}).get(kind) or [] for c in SENSORS[sensor]]
        for index in range(max(map(len, found), default=0)):
            for key, words, unit in parts:
                cells = (coefficient_text(f[index][key]) if index < len(f) else "" for f in found)
                rows.append((words, unit, *(cell or NO_NUMBER for cell in cells)))
    return rows


def statistics_tables(device):
    """Return the summary statistics of every record at rest, a table a session and sensor."""
    tables = []
    for session, axes in (device.noise.get("statistics") or {}).items():
        for sensor, channels in SENSORS.items():
            rows = []
            for axis, channel in zip(XYZ, channels, strict=True):
                figures = axes.get(channel, {})
                rows.append((axis, *(number(figures.get(key), 5) for key in STATISTICS)))
            tables.append(
                Table(
                    f"{sensor.capitalize()}, session {session}: summary statistics, "
                    f"{UNITS[sensor]}, of the log in SI units before calibration",
                    ("Axis", *(f"{words}, {UNITS[sensor]}" for words in STATISTICS.values())),
                    tuple(rows),
                    "Std of 10 s means is what many comparisons call bias stability; it is not "
                    "the Allan bias instability B and is usually larger.",
                )
            )
    return tables
