"""The tables of the calibration and of the noise of a device in the report."""

import numpy as np

from imuloop.core.errors import joined
from imuloop.core.noise_model import AxisNoise
from imuloop.core.samples import SENSORS
from imuloop.core.units import HOUR
from imuloop.report.findings import blocks
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
    number,
    typeset,
)
from imuloop.report.page import WORDS
from imuloop.report.results import UNITS, XYZ, of_axes
from imuloop.report.table import Sized, Table, shade
from imuloop.report.units import COEFFICIENTS, QUANTITIES

NOT_ESTIMATED = "not estimated"
# s, the length of the means whose difference over an hour is the change of a bias
OVER = 60.0


def parameter_table(device, sensor):
    """Return the Table of bias and scale factors of a sensor, a column per calibration method.

    `device` is a DeviceResults, and `sensor` the name of the sensor. The result is None if no
    method estimated a parameter.
    """
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
    """Return the Table of the misalignment matrix of a sensor ± 1 σ, by the final calibration.

    An element is how much of a column's axis appears on a row's axis. `device` is a DeviceResults,
    and `sensor` the name of the sensor. The result is None if no misalignment was estimated.
    """
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


def _equal(one, other):
    """Return whether two SensorCalibrations, `one` and `other`, have equal method, T, K and b.

    If so, a table needs only one column for both.
    """
    pairs = ((one.T, other.T), (one.K, other.K), (one.b, other.b))
    return one.method == other.method and all(np.array_equal(a, b) for a, b in pairs)


def wander(noise, interval, length):
    """Return the standard deviation of the difference of a bias at two times, SI.

    The times are `interval` s apart. The bias at a time is the mean of the output over the next
    `length` s. `noise` is the AxisNoise of the channel. Of its terms, flicker, random walk and
    Gauss-Markov processes count; white noise does not.
    """
    slow = AxisNoise(B=noise.B, K=noise.K, gauss_markov=noise.gauss_markov)
    covariance = slow.mean_covariance(np.add.outer([0.0, interval], [0.0, length]))
    return float(np.sqrt(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1]))


def _after_an_hour(device, sensor):
    """Return a text on how far the biases of a sensor may change in an hour, 1 σ of each axis.

    The text continues a sentence below a table. It is empty if no axis has flicker, random walk or
    a Gauss-Markov process. `device` is a DeviceResults, and `sensor` the name of the sensor.
    """
    sizes = [wander(noise, HOUR, OVER) for _, noise in of_axes(device.axes, sensor)]
    if not any(sizes):
        return ""
    display = QUANTITIES[sensor]["bias"]
    listed = joined([display.size(size or None, 2) for size in sizes])
    return f"; to its σ an hour later, add {listed} {display.unit} from B and K, in quadrature"


def reasons(device):
    """Return why parts of the calibration are missing, a list of (method, sensor, reason).

    All three are texts. A reason is left out if a verdict already gives it. A reason of the final
    calibration is also left out if another method already gives it. `device` is a DeviceResults.
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
    """Return the Table of the final model of a sensor: T, K and b, as calibration.json has them.

    T is the misalignment matrix, K are the scale factors and b the biases, in ``x = T (K (raw − b)
    − e)``. `device` is a DeviceResults, and `sensor` the name of the sensor.
    """
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
    """Return the words for a noise coefficient of a sensor, such as "angle random walk".

    `sensor` is the name of the sensor, and `term` the symbol of the coefficient, such as N.
    """
    return WORDS["noise"][term].format(white=WORDS["white"][sensor], walk=WORDS["walk"][sensor])


def coefficient_table(device, sensor):
    """Return the Table of the noise coefficients of a sensor, a column per axis.

    `device` is a DeviceResults, and `sensor` the name of the sensor.
    """
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
