"""Noise coefficients in three systems of units, with and without a cut, and statistics."""

from math import log, sqrt

from imuloop.core.errors import plural
from imuloop.core.noise_model import AxisNoise
from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.report.numbers import (
    NO_NUMBER,
    coefficient_text,
    duration,
    interval_text,
    joined,
    missing,
    number,
    with_unit,
)
from imuloop.report.results import SENSORS, UNITS, XYZ, axes_of, of_axes
from imuloop.report.tables.table import Table
from imuloop.report.units import COEFFICIENTS, quantities
from imuloop.report.verdict import block_of

NOTE = (
    "“<”: the record does not show this term; with 95 % confidence it is below this number, and "
    "the remark says how long a record would show it nine times in ten, were it that large. B is "
    "the flat part of the Allan curve divided by 0.664, not the scatter of means, which is below."
)
SAMPLE_NOTE = (
    " SI: what Kalibr, OpenVINS and ORB-SLAM3 call noise density (N) and random walk (K). Per "
    "sample: what a filter needs that runs at the logged {:.4g} Hz. N·√rate is the standard "
    "deviation of a sample only if the sensor passes the whole band up to {:.4g} Hz; quantisation "
    "adds √2·Q·rate; K/√rate is the step of the walk from sample to sample; R/rate the change; "
    "B has no rate and stays. None of these is a density of a data sheet."
)
# flicker, walk and ramp rise to the left in the spectrum: a weak one may stand in for another
SLOW = "BKR"
PROCESSES = ("gauss_markov", "sinusoid")
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


def coefficient_table(device, sensor):
    """Return a sensor's noise coefficients, a group per coefficient, a row per axis."""
    rate, fits = device.noise["rates_hz"].get(sensor), device.noise["curve_fit"]
    fitted, known = dict(of_axes(fits, sensor)), quantities(sensor, rate)
    rows, heads = [], []
    for key, found in _groups(of_axes(device.axes, sensor), sensor):
        quantity = known[key]
        usual = quantity.sheet[0]
        systems = [[quantity.si], quantity.sheet, [quantity.sample] if rate else []]
        units = ["\n".join(u.unit for u in system) for system in systems]
        # a plain fit has the five coefficients only
        check = [usual.unit if key in COEFFICIENTS else ""] if fits else []
        heads.append(len(rows))
        rows.append((quantity.words, *units, usual.unit, *check, ""))
        for axis, coefficient, remark in found:
            texts = (
                "\n".join(coefficient_text(coefficient, u.factor) for u in system) or NO_NUMBER
                for system in systems
            )
            if fits:
                value = fitted[axis].get(key)
                # the fit gives zero for a term that it leaves out
                check = ["not in the fit" if value == 0 else usual.size(value)]
            name, interval = quantity.words.partition(",")[0], coefficient.ci95
            cells = (*texts, interval_text(interval, usual.factor), *check, remark)
            rows.append((f"{name}, {axis}", *cells))
    return Table(
        f"{sensor.capitalize()}: noise coefficients, value ± 1 σ, in three systems of units",
        (
            *("Coefficient, axis", "SI, continuous time", "Data sheet"),
            f"Per sample at {rate:.4g} Hz, discrete" if rate else "Per sample, rate not known",
            "95 % interval",
            *(["Allan-curve fit, a check only"] if fits else []),
            "Remark",
        ),
        rows,
        _check(device, sensor, fitted) if fits else "",
        heads=heads,
    )


def coefficient_note(device):
    """Return what to know of the tables of coefficients."""
    rate = device.noise["rate_hz"]
    return NOTE + (SAMPLE_NOTE.format(rate, rate / 2) if rate else "")


def _groups(axes, sensor):
    """Return key and rows (axis, coefficient, remark) of each group of the table."""
    groups = [
        (key, [(a, c := getattr(noise, key), _remark(key, c)) for a, noise in axes])
        for key in COEFFICIENTS
    ]
    unit = quantities(sensor)["amplitude"].sheet[0]
    humps, lines = ([(a, p) for a, n in axes for p in getattr(n, kind)] for kind in PROCESSES)
    drives = []
    for axis, p in humps:
        level = f"σ of the process, q·√(T/2): {unit.text(p.q.value * sqrt(p.tc.value / 2))}"
        drives.append((axis, p.q, "; ".join(filter(None, (level, _remark("q", p.q))))))
    groups += [("q", drives), ("tc", [(a, p.tc, "") for a, p in humps])]
    groups += [("amplitude", [(a, p.amplitude, p.origin or "") for a, p in lines])]
    groups += [("frequency", [(a, p.frequency, "") for a, p in lines])]
    return [(key, rows) for key, rows in groups if rows]


def _remark(key, known):
    """Return in words how long a record would show a term, or what could be there in its place."""
    if known.value is not None:
        others = " or ".join(k for k in SLOW if k != key) if key in SLOW else "another term"
        doubt = f"may be {others} instead: the record cannot tell which"
        return doubt if known.ci95 and known.ci95[0] == 0 else ""
    if not known.upper95:
        return ""
    if known.needed_s is None:
        return "no record of up to a year would show it"
    return f"needs a record of about {duration(known.needed_s, 2)}"


def _check(device, sensor, fitted):
    """Return which estimate to use, and where the plain fit leaves the interval of the other."""
    outside = []
    for key in COEFFICIENTS:
        for axis, noise in of_axes(device.axes, sensor):
            known = getattr(noise, key)
            low, high = known.ci95 or (0.0, known.upper95)
            if high is not None and not low <= fitted[axis][key] <= high:
                outside.append(f"{key} of {axis}")
    found = (
        f"it leaves their interval or limit at {joined(outside)}"
        if outside
        else "here it keeps within their intervals and limits"
    )
    return (
        "Use the estimates by likelihood, in the columns before it. The plain non-negative fit to "
        f"the points of the Allan curve is less exact and only a check on them: {found}."
    )


def uncut_table(device, sensor):
    """Return a sensor's coefficients with the disturbed stretches and without; None if not cut."""
    uncut = device.noise["uncut"]
    if not uncut:
        return None
    with_it, without = (of_axes(axes, sensor) for axes in (axes_of(uncut["axes"]), device.axes))
    rows, hidden, size = [], [], log(1.25)
    most = "they would change no coefficient that is seen by more than a quarter"
    for key in COEFFICIENTS:
        unit = quantities(sensor)[key].sheet[0]
        for (axis, left), (_, cut) in zip(with_it, without, strict=True):
            left, cut = getattr(left, key), getattr(cut, key)
            if left.value is None and cut.value is None:
                continue
            name, text = f"{key} of {axis}", NO_NUMBER
            cells = [coefficient_text(c, unit.factor) for c in (left, cut)]
            bound = cut.value is None
            if left.value is None:
                text = "hidden by it"
                hidden.append(name)
            # below the limit nothing tells the two apart
            elif cut.size and left.value and (not bound or left.value > cut.size):
                ratio = left.value / cut.size
                text = f"{'> ' * bound}{number(ratio, 2)} ×"
                if abs(log(ratio)) >= size:
                    size, read = abs(log(ratio)), f"{cells[0]} {unit.unit}, not {cells[1]}"
                    most = f"{name} would be read as {read} ({text})"
            rows.append((f"{key}, {axis}", unit.unit, *cells, text))
    if not rows:
        return None
    lost = f", and would hide {joined(hidden)}" if hidden else ""
    return Table(
        f"{sensor.capitalize()}: coefficients with the disturbed stretches left in, and with them "
        "cut, value ± 1 σ",
        ("Coefficient, axis", "Unit", "With the disturbance", "Cut (used)", "Changed by"),
        rows,
        f"{with_unit(number(uncut['seconds']), 's')} of disturbed record were cut; what was "
        f"cut keeps its place in time. Left in, {most}{lost}. “<”: not seen, below this number "
        "with 95 % confidence.",
    )


def noise_change_table(sensor, block):
    """Return the noise coefficients before and after the correction; None where not given."""
    if not block.get("noise"):
        return None
    stages = [
        [AxisNoise.from_dict(change[stage]) for stage in ("before", "after")]
        for _, change in of_axes(block["noise"], sensor)
    ]
    rows = []
    for key in COEFFICIENTS:
        quantity = quantities(sensor)[key]
        unit = quantity.sheet[0]
        cells = (
            " → ".join(coefficient_text(getattr(noise, key), unit.factor) for noise in pair)
            for pair in stages
        )
        rows.append((quantity.words, unit.unit, *cells))
    return Table(
        f"{sensor.capitalize()}, static record: noise coefficients before → after the correction",
        ("Coefficient", "Unit", *XYZ),
        rows,
        "A temperature ramp that is read as bias instability B or as random walk K is the "
        "commonest mistake in noise coefficients: what the effects explain is no noise. "
        "“<”: not seen in the record, below this number with 95 % confidence.",
    )


def statistics_tables(device):
    """Return the summary statistics of every record at rest, a table per session and sensor."""
    return [
        Table(
            f"{sensor.capitalize()}, {device.record(session)}: summary statistics, "
            f"{UNITS[sensor]}, of the log in SI units before calibration",
            ("Axis", *(f"{words}, {UNITS[sensor]}" for words in STATISTICS.values())),
            [
                (axis, *(number(figures[key], 5) for key in STATISTICS))
                for axis, figures in of_axes(axes, sensor)
            ],
            "Scatter of means is what many comparisons call bias stability, number 2 of "
            "the four above; it is not the Allan bias instability B and is usually larger.",
        )
        for session, axes in device.noise["statistics"].items()
        for sensor in SENSORS
    ]


def stability_table(device, sensor):
    """Return the four figures that are called bias stability, each with its definition."""
    level = quantities(sensor)["B"]
    units = (level.si, *level.sheet)
    flat = [noise.B for _, noise in of_axes(device.axes, sensor)]
    rows, ratios = [], []

    def row(name, definition, values=(None,) * 3):
        # without any value one unit will do
        shown = units if any(v is not None for v in values) else units[:1]
        cells = ("\n".join(u.size(v) for u in shown) for v in values)
        rows.append((name, definition, "\n".join(u.unit for u in shown), *cells))

    cells = ("\n".join(coefficient_text(b, u.factor) for u in units) for b in flat)
    names = "\n".join(u.unit for u in units)
    rows.append(("1. Allan", "flat part of the Allan curve / 0.664 (B)", names, *cells))
    for session, figures in device.noise["statistics"].items():
        axes = of_axes(figures, sensor)
        for key, length in MEANS.items():
            definition = f"standard deviation (1 σ) of consecutive {length} means"
            values = [each[key] for _, each in axes]
            row(f"2. Means of {length}", f"{definition}, {device.record(session)}", values)
        ratios += [
            (each["std_10s"] / b.value, f"{session}, {axis}")
            for (axis, each), b in zip(axes, flat, strict=True)
            if b.value and not missing(each["std_10s"])
        ]
    runs = [each or {} for _, each in of_axes(device.noise["repeatability"] or {}, sensor)]
    count = max(r.get("sessions", 0) for r in runs)
    scatter = [r.get("std") for r in runs]
    definition = f"standard deviation (1 σ) of the means of {plural(count, 'session')}"
    if not count:
        definition = "standard deviation (1 σ) of session means: needs two static sessions or more"
        definition += ", in the same attitude within 1°" * (sensor == "accelerometer")
        for effect in block_of(device.diagnosis, sensor)["effects"]:
            if effect["name"] == TurnOnBias.name:
                of_poses = "of the bias over the runs of the poses (turn_on_bias)"
                definition = f"standard deviation (1 σ) {of_poses}"
                std, _ = TurnOnBias(**effect["constants"]).run_to_run(effect["parameters"])
                scatter = std.tolist()
    row("3. Run to run", definition, scatter)
    over = "range (peak to peak) of the mean over the rated temperatures: not measured here"
    row("4. Over temperature", over)
    note = "A data sheet seldom says which of the four it gives; ask before comparing."
    if ratios:
        ratio, where = max(ratios)
        note = f"Here the 10 s means scatter up to {number(ratio, 2)} times B ({where}). {note}"
    return Table(
        f"{sensor.capitalize()}: four figures that are called bias stability, never to be compared "
        "with each other",
        ("Name", "Definition", "Unit", *XYZ),
        rows,
        note,
    )
