"""The calibration's parameters with σ, methods side by side, and the model as it is stored."""

import numpy as np

from imuloop.core.errors import joined
from imuloop.core.noise_model import AxisNoise
from imuloop.core.units import HOUR
from imuloop.report.numbers import number, typeset, with_sigma
from imuloop.report.results import SENSORS, UNITS, XYZ, base_parameters, of_axes
from imuloop.report.tables.table import Sized, Table
from imuloop.report.units import DEGREE_PER_SECOND, MILLI_G, MILLIRADIAN, PERCENT
from imuloop.report.verdict import blocks

METHODS = {"six_position": "Six-position", "multi_position": "Multi-position", "final": "Final"}
METHOD_WORDS = {
    "multi_position": "poses in many attitudes",
    "six_position": "six faces",
    "known_rotation": "turns of known angles",
    "static": "rests only: bias alone",
    "nominal": "data sheet, nothing estimated",
}
NOT_ESTIMATED, BY_DEFINITION = "not estimated", "0 (by definition)"
# s, that a bias is taken over an hour later
OVER = 60.0
BIAS = {"accelerometer": MILLI_G, "gyroscope": DEGREE_PER_SECOND}


def parameter_table(device, sensor):
    """Return a sensor's parameters, a column per method; None if nothing was estimated."""
    # a method that estimated nothing has no column; why stands above the table
    methods = {m: s for m, c in device.calibrations.items() if (s := getattr(c, sensor)).names}
    if not methods:
        return None
    final = methods.get("final")
    for method in [m for m, s in methods.items() if m != "final" and final and _alike(s, final)]:
        del methods[method]
    columns = [_cells(s, BIAS[sensor]) for s in methods.values()]
    rows = [("Reduced χ²", "1", *(number(s.reduced_chi2) for s in methods.values()))]
    for name in columns[0]:
        cells = [column[name] for column in columns]
        if not {NOT_ESTIMATED, BY_DEFINITION}.issuperset(cells):
            rows.append((*name, *cells))
    return Table(
        f"{sensor.capitalize()}: parameters, value ± 1 σ",
        ("Parameter", "Unit", *(METHODS[m] for m in methods)),
        rows,
        f"A bias is the mean level over the rests of this record{_after_an_hour(device, sensor)}. "
        "Misalignment ij: how much of axis j shows on axis i. A value marked “data sheet” was "
        "hardly improved by these data. Reduced χ² near 1: as good as the noise allows.",
        sortable=True,
    )


def wander(noise, interval, length):
    """Return the standard deviation of the change of the bias between two times, SI.

    It is the difference of two means of the output by flicker, random walk and Gauss-Markov
    processes, without other noise. Takes the interval between the starts of the two means, and
    the length of each, s.
    """
    slow = AxisNoise(B=noise.B, K=noise.K, gauss_markov=noise.gauss_markov)
    covariance = slow.mean_covariance(np.add.outer([0.0, interval], [0.0, length]))
    return float(np.sqrt(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1]))


def _after_an_hour(device, sensor):
    """Return in words what to add to the standard error of a bias for the next hour, if known."""
    sizes = [wander(noise, HOUR, OVER) for _, noise in of_axes(device.axes, sensor)]
    if not any(sizes):
        return ""
    listed = joined([BIAS[sensor].size(size or None, 2) for size in sizes])
    return f"; an hour later add, in quadrature, ± {listed} {BIAS[sensor].unit} by B and K"


def _alike(one, other):
    """Return whether two calibrations have the same parameters: they are shown once."""
    pairs = ((one.T, other.T), (one.K, other.K), (one.b, other.b))
    return one.method == other.method and all(np.array_equal(a, b) for a, b in pairs)


def _cells(sensor, bias):
    """Return the parameters of one calibration as text by (name, unit)."""
    base, estimated = base_parameters(sensor), set(sensor.names)
    found = [
        (f"{words} {axis}", f"{letter}{i}", display, *(v[i] for v in base[key]))
        for key, words, letter, display in (
            ("bias", "Bias", "b", bias),
            ("scale", "Scale factor error", "K", PERCENT),
        )
        for i, axis in enumerate(XYZ)
    ]
    found += [
        (f"Misalignment {XYZ[i]}{XYZ[j]}", f"T{i}{j}", MILLIRADIAN, *pair)
        for (i, j), pair in base["misalignment"].items()
    ]
    cells = {}
    for words, name, display, value, sigma in found:
        text = NOT_ESTIMATED
        if name in estimated:
            mark = f", {sensor.prior['source']}" if name in sensor.unimproved else ""
            text = Sized(with_sigma(value, sigma, display.factor) + mark, value)
        elif name[0] == "T" and estimated & {"T01", "K0"}:
            text = BY_DEFINITION
        cells[words, display.unit] = text
    return cells


def reasons(device):
    """Return why parts of the calibration could not be made: (method, sensor, reason).

    A reason that stands with a verdict is left out, and one of the final calibration that a method
    before it has.
    """
    told = {(sensor, block.get("why")) for sensor, _, block in blocks(device.diagnosis)}
    found = [
        (METHODS[method], sensor, why)
        for method, calibration in device.calibrations.items()
        for sensor in SENSORS
        if (why := getattr(calibration, sensor).not_testable) and (sensor, why) not in told
    ]
    before = [each[1:] for each in found if each[0] != METHODS["final"]]
    return [each for each in found if each[0] != METHODS["final"] or each[1:] not in before]


def model_table(device, sensor):
    """Return T, K and b of the final calibration as calibration.json stores them."""
    s = getattr(device.calibrations["final"], sensor)
    unit = typeset(s.raw_unit.name)
    lines = [(f"T, row {axis}", "1", row) for axis, row in zip(XYZ, s.T, strict=True)]
    lines += [("K", f"{UNITS[sensor]} per {unit}", s.K), ("b", unit, s.b)]
    return Table(
        f"{sensor.capitalize()}: final model x = T (K (raw − b) − e), to copy",
        ("Symbol", "Unit", *XYZ),
        # with the minus sign of a keyboard, which programs read
        [(symbol, unit, *(f"{v:.8g}" for v in values)) for symbol, unit, values in lines],
    )
