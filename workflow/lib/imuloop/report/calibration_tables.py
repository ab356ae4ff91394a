"""The calibration's parameters with σ, methods side by side, and the model as it is stored."""

import numpy as np

from imuloop.report.numbers import (
    DEGREE_PER_SECOND,
    MILLI_G,
    MILLIRADIAN,
    PERCENT,
    number,
    typeset,
    with_sigma,
)
from imuloop.report.results import UNITS, XYZ, base_parameters
from imuloop.report.table import Sized, Table

METHODS = {
    "six_position": "Six-position",
    "multi_position": "Multi-position",
    "final": "Final",
}
METHOD_WORDS = {
    "multi_position": "poses in many attitudes",
    "six_position": "six faces",
    "static": "rests only: bias alone",
    "nominal": "data sheet, nothing estimated",
}
NOT_ESTIMATED = "not estimated"
BIAS = {"accelerometer": MILLI_G, "gyroscope": DEGREE_PER_SECOND}


def parameter_table(device, sensor):
    """Return a sensor's parameters, a column a method, value ± σ; None if nothing was estimated."""
    # a method that estimated nothing has no column; why stands above the table
    methods = {m: s for m, c in device.calibrations.items() if (s := getattr(c, sensor)).names}
    if not methods:
        return None
    columns = {m: _cells(s, BIAS[sensor]) for m, s in methods.items()}
    rows = [
        ("Method", "", *(METHOD_WORDS[s.method] for s in methods.values())),
        ("Reduced χ²", "1", *(number(s.reduced_chi2) for s in methods.values())),
    ]
    for name in next(iter(columns.values())):
        cells = [column[name] for column in columns.values()]
        if set(cells) != {NOT_ESTIMATED}:
            rows.append((*name, *cells))
    return Table(
        f"{sensor.capitalize()}: parameters, value ± 1 σ",
        ("Parameter", "Unit", *(METHODS[m] for m in methods)),
        tuple(rows),
        "Bias: what it reads when it should read zero. Scale factor error: how far a unit of its "
        "output is from a true unit. Misalignment ij: how much of axis j shows on axis i. "
        "A parameter that is not listed, or not estimated, is not determined by these data. "
        "Reduced χ² near 1: the fit is as good as the noise allows.",
        sorts=tuple(range(2 + len(methods))),
    )


def _cells(sensor, bias_display):
    """Return the parameters of one calibration as text by (name, unit)."""
    base, estimated = base_parameters(sensor), set(sensor.names)
    cells = {}
    for key, words, letter, display in (
        ("bias", "Bias", "b", bias_display),
        ("scale", "Scale factor error", "K", PERCENT),
    ):
        value, sigma = base[key]
        for i, axis in enumerate(XYZ):
            cells[f"{words} {axis}", display.unit] = (
                Sized(with_sigma(value[i] * display.factor, sigma[i] * display.factor), value[i])
                if f"{letter}{i}" in estimated
                else NOT_ESTIMATED
            )
    for (i, j), (value, sigma) in base["misalignment"].items():
        if f"T{i}{j}" in estimated:
            text = Sized(with_sigma(value * 1e3, sigma * 1e3), value)
        else:
            text = "0 (by definition)" if estimated & {"T01", "K0"} else NOT_ESTIMATED
        cells[f"Misalignment {XYZ[i]}{XYZ[j]}", MILLIRADIAN.unit] = text
    return cells


def reasons(device):
    """Return why parts of the calibration could not be made: (method, sensor, reason)."""
    return [
        (METHODS[method], sensor, getattr(calibration, sensor).not_testable)
        for method, calibration in device.calibrations.items()
        if method != "final"
        for sensor in ("accelerometer", "gyroscope")
        if getattr(calibration, sensor).not_testable
    ]


def model_table(device, sensor):
    """Return T, K and b of the final calibration as calibration.json stores them."""
    calibration = device.calibrations.get("final")
    if calibration is None:
        return None
    s = getattr(calibration, sensor)
    rows = [
        (f"T, row {axis}", "1", *(f"{v:.8g}" for v in row))
        for axis, row in zip(XYZ, s.T, strict=True)
    ]
    rows += [
        ("K", f"{UNITS[sensor]} per {typeset(s.raw_unit.name)}", *(f"{v:.8g}" for v in s.K)),
        ("b", typeset(s.raw_unit.name), *(f"{v:.8g}" for v in s.b)),
    ]
    return Table(
        f"{sensor.capitalize()}: final model x = T (K (raw − b) − e), to copy",
        ("Symbol", "Unit", *XYZ),
        # with the minus sign of a keyboard, which programs read
        tuple(rows),
    )


def correlations(sensor):
    """Return the correlations of a sensor's parameters, shape (p, p); None where not known.

    Parameters
    ----------
    sensor : SensorCalibration
        A calibration.
    """
    if sensor.covariance is None or len(sensor.names) < 2:
        return None
    std = np.sqrt(np.diag(sensor.covariance))
    return sensor.covariance / np.outer(std, std) if (std > 0).all() else None


def parameter_words(name):
    """Return a parameter's name as the tables have it: K0 as scale factor x."""
    letter, axes = name[0], name[1:]
    if letter not in "TKb" or not set(axes) <= set("012"):
        return name
    quantity = {"T": "misalignment", "K": "scale factor", "b": "bias"}[letter]
    return f"{quantity} {''.join(XYZ[int(axis)] for axis in axes)}"
