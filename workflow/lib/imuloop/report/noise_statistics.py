"""Summary statistics of records at rest, and the four figures that are called bias stability."""

from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.report.noise_units import quantities
from imuloop.report.numbers import NO_NUMBER, coefficient_text, missing, number, plural
from imuloop.report.results import SENSORS, UNITS, XYZ
from imuloop.report.table import Table
from imuloop.report.verdict import block_of

STATISTICS = {
    "mean": "Mean",
    "std": "Standard deviation",
    "min": "Least",
    "q25": "Quartile 25 %",
    "median": "Median",
    "q75": "Quartile 75 %",
    "max": "Greatest",
    "peak_to_peak": "Peak to peak",
    "std_10s": "Bias stability 2: std of 10 s means",
    "std_100s": "Bias stability 2: std of 100 s means",
}
MEANS = {"std_10s": "10 s", "std_100s": "100 s"}


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
                    f"{sensor.capitalize()}, {_record(device, session)}: summary statistics, "
                    f"{UNITS[sensor]}, of the log in SI units before calibration",
                    ("Axis", *(f"{words}, {UNITS[sensor]}" for words in STATISTICS.values())),
                    tuple(rows),
                    "Scatter of means is what many comparisons call bias stability, number 2 of "
                    "the four above; it is not the Allan bias instability B and is usually larger.",
                )
            )
    return tables


def _record(device, name):
    """Return of which record of a session the figures are."""
    kinds = {s.name: s.kind for s in device.sessions}
    return f"{'' if kinds.get(name) == 'static' else 'longest rest of '}session {name}"


def stability_table(device, sensor):
    """Return the four figures that are called bias stability, each with its definition."""
    level = quantities(sensor)["B"]
    units = (level.si, *level.sheet)
    channels = SENSORS[sensor]
    axes = device.noise.get("axes") or {}
    found = [(axes.get(c) or {}).get("B") for c in channels]
    rows = [
        _row("1. Allan", "flat part of the Allan curve / 0.664 (B)", units, found, coefficient_text)
    ]
    for session, figures in (device.noise.get("statistics") or {}).items():
        of = _record(device, session)
        for key, length in MEANS.items():
            values = [(figures.get(c) or {}).get(key) for c in channels]
            definition = f"standard deviation (1 σ) of consecutive {length} means, {of}"
            rows.append(_row(f"2. Means of {length}", definition, units, values, _scaled))
    repeated = device.noise.get("repeatability") or {}
    runs = [repeated.get(c) or {} for c in channels]
    count = max((r.get("sessions") or 0 for r in runs), default=0)
    added = block_of(device.diagnosis, sensor).get("effects") or []
    cycled = [] if count else [s for e in added if e["name"] == TurnOnBias.name for s in _cycled(e)]
    rows.append(
        _row(
            "3. Run to run",
            f"standard deviation (1 σ) of the means of {plural(count, 'session')}"
            if count
            else "standard deviation (1 σ) of the bias over the runs of the poses (turn_on_bias)"
            if cycled
            else "standard deviation (1 σ) of session means: needs two static sessions or more"
            + (", in the same attitude within 1°" if sensor == "accelerometer" else ""),
            units,
            cycled or [r.get("std") for r in runs],
            _scaled,
        )
    )
    rows.append(
        _row(
            "4. Over temperature",
            "range (peak to peak) of the mean over the rated temperatures: not measured here",
            units,
            [None] * 3,
            _scaled,
        )
    )
    return Table(
        f"{sensor.capitalize()}: four figures that are called bias stability, never to be compared "
        "with each other",
        ("Name", "Definition", "Unit", *XYZ),
        tuple(rows),
        _finding(device, sensor, found),
    )


def _cycled(effect):
    """Return the run-to-run standard deviation of each axis, SI."""
    std, _ = TurnOnBias(**effect["constants"]).run_to_run(effect["parameters"])
    return std.tolist()


def _row(name, definition, units, values, text):
    """Return a row with a line a unit; without any value one unit will do."""
    known = [v for v in values if v is not None]
    units = units if known else units[:1]
    cells = ("\n".join(text(v, u.factor) for u in units) for v in values)
    return (name, definition, "\n".join(u.unit for u in units), *cells)


def _scaled(value, factor):
    return NO_NUMBER if missing(value) else number(value * factor)


def _finding(device, sensor, found):
    """Return how much larger the scatter of 10 s means is than B."""
    ratios = []
    for session, axes in (device.noise.get("statistics") or {}).items():
        for axis, channel, level in zip(XYZ, SENSORS[sensor], found, strict=True):
            scatter, value = (axes.get(channel) or {}).get("std_10s"), (level or {}).get("value")
            if not missing(scatter) and not missing(value) and value > 0:
                ratios.append((scatter / value, f"{session}, {axis}"))
    note = "A data sheet seldom says which of the four it gives; ask before comparing."
    if not ratios:
        return note
    ratio, where = max(ratios)
    return f"Here the 10 s means scatter up to {number(ratio, 2)} times B ({where}). {note}"
