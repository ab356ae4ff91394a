"""The table of sensors, ``sensors.yaml``, as data sheets in SI."""

import re
from dataclasses import dataclass
from functools import cache
from math import isclose, nan, sqrt
from pathlib import Path

import numpy as np

from imuloop.core.errors import ImuloopError, did_you_mean
from imuloop.core.files import read_yaml
from imuloop.core.units import DEGREE, FACTORS, STANDARD_GRAVITY

# sensor of each quantity
PARTS = {"acceleration": "accelerometer", "angular_rate": "gyroscope"}
TABLE = Path(__file__).with_name("sensors.yaml")

# SI per unit at the end of a key of the table
_UNITS = {
    "g": STANDARD_GRAVITY,
    "mg": STANDARD_GRAVITY * 1e-3,
    "m_per_s2": 1.0,
    "deg_per_s": DEGREE,
    "mdps": DEGREE * 1e-3,
    "percent": 0.01,
    "ug_per_sqrt_Hz": STANDARD_GRAVITY * 1e-6,
    "mdps_per_sqrt_Hz": DEGREE * 1e-3,
}
# how the unit of a full scale is written in a config
_WRITTEN = {"g": "g", "m_per_s2": "m/s^2", "deg_per_s": "deg/s"}
# full scales this near, as a share, are the same: some sheets write 245 deg/s, some 250
_SAME_RANGE = 0.03
# standard deviations in one unit of a tolerance, by its meaning in the sheet
_DEVIATIONS = {"typical": 1.0, "one_sigma": 1.0, "maximum": 1 / sqrt(3)}


@dataclass(frozen=True)
class Tolerance:
    """Tolerances: standard deviations of a sensor's parameters about their nominal values.

    Attributes
    ----------
    misalignment : float
        Standard deviation of a misalignment, which is an element off the diagonal of the matrix
        from sensor axes to body axes, rad.
    scale_factor : float
        Standard deviation of a scale factor as a share of the nominal one.
    bias : float
        Standard deviation of a bias, m/s^2 for an accelerometer, rad/s for a gyroscope.
    """

    misalignment: float
    scale_factor: float
    bias: float


# MEMS sensors of which nothing is known
GENERIC = {
    "accelerometer": Tolerance(0.02, 0.03, 0.5),
    "gyroscope": Tolerance(0.02, 0.03, 0.2),
}
# Lower limits for every sheet. Sheets describe the part at 25 °C; solder and mounting shift a bias
# by far more than newer sheets state, and turn a gyroscope chip against the accelerometer's axes.
FLOOR = {
    "accelerometer": Tolerance(0.01, 0.01, 0.5),
    "gyroscope": Tolerance(0.02, 0.01, 0.2),
}
# largest tolerance that a config may state: no sensor is worse, so a larger one is in another unit
LARGEST = Tolerance(0.5, 0.5, 100.0)


@dataclass(frozen=True)
class Range:
    """One measuring range of a sensor.

    Attributes
    ----------
    name : str
        Full scale with its unit, such as ``16 g``.
    full_scale : float
        Largest value that the range covers by the data sheet, m/s^2 or rad/s.
    scale : float
        Nominal scale, m/s^2 or rad/s per count.
    noise_density : float or None
        Typical density of white noise, m/s^2/√Hz or rad/s/√Hz; None if not known.
    """

    name: str
    full_scale: float
    scale: float
    noise_density: float | None


@dataclass(frozen=True)
class SensorFigures:
    """Figures of one sensor, the accelerometer or the gyroscope of a part, SI.

    Attributes
    ----------
    source : str
        Name of the document that has the figures.
    evidence : str
        Kind of the document: ``data sheet`` or ``driver``.
    ranges : tuple of Range
        Measuring ranges, from the smallest full scale to the largest.
    tolerance : Tolerance
        Standard deviations of the sensor's parameters about their nominal values.
    """

    source: str
    evidence: str
    ranges: tuple[Range, ...]
    tolerance: Tolerance

    @property
    def noise_density(self):
        """Typical density of white noise, SI per √Hz; None if unknown or different by range."""
        densities = {one_range.noise_density for one_range in self.ranges}
        return densities.pop() if len(densities) == 1 else None


@dataclass(frozen=True)
class DataSheet:
    """The data sheet of one part of the table, with an accelerometer, a gyroscope or both.

    `key` is the name of the part in the table, and `label` its name for people. `accelerometer` or
    `gyroscope` is None if the part does not have it.
    """

    key: str
    label: str
    manufacturer: str
    accelerometer: SensorFigures | None
    gyroscope: SensorFigures | None

    def choose_range(self, quantity, full_scale=None):
        """Return the measuring Range of one sensor of the part that has a given full scale.

        Parameters
        ----------
        quantity : str
            ``acceleration`` or ``angular_rate``.
        full_scale : str or float, optional
            The full scale wanted: a text with a unit, such as ``16 g`` or ``2000 deg/s``, or a
            number in SI. It is not needed if the sensor of the quantity has a single range.

        Raises
        ------
        ImuloopError
            If there is no such range, or if there are several and no full scale is given.
        """
        part = PARTS[quantity]
        figures = getattr(self, part)
        if figures is None:
            raise ImuloopError(f"{self.label} has no {part}")
        if full_scale is None and len(figures.ranges) == 1:
            return figures.ranges[0]
        # a text of another form, or with an unknown unit, becomes nan, which is close to nothing
        match = re.fullmatch(r"±?(\d+\.?\d*) *(\S*)", str(full_scale).strip())
        to_si = {"": 1.0} | FACTORS[quantity]
        wanted = float(match[1]) * to_si.get(match[2], nan) if match else nan
        for candidate in figures.ranges:
            if isclose(candidate.full_scale, wanted, rel_tol=_SAME_RANGE):
                return candidate
        fault = "range not given" if full_scale is None else f"'{full_scale}' is not a range"
        names = ", ".join(candidate.name for candidate in figures.ranges)
        raise ImuloopError(f"{part} of {self.label}: {fault}; use one of {names}")


def sensor_names():
    """Return the keys of all sensors of the table, sorted."""
    return sorted(_table())


def find_sensor(name):
    """Return the DataSheet of a sensor in the table of sensors.

    Its tolerances are standard deviations. A typical figure of the sheet counts as one standard
    deviation. A maximum counts as the half-width of a rectangular distribution, whose standard
    deviation is maximum/√3. If the sheet has both, the larger standard deviation counts. None is
    below `FLOOR`. If the sheet lacks a figure, it is taken from `GENERIC`.

    Parameters
    ----------
    name : str
        Key, label or alias; case and punctuation do not matter.

    Returns
    -------
    DataSheet

    Raises
    ------
    ImuloopError
        If the table has no such sensor; the message names the nearest one.

    References
    ----------
    JCGM 100:2008, Guide to the expression of uncertainty in measurement, 4.3.7 (rectangular
    distribution).
    """
    table = _table()
    keys = {
        _plain(spelling): key
        for key, row in table.items()
        for spelling in (key, row["label"], *row.get("aliases", ()))
    }
    key = keys.get(_plain(name))
    if key is None:
        hint = did_you_mean(_plain(name), table) or "; imuloop sensors lists them"
        raise ImuloopError(f"'{name}' is not a sensor of the table{hint}")
    row = table[key]
    figures = {
        sensor: _figures(sensor, row[sensor]) if sensor in row else None for sensor in GENERIC
    }
    return DataSheet(key=key, label=row["label"], manufacturer=row["manufacturer"], **figures)


@cache
def _table():
    """Return the table of sensors as it is in the file, a dict of dicts by key of the sensor."""
    return read_yaml(TABLE)


def _plain(name):
    """Return `name` in plain form, lower case without punctuation and spaces, for comparison."""
    return re.sub(r"[\W_]", "", str(name)).lower()


def _figures(sensor, part):
    """Return the SensorFigures of one sensor from its entry in the table.

    `sensor` is ``accelerometer`` or ``gyroscope``. `part` is the entry, a dict whose keys end with
    a unit, such as ``full_scale_g``.
    """
    full_scales, to_si, unit = _find(part, "full_scale_{}")
    # a sheet gives counts per unit, or units per count, for each range
    counts, si_per_unit, _ = _find(part, "counts_per_{}")
    steps, si_per_step, _ = _find(part, "{}_per_count")
    scales = np.divide(si_per_unit, counts) if counts else np.multiply(si_per_step, steps)
    density, density_unit, _ = _find(part, "noise_density_{}")
    # the density may be missing (None), one number for all ranges, or a list
    noise = np.broadcast_to(density and np.multiply(density, density_unit), len(full_scales))
    ranges = tuple(
        Range(
            name=f"{size:g} {_WRITTEN[unit]}",
            full_scale=size * to_si,
            scale=scale,
            noise_density=noise_density,
        )
        for size, scale, noise_density in zip(
            full_scales, scales.tolist(), noise.tolist(), strict=True
        )
    )
    tolerance = Tolerance(
        misalignment=_deviation(part, "cross_axis_{}", sensor, "misalignment"),
        scale_factor=_deviation(part, "scale_factor_{}", sensor, "scale_factor"),
        bias=_deviation(part, "zero_offset_{}", sensor, "bias"),
    )
    return SensorFigures(part["source"], part["evidence"], ranges, tolerance)


def _deviation(part, pattern, sensor, parameter):
    """Return the standard deviation of a parameter of a sensor by its data sheet, SI.

    A typical figure counts as one standard deviation, a maximum as √3 standard deviations. If the
    sheet has both, the larger result counts, but not less than `FLOOR`. If the sheet lacks the
    figure, it is taken from `GENERIC`.

    Parameters
    ----------
    part : dict
        Entry of the sensor in the table.
    pattern : str
        Key in this entry, with braces for the unit, such as ``zero_offset_{}``.
    sensor : str
        ``accelerometer`` or ``gyroscope``.
    parameter : str
        Name of the field of a Tolerance.
    """
    figures, to_si, _ = _find(part, pattern)
    if figures is None:
        return getattr(GENERIC[sensor], parameter)
    stated = (_DEVIATIONS[meaning] * value * to_si for meaning, value in figures.items())
    return max(getattr(FLOOR[sensor], parameter), *stated)


def _find(part, pattern):
    """Return the value of a key that ends with a unit, the SI value of this unit, and the unit.

    `part` is an entry of the table of sensors, a dict. `pattern` is the key with braces for the
    unit, such as ``full_scale_{}`` for ``full_scale_g``. If the dict has no such key, the results
    are None, not-a-number and an empty text.
    """
    for unit, factor in _UNITS.items():
        if (key := pattern.format(unit)) in part:
            return part[key], factor, unit
    return None, nan, ""
