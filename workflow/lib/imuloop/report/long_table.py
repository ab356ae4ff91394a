"""All numbers of a device as one long table, from which tables and comparisons are made."""

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from imuloop.core.noise_model import AxisNoise
from imuloop.core.samples import SENSORS
from imuloop.export.densities import UNITS
from imuloop.report.findings import QUOTED, block_of
from imuloop.report.numbers import missing, sigma_of, value_text
from imuloop.report.results import XYZ, of_axes
from imuloop.report.units import COEFFICIENTS

# terms of misalignment, in the order of every list of them
PAIRS = {f"T{i}{j}": XYZ[i] + XYZ[j] for i, j in permutations(range(3), 2)}
# quantity and axis of each parameter of a calibration
PARAMETERS = {f"b{i}": ("bias", axis) for i, axis in enumerate(XYZ)}
PARAMETERS |= {f"K{i}": ("scale", axis) for i, axis in enumerate(XYZ)}
PARAMETERS |= {name: ("misalignment", pair) for name, pair in PAIRS.items()}
# SI unit of each quantity that is compared
SI = {
    sensor: {"residual": residual, "bias": UNITS[sensor]["B"], "scale": "1", "misalignment": "rad"}
    | UNITS[sensor]
    for sensor, residual in (("accelerometer", "m/s^2"), ("gyroscope", "rad"))
}


@dataclass(frozen=True)
class Value:
    """A number of a device, SI, with its standard error `std`: a row of the long table.

    `quantity` is such as ``bias``, ``scale`` or a noise coefficient. `axis` is an axis, two axes
    for a misalignment, or None. `value` is None if the data give only an upper limit. The `stage`
    is

    - the method of the calibration for a parameter;
    - ``logged``, or ``before`` and ``after`` the correction of effects, for a noise coefficient;
    - ``after`` or ``floor`` for a held-out error: with the effects corrected, or from noise alone;
    - ``prior`` for the standard deviation of a parameter before the fit.
    """

    sensor: str
    stage: str
    quantity: str
    axis: str | None
    value: float | None
    std: float | None  # standard error
    unit: str | None
    upper95: float | None = None  # one-sided 95 % upper limit, for noise coefficients

    def text(self, display):
        """Return the value ± 1 σ, or its upper limit if it has no value, as text.

        The numbers are in the unit of `display`, a Display, without its name.
        """
        return value_text(self.value, self.std, self.upper95, display.factor)


def long_table(device):
    """Return all numbers of a DeviceResults, `device`, a list of `Value`."""
    rows = [*calibration_values(device.calibrations), *noise_values(device)]
    for sensor in SENSORS if "final" in device.calibrations else ():
        rows += prior_values(device, sensor)
    return [*rows, *residual_values(device)]


def calibration_values(calibrations):
    """Return a `Value` for each estimated parameter of each calibration, a list.

    `calibrations` are the Calibrations of a device by method. Biases and scale factors are
    converted from the raw units of the log to SI; a scale factor is given as its deviation from the
    nominal one.
    """
    rows = []
    for stage, calibration in calibrations.items():
        for name in SENSORS:
            sensor, unit = getattr(calibration, name), getattr(calibration, name).raw_unit
            for parameter, (quantity, axis) in PARAMETERS.items():
                if parameter not in sensor.names:
                    continue
                at, std = tuple(map(int, parameter[1:])), sensor.std[parameter]
                if quantity == "bias":
                    value, std = unit.to_si(sensor.b)[at], std * unit.scale
                elif quantity == "scale":
                    value, std = sensor.K[at] / unit.scale - 1, std / unit.scale
                else:
                    value = sensor.T[at]
                si = SI[name][quantity]
                rows.append(Value(name, stage, quantity, axis, float(value), float(std), si))
    return rows


def prior_values(device, sensor):
    """Return the numbers of a sensor that were known before the fit, a list of `Value`.

    They are the standard deviation that the prior gives each parameter and, if the data sheet
    states it, the white noise. All have the stage ``prior``. `device` is a DeviceResults with a
    final calibration, and `sensor` the name of the sensor.
    """
    rows, final = [], getattr(device.calibrations["final"], sensor)
    for parameter, (quantity, axis) in PARAMETERS.items():
        if std := (final.prior or {"std": {}})["std"].get(parameter):
            unit = {"bias": final.raw_unit.scale, "scale": 1 / final.raw_unit.scale}
            std *= unit.get(quantity, 1.0)
            rows.append(Value(sensor, "prior", quantity, axis, std, None, SI[sensor][quantity]))
    if typical := device.data_sheet.get("noise", {}).get(sensor):
        rows.append(Value(sensor, "prior", "N", None, typical, None, SI[sensor]["N"]))
    return rows


def noise_values(device):
    """Return the `Value` of each noise coefficient of a DeviceResults, `device`, a list.

    A coefficient of all samples as logged has the stage ``logged``. If the diagnosis has static
    records, their coefficients follow, with the stage ``before`` for the noise before the effects
    were subtracted, and ``after`` for the noise after that.
    """
    rows = []
    for sensor in SENSORS:
        stages = {"logged": of_axes(device.axes, sensor)}
        change = of_axes(
            block_of(device.diagnosis, sensor, "static_record").get("noise", {}), sensor
        )
        for stage in ("before", "after"):
            stages[stage] = [(a, AxisNoise.from_dict(c[stage])) for a, c in change if c]
        for stage, axes in stages.items():
            for term in COEFFICIENTS:
                for axis, noise in axes:
                    c = getattr(noise, term)
                    numbers = {"value": c.value, "std": sigma_of(c), "upper95": c.upper95}
                    unit = SI[sensor].get(term)
                    rows.append(Value(sensor, stage, term, axis, unit=unit, **numbers))
    return rows


def residual_values(device):
    """Return the held-out errors of poses and their floors, a list of `Value`.

    The floor is the size that an error would have from noise alone. The quantity ``residual`` is
    the kind of error that a user notices first, the same for all devices. The quantity ``quoted``
    is the kind of error that the verdict of this device quotes. `device` is a DeviceResults.
    """
    rows = []
    for sensor in SENSORS:
        block = block_of(device.diagnosis, sensor, "poses")
        for quantity, name in (("residual", QUOTED[sensor][0]), ("quoted", block["quoted"])):
            if r := block["residuals"].get(name):
                # the root mean square of n normal errors has a relative standard error of 1/sqrt(2
                # n)
                std = r["after"] / np.sqrt(2 * max(r["n"], 1))
                for stage, error in (("after", std), ("floor", None)):
                    unit = r["unit"]
                    rows.append(Value(sensor, stage, quantity, None, r[stage], error, unit))
    return rows


def select(rows, **keys):
    """Return those of `rows`, a list of `Value`, whose fields equal `keys`: ``stage="final"``."""
    return [row for row in rows if all(getattr(row, k) == v for k, v in keys.items())]


def worst(rows):
    """Return two `Value`: the one with the largest value, and one whose upper limit is above it.

    `rows` are the `Value` of one quantity on several axes. The second result is the largest upper
    limit among axes without a value, one of which may still be the worst axis. The first result is
    None if no axis has a value, the second if no axis without a value has a limit above the first.
    """
    values = [row for row in rows if not missing(row.value)]
    limits = [row for row in rows if missing(row.value) and not missing(row.upper95)]
    largest = max(values, key=lambda row: abs(row.value), default=None)
    limit = max(limits, key=lambda row: (row.upper95, row.axis), default=None)
    # an axis with only an upper limit may still be the worst
    if largest and limit and limit.upper95 <= abs(largest.value):
        limit = None
    return largest, limit
