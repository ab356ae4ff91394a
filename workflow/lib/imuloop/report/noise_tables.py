"""Noise coefficients: in three systems of units, beside the curve fit, with and without a cut."""

from math import log, sqrt

from imuloop.report.noise_units import COEFFICIENTS, quantities
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
from imuloop.report.results import SENSORS, XYZ
from imuloop.report.table import Table

NOTE = (
    "“<”: the record does not show this term; with 95 % confidence it is below this number, and "
    "the remark says how long a record would show it nine times in ten, were it that large. B is "
    "the flat part of the Allan curve divided by 0.664, not the scatter of means, which is below."
)
SAMPLE_NOTE = (
    "SI: what Kalibr, OpenVINS and ORB-SLAM3 call noise density (N) and random walk (K). Per "
    "sample: what a filter needs that runs at the logged {rate} Hz. N·√rate is the standard "
    "deviation of a sample only if the sensor passes the whole band up to {half} Hz; quantisation "
    "adds √2·Q·rate; K/√rate is the step of the walk from sample to sample; R/rate the change; "
    "B has no rate and stays. None of these is a density of a data sheet."
)
# flicker, walk and ramp rise to the left in the spectrum: a weak one may stand in for another
SLOW = "BKR"
# process of several parameters in noise.json: its kind and the names of its parameters
PROCESSES = {"gauss_markov": ("q", "tc"), "sinusoid": ("amplitude", "frequency")}


def coefficient_table(device, sensor):
    """Return a sensor's noise coefficients, a group a coefficient, a row an axis."""
    rate, fits = device.noise.get("rate_hz"), device.noise.get("curve_fit") or {}
    known = quantities(sensor, rate)
    rows, heads = [], []
    for key, found in _groups(device, sensor):
        quantity = known[key]
        heads.append(len(rows))
        # a plain fit has the five coefficients only
        fitted = (quantity.sheet[0].unit if key in COEFFICIENTS else "",) if fits else ()
        rows.append((quantity.words, *_units(quantity), *fitted, ""))
        for axis, channel, coefficient, remark in found:
            fit = (fits.get(channel) or {}).get(key)
            fitted = (_fit_text(fit, quantity.sheet[0].factor),) if fits else ()
            label = f"{quantity.words.partition(',')[0]}, {axis}"
            rows.append((label, *_cells(quantity, coefficient), *fitted, remark))
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
        tuple(rows),
        _check(device, sensor, fits) if fits else "",
        heads=tuple(heads),
    )


def coefficient_note(device):
    """Return what to know of the tables of coefficients."""
    rate = device.noise.get("rate_hz")
    if not rate:
        return NOTE
    return f"{NOTE} {SAMPLE_NOTE.format(rate=f'{rate:.4g}', half=f'{rate / 2:.4g}')}"


def _groups(device, sensor):
    """Return key and rows (axis, channel, coefficient, remark) of each group of the table."""
    axes = device.noise.get("axes") or {}
    channels = [(a, c, axes.get(c) or {}) for a, c in zip(XYZ, SENSORS[sensor], strict=True)]
    groups = [
        (key, [(a, c, content.get(key), _remark(key, content)) for a, c, content in channels])
        for key in COEFFICIENTS
    ]
    for kind, keys in PROCESSES.items():
        found = [(a, c, p) for a, c, content in channels for p in content.get(kind) or []]
        groups += [
            (
                key,
                [
                    (a, c, p[key], _told(sensor, kind, p) if key == keys[0] else "")
                    for a, c, p in found
                ],
            )
            for key in keys
            if found
        ]
    return groups


def _remark(key, content):
    """Return in words how long a record would show a term, or what could be there in its place."""
    known = content.get(key) or {}
    if known.get("identifiable"):
        others = " or ".join(k for k in SLOW if k != key) if key in SLOW else "another term"
        doubt = f"may be {others} instead: the record cannot tell which"
        return doubt if (known.get("ci95") or (None,))[0] == 0 else ""
    # an older file does not tell the time at all
    if not known.get("upper95") or "needed_s" not in known:
        return ""
    if missing(known["needed_s"]):
        return "no record of up to a year would show it"
    return f"needs a record of about {duration(known['needed_s'], 2)}"


def _told(sensor, kind, process):
    """Return where a line comes from, or how large a Gauss-Markov process is."""
    if kind == "sinusoid":
        return process.get("origin") or ""
    q, tc = process["q"].get("value"), process["tc"].get("value")
    if missing(q) or missing(tc):
        return ""
    unit = quantities(sensor)["amplitude"].sheet[0]
    level = with_unit(number(q * sqrt(tc / 2) * unit.factor), unit.unit)
    told = (f"σ of the process, q·√(T/2): {level}", _remark("q", process))
    return "; ".join(filter(None, told))


def _units(quantity):
    """Return the units of the columns that `_cells` fills."""
    return (
        quantity.si.unit,
        "\n".join(u.unit for u in quantity.sheet),
        quantity.sample.unit if quantity.sample else "",
        quantity.sheet[0].unit,
    )


def _cells(quantity, coefficient):
    """Return a coefficient in SI, data-sheet units and per sample, and its interval."""
    sample = quantity.sample
    return (
        coefficient_text(coefficient, quantity.si.factor),
        "\n".join(coefficient_text(coefficient, u.factor) for u in quantity.sheet),
        coefficient_text(coefficient, sample.factor) if sample else NO_NUMBER,
        interval_text((coefficient or {}).get("ci95"), quantity.sheet[0].factor),
    )


def _fit_text(value, factor):
    """Return a coefficient of the plain fit, which gives zero for a term that it leaves out."""
    if missing(value):
        return NO_NUMBER
    return number(value * factor) if value else "not in the fit"


def _check(device, sensor, fits):
    """Return which estimate to use, and where the plain fit leaves the interval of the other."""
    outside = []
    for key in COEFFICIENTS:
        for axis, channel in zip(XYZ, SENSORS[sensor], strict=True):
            coefficient = device.noise["axes"][channel].get(key) or {}
            value = (fits.get(channel) or {}).get(key)
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
    if not uncut.get("axes"):
        return None
    rows, changes, hidden = [], [], []
    known = quantities(sensor)
    for key in COEFFICIENTS:
        unit = known[key].sheet[0]
        for axis, channel in zip(XYZ, SENSORS[sensor], strict=True):
            left, cut = (
                (axes.get(channel) or {}).get(key) or {}
                for axes in (uncut["axes"], device.noise["axes"])
            )
            if missing(left.get("value")) and missing(cut.get("value")):
                continue
            cells = [coefficient_text(c, unit.factor) for c in (left, cut)]
            ratio, told = _change(left, cut)
            rows.append((f"{key}, {axis}", unit.unit, *cells, told))
            if ratio:
                words = f"{key} of {axis} would be read as {cells[0]} {unit.unit}, not {cells[1]}"
                changes.append((abs(log(ratio)), f"{words} ({told})"))
            elif missing(left.get("value")):
                hidden.append(f"{key} of {axis}")
    if not rows:
        return None
    size, most = max(changes, default=(0.0, ""))
    if size < log(1.25):
        most = "they would change no coefficient that is seen by more than a quarter"
    lost = f", and would hide {joined(hidden)}" if hidden else ""
    seconds = with_unit(number(uncut.get("seconds")), "s")
    return Table(
        f"{sensor.capitalize()}: coefficients with the disturbed stretches left in, and with them "
        "cut, value ± 1 σ",
        ("Coefficient, axis", "Unit", "With the disturbance", "Cut (used)", "Changed by"),
        tuple(rows),
        f"{seconds} of disturbed record were cut; what was cut keeps its place in time. Left in, "
        f"{most}{lost}. “<”: not seen, below this number with 95 % confidence.",
    )


def _change(left, cut):
    """Return the ratio that a disturbance makes, None where it is not known, and its words."""
    value = left.get("value")
    if missing(value):
        return None, "hidden by it"
    bound = missing(cut.get("value"))
    without = cut.get("upper95") if bound else cut["value"]
    # below the limit nothing tells the two apart
    if missing(without) or without <= 0 or value <= 0 or (bound and value <= without):
        return None, NO_NUMBER
    ratio = value / without
    return ratio, f"{'> ' * bound}{number(ratio, 2)} ×"
