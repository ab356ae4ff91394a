"""The comparison of devices: summary.json of each, the tables of the first screen, the CSV file."""

from dataclasses import asdict
from typing import NamedTuple

import numpy as np
import pandas as pd

from imuloop.core.errors import one_line
from imuloop.core.samples import SENSORS
from imuloop.core.tables import text_cell
from imuloop.export.densities import for_filter, of_calibrated
from imuloop.report.advice import next_step
from imuloop.report.figures.allan import curve, longest_curve_first
from imuloop.report.figures.loop import loop_errors
from imuloop.report.findings import BOTH, answers, blocks, card, rank
from imuloop.report.long_table import PAIRS, SI, Value, long_table, select, worst
from imuloop.report.numbers import NO_NUMBER, missing
from imuloop.report.page import RECORDS, WORDS
from imuloop.report.results import XYZ, of_axes
from imuloop.report.units import DEGREES, MILLI_G, QUANTITIES, data_sheet

# version of summary.json
FORMAT = 2
# stages of the long table that are compared
COMPARED = ("final", "logged", "after", "floor", "prior")


def summarise(device):
    """Return the content of summary.json, a dict by which devices are compared.

    `device` is a DeviceResults, all results of one device. Keys that need an explanation:

    - ``values``: numbers of the device, rows of the long table (`long_table`);
    - ``filter``: noise for a filter, {name: {value, axis, limit, raised_from}} (`filter_noise`);
    - ``allan``: Allan deviation, {channel: {tau_s, adev}}: averaging times, s, and deviations, SI;
    - ``answers``, ``card``: texts on the verdicts, results of `answers` and `card`;
    - ``loop``: the errors as logged, calibrated and corrected (`loop_errors`);
    - ``verdicts``: the verdict by sensor and kind of data;
    - ``calibrated``: whether there is a calibration to use.
    """
    diagnoses, final = blocks(device.diagnosis), device.calibrations.get("final")
    loop = loop_errors(device, diagnoses) if device.calibrations else []
    record = next(iter(longest_curve_first(device.used)), None)
    rejected = [s for s in device.sessions if s.rejected]
    values = [v for v in long_table(device) if v.unit and v.stage in COMPARED]
    return {
        "format": FORMAT,
        "device": device.name,
        "label": device.title,
        "simulated": device.simulated,
        "status": "ok" if device.used else "rejected",
        "rejected": [{"session": s.name, "kind": s.kind, "reasons": s.reasons} for s in rejected],
        "verdicts": {
            name: {b["part"]: b["verdict"] for b in diagnoses if b["sensor"] in (name, BOTH)}
            for name in SENSORS
        },
        "answers": answers(diagnoses),
        "card": card(diagnoses, loop, final) | {"next": next_step(device)},
        "calibrated": bool(final and final.measured),
        "loop": loop,
        "values": list(map(asdict, values)),
        "filter": filter_noise(device, final),
        "allan": {c: curve(record.allan, c)[["tau_s", "adev"]].to_dict("list") for c in device.axes}
        if record
        else {},
        "allan_csv": record and f"{device.name}/figures/{record.name}_allan.csv",
        "logs": [
            {"session": s.name, "file": file, "sha256": digest}
            for s in device.sessions
            for file, digest in s.source["sha256"].items()
        ],
    }


def filter_noise(device, final):
    """Return the noise of each sensor for a filter, and the sampling rate of the logs, a dict.

    The sampling rate, Hz, has the key ``rate_hz``. White noise N and random walk K have the keys
    ``SENSOR_N`` and ``SENSOR_K``. Each is a Density as a dict, from the axis with the largest
    value, SI. If the data do not show a coefficient, its 95 % upper limit counts. N and K are
    raised if they would not bound the Allan variance (`bounding`).

    `device` is a DeviceResults. `final` is its final Calibration, to whose samples the noise then
    belongs, or None for the noise of samples as logged.
    """
    rates = [s.quality["rate_hz"] for s in device.used]
    content = {"rate_hz": device.noise.get("rate_hz") or next(iter(rates), None)}
    for sensor in SENSORS:
        axes = [(a, n) for a, n in of_axes(device.axes, sensor) if None not in (n.N.size, n.K.size)]
        for term in "NK" if axes else "":
            densities = [for_filter(noise, axis, term) for axis, noise in axes]
            if final:
                densities = of_calibrated(getattr(final, sensor), densities)
            content[f"{sensor}_{term}"] = asdict(max(densities, key=lambda d: d.value))
    return content


class Cell(NamedTuple):
    """A cell of the table that compares devices: its `text`, and small text `below` it.

    `value` is the number in the cell, by which the column is sorted; None for a cell without a
    number. `mark` is the value that the data sheet states for the same quantity, or None. `place`
    and `mark_place` are the positions of `value` and `mark` along the bar that is drawn in the
    cell, %; they are None until `placed` sets them.
    """

    text: str
    below: str = ""
    value: float | None = None
    mark: float | None = None
    place: float | None = None
    mark_place: float | None = None


def placed(rows):
    """Return rows of Cells, one per device, in which `place` and `mark_place` are set.

    Both are positions along the bar of a cell, %, in the logarithm of the value. The smallest value
    or mark of the column is at 4 %, the largest at 96 %. A cell without small text has no bar, and
    its positions stay None. `rows` are the rows of Cells without positions.
    """
    columns_of_cells = []
    for column in zip(*rows, strict=True):
        sizes = [x for cell in column for x in (cell.value, cell.mark) if x and x > 0]
        low, span = (np.log(min(sizes)), np.log(max(sizes) / min(sizes))) if sizes else (0.0, 0.0)

        def place(size, low=low, span=span):
            """Return the position along the bar, 4 to 96 %, of a value `size` of the column.

            `low` is the logarithm of the least value of the column, and `span` the logarithm of the
            ratio of the largest to the least. The result is None for a value that is absent or not
            above zero, and if all values of the column are equal.
            """
            return 4 + 92 * (np.log(size) - low) / span if size and size > 0 and span else None

        columns_of_cells.append(
            [
                # only a cell with small text below gets a bar: a sampling rate has none, as it is
                # not compared
                c._replace(place=place(c.value), mark_place=place(c.mark)) if c.below else c
                for c in column
            ]
        )
    return [*zip(*columns_of_cells, strict=True)]


def columns(sensor):
    """Return the columns of the table that compares the devices by one sensor, a dict by quantity.

    A value of the dict is the Display of the column, the unit in which it is shown. `sensor` is the
    name of the sensor.
    """
    residual = MILLI_G if sensor == "accelerometer" else DEGREES
    units = QUANTITIES[sensor] | {"quoted": residual}
    return {quantity: units[quantity] for quantity in WORDS["compared"]}


def pivot(summary, sensor):
    """Return five numbers for each quantity of a sensor, a dict of tuples of `Value` by quantity.

    The first two are the largest value of the axes, and the largest upper limit of an axis whose
    value is not known, if it is above the first. The last three are the noise of samples as logged;
    the floor of a residual, which noise alone gives; and the tolerance, or the noise, by the data
    sheet. Each is None if it is absent. `summary` is the content of summary.json of a device, and
    `sensor` the name of the sensor.
    """
    rows = select([Value(**row) for row in summary["values"]], sensor=sensor)
    quantities = {}
    for quantity in ("residual", *columns(sensor)):
        kept = select(rows, quantity=quantity)
        marks = (worst(select(kept, stage=s))[0] for s in ("logged", "floor", "prior"))
        final = select(kept, stage="after") or select(kept, stage="final")
        quantities[quantity] = (*worst(final or select(kept, stage="logged")), *marks)
    return quantities


def cells(summary, sensor):
    """Return the Cells of a device in the table that compares one sensor, a list by quantity.

    Their positions `place` and `mark_place` are not set yet. `summary` is the content of
    summary.json of the device, and `sensor` the name of the sensor.
    """
    worst_axes = pivot(summary, sensor)
    return [_cell(*worst_axes[quantity], unit) for quantity, unit in columns(sensor).items()]


def _cell(largest, limit, logged, floor, prior, display):
    """Return the Cell of one quantity in the table that compares devices.

    Each argument but the last is a `Value` or None, as `pivot` returns it. `largest` is the largest
    value of the axes, and `limit` an upper limit above it, of an axis whose value is not known.
    `logged` is the noise as logged, `floor` the floor of a residual, and `prior` the tolerance or
    noise by the data sheet. `display` is the Display of the column, the unit to show.
    """
    worst_row, unit, below = largest or limit, "", []
    if not worst_row:
        return Cell(NO_NUMBER)
    if floor:
        column, display = display, data_sheet(floor.unit)
        # the residual may have another unit than the column
        unit = f"\u202f{display.unit}" if column != display else ""
        below.append(f"floor {display.size(floor.value, 2)}")
    if worst_row.axis:
        below.append(f"axis {worst_row.axis}" + ("" if largest else ", 95 % limit"))
    if largest and limit:
        below.append(f"{limit.axis} {limit.text(display)}")
    if logged and logged.value != worst_row.value:
        below.append(f"as logged {display.size(logged.value, 2)}")
    size = abs(largest.value) if largest else limit.upper95
    text = worst_row.text(display) + unit
    return Cell(text, "; ".join(below), size, mark=prior and prior.value)


def verdict_rank(verdicts):
    """Return a number by which the table of devices is sorted, larger for worse verdicts.

    `verdicts` is a dict by kind of data, such as ``poses``. The verdict on poses counts most. If it
    is the same, the verdicts on other data decide, in the order of `RECORDS`.
    """
    order = [rank(verdicts[part]) if part in verdicts else 0 for part in RECORDS]
    return sum(10**k * place for k, place in enumerate(reversed(order)))


def filter_cells(summary):
    """Return the Cells of a device in the table of noise for filters, a list.

    They are the sampling rate, Hz, then white noise and random walk of the accelerometer and of the
    gyroscope, SI. `summary` is the content of summary.json of the device.
    """
    content = summary["filter"]
    rate = content["rate_hz"]
    row = [Cell(NO_NUMBER if missing(rate) else f"{rate:.4g}", value=rate)]
    for density in (content.get(f"{sensor}_{term}") for sensor in SENSORS for term in "NK"):
        if not density:
            row.append(Cell(NO_NUMBER))
            continue
        axis, raised = density["axis"], density["raised_from"]
        words = f"axis {axis}: none seen, so its 95 % limit" if density["limit"] else f"axis {axis}"
        words += "" if raised is None else f", raised from {raised:.2e}"
        row.append(Cell(f"{density['value']:.2e}", words, value=density["value"]))
    return row


def write_comparison(path, summaries, failures=()):
    """Write comparison.csv to `path`: a row per device, values in SI, units in the headers.

    `failures` are the Failures of the run: why results are missing. Each one of a device gives one
    of the first rows, with the reason. `summaries` are the contents of summary.json of the other
    devices.
    """
    rows = [
        {
            "device": text_cell(one_line(f.device)),
            "label": text_cell(one_line(f.label)),
            "status": "failed",
            "why": text_cell(one_line(f"{f.stage} failed: {f.why}")),
        }
        for f in failures
        if f.device
    ]
    table = pd.DataFrame([*rows, *map(_row, summaries)])
    table.to_csv(path, index=False, lineterminator="\n")


def _row(summary):
    """Return the row of a device in comparison.csv, a dict by header.

    `summary` is the content of summary.json of the device. All devices have the same headers; a
    number that is not known is None.
    """
    why = [f"{r['session']}: {reason}" for r in summary["rejected"] for reason in r["reasons"]]
    texts = {key: summary[key] for key in ("device", "label", "status")} | {"why": "; ".join(why)}
    row = {key: text_cell(one_line(text)) for key, text in texts.items()}
    row["simulated"] = str(summary["simulated"]).lower()
    for sensor, units in SI.items():
        for part in RECORDS:
            verdict = summary["verdicts"][sensor].get(part, "not_testable")
            row[f"{sensor}_{part}_verdict"] = verdict
        worst_axes = pivot(summary, sensor)
        for name, unit in units.items():
            largest, limit, *_ = worst_axes[name]
            row[f"{sensor}_{name} [{unit}]"] = largest and largest.value
            row[f"{sensor}_{name}_std [{unit}]"] = largest and largest.std
            if name in "NBK":
                row[f"{sensor}_{name}_upper95 [{unit}]"] = limit and limit.upper95
        final = [Value(**value) for value in summary["values"]]
        for name, axes in (("bias", XYZ), ("scale", XYZ), ("misalignment", PAIRS.values())):
            for axis in axes:
                keys = {"sensor": sensor, "stage": "final", "quantity": name, "axis": axis}
                value = next(iter(select(final, **keys)), None)
                row[f"{sensor}_{name}_{axis} [{units[name]}]"] = value and value.value
                row[f"{sensor}_{name}_{axis}_std [{units[name]}]"] = value and value.std
    return row
