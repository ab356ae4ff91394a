"""The tables of a device's part of the report."""

import re
from dataclasses import dataclass

import numpy as np

from imuloop.core.errors import joined, plural
from imuloop.core.noise_model import AxisNoise
from imuloop.core.samples import SENSORS
from imuloop.core.units import HOUR
from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.model.effect import Effect
from imuloop.report.findings import blocks, record_title, residual_text
from imuloop.report.long_table import (
    PARAMETERS,
    calibration_values,
    noise_values,
    prior_values,
    select,
)
from imuloop.report.numbers import (
    NO_NUMBER,
    coefficient_text,
    duration,
    interval_text,
    missing,
    number,
    percent,
    probability,
    text_of,
    typeset,
    with_sigma,
    with_unit,
)
from imuloop.report.page import RECORDS, RESIDUALS, WORDS, effect_words
from imuloop.report.results import UNITS, XYZ, of_axes
from imuloop.report.units import COEFFICIENTS, QUANTITIES, data_sheet, spans

NOT_ESTIMATED = "not estimated"
# the name of an effect's parameter whose last letter or digit is an axis: G01, c2x, rxy
OF_AXIS, OF_AXES = re.compile(r"(\w+)([xyz0-2])"), re.compile(r"[A-Z][0-2][0-2]")
# s, the length of the means whose difference over an hour is the change of a bias
OVER = 60.0
# status of a candidate effect, best first
UNTRIED = ("not_observable", "not_available")
STATUS = ("added", "confounded", "rejected", *UNTRIED)
# a figure of quality.json that has one of these texts in each session gets no row
NOTHING = {NO_NUMBER, "none", "0", "1", "not logged", "not known, no full_scale"}


class Sized(str):
    """Text of a cell with the number that its column is sorted by, or None.

    A cell of a matrix has the `share` of the largest cell, −1 to 1, which is its colour.
    """

    def __new__(cls, text, value, share=None):
        """Return the text with its value and share."""
        cell = super().__new__(cls, text)
        cell.value = None if missing(value) else f"{value:.6g}"
        cell.share = share
        return cell


@dataclass(frozen=True)
class Table:
    """A table of the report; the first cell of each row names the row.

    Headers give the units, or the caption does if all cells share one; the note explains the
    numbers. In a `dense` table the text of cells may break into lines. A reader sorts the rows of a
    `sortable` table by the values of `Sized` cells, or by their text.
    """

    caption: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]
    note: str = ""
    dense: bool = False
    sortable: bool = False


def parameter_table(device, sensor):
    """Return a sensor's table of bias and scale factor, a column per method; None if none was."""
    # a method that estimated nothing has no column; the page says why above the table
    methods = {m: s for m, c in device.calibrations.items() if (s := getattr(c, sensor)).names}
    if not methods:
        return None
    final = methods.get("final")
    for method in [m for m, s in methods.items() if m != "final" and final and _equal(s, final)]:
        del methods[method]
    values = select(calibration_values(device.calibrations), sensor=sensor)
    values = {(v.stage, v.quantity, v.axis): v for v in values}
    tolerances = {(v.quantity, v.axis): v for v in prior_values(device, sensor)}
    rows = [("Reduced χ²", "1", *(number(s.reduced_chi2) for s in methods.values()), NO_NUMBER)]
    for name, (quantity, axis) in PARAMETERS.items():
        display, cells = QUANTITIES[sensor][quantity], []
        for method, content in methods.items():
            if value := values.get((method, quantity, axis)):
                mark = f", {content.prior['source']}" if name in content.unimproved else ""
                cells.append(Sized(value.text(display) + mark, value.value))
            else:
                cells.append(NOT_ESTIMATED)
        if quantity != "misalignment" and {*cells} != {NOT_ESTIMATED}:
            prior = tolerances.get((quantity, axis))
            cells.append(f"±\u202f{display.size(prior.value, 2)}" if prior else NO_NUMBER)
            rows.append((f"{WORDS['compared'][quantity]} {axis}", display.unit, *cells))
    return Table(
        f"{sensor.capitalize()}: parameters, value ± 1 σ",
        ("Parameter", "Unit", *(WORDS["stages"][m] for m in methods), "Before"),
        rows,
        f"A bias is the mean level over the rests of this record{_after_an_hour(device, sensor)}. "
        "Column “Before”: the tolerance (1 σ) before any measurement, from the data sheet or, "
        "without one, of typical MEMS. A value marked “data sheet” was hardly improved by these "
        "data. "
        "Reduced χ² near 1: the fit is as good as the noise allows.",
        sortable=True,
    )


def misalignment_table(device, sensor):
    """Return the misalignment of the final calibration as a matrix; None if it has none."""
    values = select(calibration_values(device.calibrations), stage="final", sensor=sensor)
    values = select(values, quantity="misalignment")
    rows = {axis: dict.fromkeys(XYZ, NO_NUMBER) for axis in XYZ}
    display, largest = (
        QUANTITIES[sensor]["misalignment"],
        max((abs(v.value) for v in values), default=0),
    )
    for v in values:
        rows[v.axis[0]][v.axis[1]] = shade(v.value, v.std, largest, display)
    note = "How much of a column's axis appears on a row's. Values above 2 σ are coloured by sign."
    title = f"{sensor.capitalize()}: misalignment ± 1 σ"
    rows = [(f"on {axis}", *cells.values(), display.unit) for axis, cells in rows.items()]
    return Table(title, ("Axis", *XYZ, "Unit"), rows, note) if values else None


def shade(value, sigma, largest, display):
    """Return the cell of an element of a matrix, coloured if the element exceeds 2 σ.

    `value`, its standard error `sigma` and `largest`, the largest magnitude in the matrix, are in
    SI; `display` is the Display of the cell.
    """
    share = value / largest if abs(value) > 2 * (sigma or 0.0) else 0.0
    return Sized(with_sigma(value, sigma, display.factor), value, share)


def _equal(one, other):
    """Return whether two calibrations have the same parameters, so that one column shows both."""
    pairs = ((one.T, other.T), (one.K, other.K), (one.b, other.b))
    return one.method == other.method and all(np.array_equal(a, b) for a, b in pairs)


def wander(noise, interval, length):
    """Return the standard deviation of the change of the bias between two times, SI.

    The bias at a time is a mean of the output over `length` s from that time on; `interval`, s, is
    the time between the two. `noise` is an AxisNoise, of which only flicker, random walk and
    Gauss-Markov processes count.
    """
    slow = AxisNoise(B=noise.B, K=noise.K, gauss_markov=noise.gauss_markov)
    covariance = slow.mean_covariance(np.add.outer([0.0, interval], [0.0, length]))
    return float(np.sqrt(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1]))


def _after_an_hour(device, sensor):
    """Return a text on the growth of the standard error of the bias in an hour.

    The text is empty if no axis has flicker, random walk or a Gauss-Markov process.
    """
    sizes = [wander(noise, HOUR, OVER) for _, noise in of_axes(device.axes, sensor)]
    if not any(sizes):
        return ""
    display = QUANTITIES[sensor]["bias"]
    listed = joined([display.size(size or None, 2) for size in sizes])
    return f"; to its σ an hour later, add {listed} {display.unit} from B and K, in quadrature"


def reasons(device):
    """Return the reasons why parts of the calibration are missing: (method, sensor, reason).

    A reason is left out if a verdict gives it, or if it belongs to the final calibration and an
    earlier method gives it too.
    """
    told = {(b["sensor"], b.get("why")) for b in blocks(device.diagnosis)}
    lines = {}
    for method, calibration in device.calibrations.items():
        for sensor in SENSORS:
            why = getattr(calibration, sensor).not_testable
            earlier = method == "final" and any(key[1:] == (sensor, why) for key in lines)
            if why and (sensor, why) not in told and not earlier:
                lines[WORDS["stages"][method], sensor, why] = None
    return [*lines]


def model_table(device, sensor):
    """Return the table of T, K and b of the final calibration, as stored in calibration.json."""
    s = getattr(device.calibrations["final"], sensor)
    unit = typeset(s.raw_unit.name)
    lines = [(f"T, row {axis}", "1", row) for axis, row in zip(XYZ, s.T, strict=True)]
    lines += [("K", f"{UNITS[sensor]} per {unit}", s.K), ("b", unit, s.b)]
    return Table(
        f"{sensor.capitalize()}: final model x = T (K (raw − b) − e), to copy",
        ("Symbol", "Unit", *XYZ),
        # numbers have the minus sign of a keyboard, which programs can read
        [(symbol, unit, *(f"{v:.8g}" for v in values)) for symbol, unit, values in lines],
    )


def noise_words(sensor, term):
    """Return a noise coefficient in words."""
    return WORDS["noise"][term].format(white=WORDS["white"][sensor], walk=WORDS["walk"][sensor])


def coefficient_table(device, sensor):
    """Return the table of a sensor's noise coefficients, a column per axis."""
    values, rows = select(noise_values(device), sensor=sensor, stage="logged"), []
    typical = device.data_sheet.get("noise", {}).get(sensor)
    for term in COEFFICIENTS:
        display, words = QUANTITIES[sensor][term], noise_words(sensor, term)
        if term == "N" and typical is not None:
            words += f"; data sheet {display.size(typical, 2)} (typical)"
        cells = (value.text(display) for value in select(values, quantity=term))
        rows.append((words, display.unit, *cells))
    axes = of_axes(device.axes, sensor)
    for key, unit, name in (("tc", "s", "gauss_markov"), ("frequency", "Hz", "sinusoid")):
        terms = [[coefficient_text(getattr(p, key)) for p in getattr(n, name)] for _, n in axes]
        if any(terms):
            rows.append((noise_words(sensor, key), unit, *map(", ".join, terms)))
    return Table(
        f"{sensor.capitalize()}: noise coefficients, value ± 1 σ",
        ("Coefficient", "Unit", *XYZ),
        rows,
        "“<” is the 95 % upper limit of a term that was not seen in the record. B is the flat part "
        "of the Allan curve divided by 0.664.",
    )


def steps_table(block):
    """Return the table of effects in the order they were added in, or an empty list."""
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
    """Return a row for each parameter of an effect: name, value ± σ, unit as in data sheets."""
    rows = []
    for name, value in effect["parameters"].items():
        display, sigma = data_sheet(effect["units"][name]), effect["std"].get(name)
        text = with_sigma(value, sigma, display.factor)
        rows.append((f"{name}{_step(effect, name)}", text, display.unit))
    return rows


def matrix_rows(effect):
    """Return rows of an effect's parameters, a column per axis; empty if they have no axes."""
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
    """Return a text with session and time of the step whose number is in a parameter's name.

    The text is empty if the name has no such number.
    """
    sessions, times = (effect["constants"].get(key, ()) for key in ("sessions", "times"))
    step = int((re.search(r"\d+", name) or ["0"])[0]) - 1
    known = 0 <= step < min(len(sessions), len(times))
    return f", {sessions[step]} at {duration(times[step])}" if known else ""


def effect_table(block, effect):
    """Return the table of parameters ± σ of an effect that was added."""
    known = Effect.library.get(effect["name"])
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
    note = f"{known.equation} ({known.reference})." if known else ""
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
    """Return the table of bias and mounting of sessions with a reference, or an empty list."""
    rows = []
    for session, content in block.get("set_up", {}).items():
        rows += [(f"{session}, {name}", *cells) for name, *cells in parameter_rows(content)]
    note = "b: bias as logged. m: rotation vector from the axes of the body to the reference's."
    title = f"{block['sensor'].capitalize()}, sessions with a reference"
    return rows and Table(title, ("Parameter", "Value ± 1 σ", "Unit"), rows, note)


def ranked(block):
    """Return the candidates of a diagnosis, sorted by status.

    Within a status, added effects are in the order of their addition, and others are sorted by
    p-value.
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
    """Return the table of the effects that were tried, with status and detection limits.

    The result is None if no effect was tried.
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
    """Return the constants of an effect's variant, such as order or time constant, in words."""
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


def data_table(device):
    """Return the table of sessions, a column per session: rows, rate, every fault counted."""
    columns = []
    for s in device.sessions:
        status = "rejected" if s.rejected else "used"
        columns.append({"Kind": s.kind, "Status": status} | quality_figures(s.quality))
    # a figure that no session has needs no row
    rows = [(name, *(column[name] for column in columns)) for name in columns[0]]
    return Table(
        "Sessions and the quality of their logs",
        ("Figure, unit", *(session.name for session in device.sessions)),
        [row for row in rows if not NOTHING.issuperset(row[1:])],
    )


def quality_figures(q):
    """Return the figures of `q`, the content of quality.json, as text by their name and unit."""
    jitter, clock, limits = q["jitter"]["std_s"], q["clock"] or {}, q["temperature_range"]
    names = {"roll-overs": "rollovers", "resets": "resets", "strays": "strays"}
    mended = text_of({name: clock.get(key) for name, key in names.items()})
    # saturation is unknown without a full scale
    clipped = {k: v for k, v in q["clipped"].items() if v is not None}
    dropped = WORDS["dropped"].items()
    return {
        "Rows used": text_of(q["rows"]),
        "Duration": duration(q["duration_s"]),
        "Rate, Hz": number(q["rate_hz"], 5),
        "Jitter, 1 σ, ms": number(None if jitter is None else round(jitter * 1e3, 6)),
        "Stamps mended": "rebuilt from the row number" if clock.get("rebuilt") else mended,
        "Clock error by the declared rate, ppm": number(clock.get("drift_ppm")),
        "Clock error by GNSS time, ppm": number((clock.get("pps") or {}).get("drift_ppm")),
        "Gaps": text_of(q["gaps"]["count"]),
        "Length of all gaps, s": number(q["gaps"]["total_s"]),
        **{f"{words}, rows": text_of(q[key]) for key, words in dropped},
        "Clipped, values": text_of(clipped) if clipped else "not known, no full_scale",
        "Constant channels": text_of(q["constant"]),
        **_faults(q["faults"]),
        "Temperature, °C": " to ".join(map(number, limits)) if limits else "not logged",
        "Start": text_of(q["start"]),
        "Units as logged": text_of(q["units"]),
    }


def _faults(found):
    """Return the faults of values as text, by name and unit; ingest leaves them in the samples."""

    def rows(key):
        """Return the rows of a fault by channel as text."""
        return text_of({k: v["rows"] for k, v in found.get(key, {}).items()})

    held = {sensor: n for sensor, n in (found.get("rows_a_value") or {}).items() if n > 1}
    rests = found.get("rests") or {}
    figures = {
        "Zero on all axes, rows": text_of(found.get("zero_rows")),
        "Stuck at one value, rows": rows("stuck"),
        "Without noise at rest": text_of(found.get("silent_at_rest")),
        "Spikes of one sample, not removed": text_of(found.get("spikes")),
        "Clipped at a repeated extreme, rows": rows("clipped_at"),
        "Rows per new value": text_of(held) if held else "1",
        "Axes that are copies": text_of([f"{b} of {a}" for a, b in found.get("copies", ())]),
        "Specific force at rest, m/s²": number((rests.get("force") or [None] * 2)[1], 4),
        "Correlation of gyroscope turns with gravity turns (1 is perfect)": number(
            (found.get("axes") or {}).get("agreement")
        ),
        "Turn by the gyroscope per turn of gravity, rest to rest": number(
            (rests.get("turn_ratio") or {}).get("value")
        ),
    }
    return figures if found else dict.fromkeys(figures, NO_NUMBER)
