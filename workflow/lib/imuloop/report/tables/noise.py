"""Noise coefficients in three systems of units, with and without a cut, and statistics."""

from math import log, sqrt

from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.report.noise_units import COEFFICIENTS, quantities
from imuloop.report.numbers import (
    NO_NUMBER,
    coefficient_text,
    duration,
    interval_text,
    joined,
    missing,
    number,
    plural,
    with_unit,
)
from imuloop.report.results import SENSORS, UNITS, XYZ
from imuloop.report.tables.table import Table
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
# process of several parameters in noise.json: its kind and the names of its parameters
PROCESSES = {"gauss_markov": ("q", "tc"), "sinusoid": ("amplitude", "frequency")}
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


def _of_axes(axes, sensor):
    """Return axis and content of each channel of a sensor."""
    return [(a, axes.get(c) or {}) for a, c in zip(XYZ, SENSORS[sensor], strict=True)]


def coefficient_table(device, sensor):
    """Return a sensor's noise coefficients, a group per coefficient, a row per axis."""
    rate, fits = device.noise.get("rate_hz"), device.noise.get("curve_fit") or {}
    fitted = dict(_of_axes(fits, sensor))
    known = quantities(sensor, rate)
    rows, heads = [], []
    for key, found in _groups(_of_axes(device.axes, sensor), sensor):
        quantity, (usual, *_) = known[key], known[key].sheet
        heads.append(len(rows))
        sample = quantity.sample.unit if quantity.sample else ""
        sheet = "\n".join(u.unit for u in quantity.sheet)
        # a plain fit has the five coefficients only
        check = (usual.unit if key in COEFFICIENTS else "",) if fits else ()
        rows.append((quantity.words, quantity.si.unit, sheet, sample, usual.unit, *check, ""))
        for axis, coefficient, remark in found:
            value = fitted[axis].get(key)
            # the fit gives zero for a term that it leaves out
            text = "not in the fit" if value == 0 else number(value and value * usual.factor)
            rows.append(
                (
                    f"{quantity.words.partition(',')[0]}, {axis}",
                    coefficient_text(coefficient, quantity.si.factor),
                    "\n".join(coefficient_text(coefficient, u.factor) for u in quantity.sheet),
                    coefficient_text(coefficient, quantity.sample.factor)
                    if quantity.sample
                    else NO_NUMBER,
                    interval_text((coefficient or {}).get("ci95"), usual.factor),
                    *((text,) if fits else ()),
                    remark,
                )
            )
    return Table(
        f"{sensor.capitalize()}: noise coefficients, value ± 1 σ, in three systems of units",
        (
            "Coefficient, axis",
            "SI, continuous time",
            "Data sheet",
            f"Per sample at {rate:.4g} Hz, discrete" if rate else "Per sample, rate not known",
            "95 % interval",
            *(("Allan-curve fit, a check only",) if fits else ()),
            "Remark",
        ),
        rows,
        _check(device, sensor, fitted) if fits else "",
        heads=heads,
    )


def coefficient_note(device):
    """Return what to know of the tables of coefficients."""
    rate = device.noise.get("rate_hz")
    return NOTE + (SAMPLE_NOTE.format(rate, rate / 2) if rate else "")


def _groups(contents, sensor):
    """Return key and rows (axis, coefficient, remark) of each group of the table."""
    groups = [
        (key, [(a, content.get(key), _remark(key, content)) for a, content in contents])
        for key in COEFFICIENTS
    ]
    for kind, keys in PROCESSES.items():
        found = [(a, p) for a, content in contents for p in content.get(kind) or []]
        for key in keys if found else ():
            first = key == keys[0]
            rows = [
                (a, p[key], _process_remark(sensor, kind, p) if first else "") for a, p in found
            ]
            groups.append((key, rows))
    return groups


def _remark(key, content):
    """Return in words how long a record would show a term, or what could be there in its place."""
    known = content.get(key) or {}
    if known.get("identifiable"):
        others = " or ".join(k for k in SLOW if k != key) if key in SLOW else "another term"
        doubt = f"may be {others} instead: the record cannot tell which"
        return doubt if (known.get("ci95") or (None,))[0] == 0 else ""
    if not known.get("upper95") or "needed_s" not in known:
        return ""
    if missing(known["needed_s"]):
        return "no record of up to a year would show it"
    return f"needs a record of about {duration(known['needed_s'], 2)}"


def _process_remark(sensor, kind, process):
    """Return where a line comes from, or how large a Gauss-Markov process is."""
    if kind == "sinusoid":
        return process.get("origin") or ""
    q, tc = process["q"].get("value"), process["tc"].get("value")
    if missing(q) or missing(tc):
        return ""
    unit = quantities(sensor)["amplitude"].sheet[0]
    level = with_unit(number(q * sqrt(tc / 2) * unit.factor), unit.unit)
    return "; ".join(filter(None, (f"σ of the process, q·√(T/2): {level}", _remark("q", process))))


def _check(device, sensor, fitted):
    """Return which estimate to use, and where the plain fit leaves the interval of the other."""
    outside = []
    for key in COEFFICIENTS:
        for axis, content in _of_axes(device.axes, sensor):
            coefficient, value = content.get(key) or {}, fitted[axis].get(key)
            low, high = coefficient.get("ci95") or (0.0, coefficient.get("upper95"))
            if not any(missing(v) for v in (value, low, high)) and not low <= value <= high:
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
    uncut = device.noise.get("uncut") or {}
    with_it, without = (_of_axes(axes or {}, sensor) for axes in (uncut.get("axes"), device.axes))
    rows, changes, hidden = [], [], []
    for key, quantity in quantities(sensor).items():
        unit = quantity.sheet[0]
        for (axis, left), (_, cut) in zip(with_it, without, strict=True):
            # processes of several parameters are no coefficients
            left, cut = (each.get(key) or {} if key in COEFFICIENTS else {} for each in (left, cut))
            if missing(left.get("value")) and missing(cut.get("value")):
                continue
            cells = [coefficient_text(c, unit.factor) for c in (left, cut)]
            ratio, text = _change(left, cut)
            rows.append((f"{key}, {axis}", unit.unit, *cells, text))
            if ratio:
                words = f"{key} of {axis} would be read as {cells[0]} {unit.unit}, not {cells[1]}"
                changes.append((abs(log(ratio)), f"{words} ({text})"))
            elif missing(left.get("value")):
                hidden.append(f"{key} of {axis}")
    if not uncut.get("axes") or not rows:
        return None
    size, most = max(changes, default=(0.0, ""))
    if size < log(1.25):
        most = "they would change no coefficient that is seen by more than a quarter"
    lost = f", and would hide {joined(hidden)}" if hidden else ""
    return Table(
        f"{sensor.capitalize()}: coefficients with the disturbed stretches left in, and with them "
        "cut, value ± 1 σ",
        ("Coefficient, axis", "Unit", "With the disturbance", "Cut (used)", "Changed by"),
        rows,
        f"{with_unit(number(uncut.get('seconds')), 's')} of disturbed record were cut; what was "
        f"cut keeps its place in time. Left in, {most}{lost}. “<”: not seen, below this number "
        "with 95 % confidence.",
    )


def _change(left, cut):
    """Return the ratio that a disturbance makes, None where it is not known, and its words."""
    value, bound = left.get("value"), missing(cut.get("value"))
    if missing(value):
        return None, "hidden by it"
    without = cut.get("upper95") if bound else cut["value"]
    # below the limit nothing tells the two apart
    if missing(without) or without <= 0 or value <= 0 or (bound and value <= without):
        return None, NO_NUMBER
    return value / without, f"{'> ' * bound}{number(value / without, 2)} ×"


def noise_change_table(sensor, block):
    """Return the noise coefficients before and after the correction; None where not given."""
    axes = [content for _, content in _of_axes(block.get("noise") or {}, sensor)]
    if not any(axes):
        return None
    rows = []
    for quantity, key in ((quantities(sensor)[key], key) for key in COEFFICIENTS):
        unit = quantity.sheet[0]
        stages = ([(a.get(stage) or {}).get(key) for stage in ("before", "after")] for a in axes)
        cells = (" → ".join(coefficient_text(c, unit.factor) for c in pair) for pair in stages)
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
            f"{sensor.capitalize()}, {_record(device, session)}: summary statistics, "
            f"{UNITS[sensor]}, of the log in SI units before calibration",
            ("Axis", *(f"{words}, {UNITS[sensor]}" for words in STATISTICS.values())),
            [
                (axis, *(number(figures.get(key), 5) for key in STATISTICS))
                for axis, figures in _of_axes(axes, sensor)
            ],
            "Scatter of means is what many comparisons call bias stability, number 2 of "
            "the four above; it is not the Allan bias instability B and is usually larger.",
        )
        for session, axes in (device.noise.get("statistics") or {}).items()
        for sensor in SENSORS
    ]


def _record(device, name):
    """Return of which record of a session the figures are."""
    kinds = {s.name: s.kind for s in device.sessions}
    return f"{'' if kinds.get(name) == 'static' else 'longest rest of '}session {name}"


def stability_table(device, sensor):
    """Return the four figures that are called bias stability, each with its definition."""
    level = quantities(sensor)["B"]
    found = [content.get("B") for _, content in _of_axes(device.axes, sensor)]

    def row(name, definition, values, text=lambda v, f: number(v and v * f)):
        # without any value one unit will do
        known = any(v is not None for v in values)
        units = (level.si, *level.sheet) if known else (level.si,)
        cells = ("\n".join(text(v, u.factor) for u in units) for v in values)
        return (name, definition, "\n".join(u.unit for u in units), *cells)

    rows = [row("1. Allan", "flat part of the Allan curve / 0.664 (B)", found, coefficient_text)]
    ratios = []
    for session, figures in (device.noise.get("statistics") or {}).items():
        axes = _of_axes(figures, sensor)
        for key, length in MEANS.items():
            definition = f"standard deviation (1 σ) of consecutive {length} means"
            values = [each.get(key) for _, each in axes]
            rows.append(
                row(f"2. Means of {length}", f"{definition}, {_record(device, session)}", values)
            )
        ratios += [
            (each["std_10s"] / b["value"], f"{session}, {axis}")
            for (axis, each), b in zip(axes, found, strict=True)
            if b and (b.get("value") or 0) > 0 and not missing(each.get("std_10s"))
        ]
    runs = [content for _, content in _of_axes(device.noise.get("repeatability") or {}, sensor)]
    count = max((r.get("sessions") or 0 for r in runs), default=0)
    scatter = [r.get("std") for r in runs]
    definition = f"standard deviation (1 σ) of the means of {plural(count, 'session')}"
    if not count:
        definition = "standard deviation (1 σ) of session means: needs two static sessions or more"
        definition += ", in the same attitude within 1°" * (sensor == "accelerometer")
        for effect in block_of(device.diagnosis, sensor).get("effects") or []:
            if effect["name"] == TurnOnBias.name:
                of_poses = "of the bias over the runs of the poses (turn_on_bias)"
                definition = f"standard deviation (1 σ) {of_poses}"
                std, _ = TurnOnBias(**effect["constants"]).run_to_run(effect["parameters"])
                scatter = std.tolist()
    rows.append(row("3. Run to run", definition, scatter))
    over = "range (peak to peak) of the mean over the rated temperatures: not measured here"
    rows.append(row("4. Over temperature", over, [None] * 3))
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
