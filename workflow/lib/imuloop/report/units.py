"""The units in which the report shows quantities, and their factors from SI."""

from dataclasses import dataclass

from imuloop.core.units import DEGREE, HOUR, STANDARD_GRAVITY
from imuloop.report.numbers import missing, number, typeset, with_unit


@dataclass(frozen=True)
class Display:
    """A unit as printed, and the `factor` from SI to this unit: ``shown = SI * factor``."""

    unit: str
    factor: float

    def size(self, value, digits=3):
        """Return a value in this unit as text without the unit; a dash if it is None or not finite.

        `value` is in SI, and `digits` is the number of significant digits.
        """
        return number(None if missing(value) else value * self.factor, digits)

    def text(self, value, digits=3):
        """Return a value in this unit as text with the unit; the number is a dash if it is missing.

        `value` is in SI, and `digits` is the number of significant digits.
        """
        return with_unit(self.size(value, digits), self.unit)


_G, _MILLI_G, _MICRO_G = STANDARD_GRAVITY, 1e3 / STANDARD_GRAVITY, 1e6 / STANDARD_GRAVITY
_DEGREE_PER_HOUR = HOUR / DEGREE

MILLI_G = Display("mg", _MILLI_G)
DEGREE_PER_SECOND = Display("°/s", 1 / DEGREE)
DEGREES = Display("°", 1 / DEGREE)
PERCENT = Display("%", 1e2)
MILLIRADIAN = Display("mrad", 1e3)

# by SI unit; a unit that is not here is shown as it is
_DATA_SHEET = {
    "1": Display("ppm", 1e6),
    "1 per K": Display("ppm/K", 1e6),
    "m": Display("mm", 1e3),
    "m/s": Display("mm/s", 1e3),
    "s": Display("ms", 1e3),
    "m/s^2 per rad/s": Display("mm/s² per rad/s", 1e3),
    "m/s^2": MILLI_G,
    "m/s^2 per K": Display("mg/K", _MILLI_G),
    "m/s^2 per K^2": Display("mg/K²", _MILLI_G),
    "m/s^2 per K^3": Display("mg/K³", _MILLI_G),
    "m/s^2 per K/s": Display("mg per K/min", _MILLI_G / 60),
    "m/s^2 per s": Display("mg/h", _MILLI_G * HOUR),
    "m/s^2 per sqrt(s)": Display("mg/√s", _MILLI_G),
    "m/s^2 per (m/s^2)^2": Display("µg/g²", 1e6 * _G),
    "m/s^2 per (m/s^2)^3": Display("µg/g³", 1e6 * _G**2),
    "rad/s": DEGREE_PER_SECOND,
    "rad/s per m/s^2": Display("°/s per g", _G / DEGREE),
    "rad/s per (m/s^2)^2": Display("°/s per g²", _G**2 / DEGREE),
    "rad/s per K": Display("°/s per K", 1 / DEGREE),
    "rad/s per K^2": Display("°/s per K²", 1 / DEGREE),
    "rad/s per K^3": Display("°/s per K³", 1 / DEGREE),
    "rad/s per K/s": Display("°/s per K/min", 1 / DEGREE / 60),
    "rad/s per s": Display("°/s per h", HOUR / DEGREE),
    "rad/s per sqrt(s)": Display("°/s per √s", 1 / DEGREE),
    "rad/s per (rad/s)^2": Display("ppm per °/s", 1e6 * DEGREE),
    "rad/s per (rad/s)^3": Display("ppm per (°/s)²", 1e6 * DEGREE**2),
    "rad": DEGREES,
}
# noise coefficients, in the order of the tables
COEFFICIENTS = "QNBKR"
# by sensor and quantity of a calibration or a noise model
QUANTITIES = {
    "accelerometer": {
        "bias": MILLI_G,
        "scale": PERCENT,
        "misalignment": MILLIRADIAN,
        "Q": Display("mm/s", 1e3),
        "N": Display("µg/√Hz", _MICRO_G),
        "B": Display("µg", _MICRO_G),
        "K": Display("µg/√s", _MICRO_G),
        "R": Display("µg/h", _MICRO_G * HOUR),
    },
    "gyroscope": {
        "bias": DEGREE_PER_SECOND,
        "scale": PERCENT,
        "misalignment": MILLIRADIAN,
        "Q": Display("arcsec", HOUR / DEGREE),
        "N": Display("°/√h", HOUR**0.5 / DEGREE),
        "B": Display("°/h", _DEGREE_PER_HOUR),
        "K": Display("°/h/√h", _DEGREE_PER_HOUR * HOUR**0.5),
        "R": Display("°/h/h", _DEGREE_PER_HOUR * HOUR),
    },
}


def data_sheet(unit):
    """Return the Display in which values are shown: the unit of data sheets, or else the SI unit.

    `unit` is the SI unit of the values as text, such as ``rad/s``; None is shown as "SI".
    """
    return _DATA_SHEET.get(unit) or Display(typeset(unit or "SI"), 1.0)


def spans(values, units):
    """Return the range of values as text, a list with a text for each unit, such as 2 to 5 ppm.

    A text has the least and the greatest of the values that have this unit, to two digits. `values`
    are SI values by name, and `units` their SI units by the same names. Missing values are left
    out.
    """
    by_unit = {}
    for name, value in values.items():
        if not missing(value):
            by_unit.setdefault(units.get(name), []).append(value)
    texts = []
    for unit, sizes in by_unit.items():
        display = data_sheet(unit)
        ends = dict.fromkeys(display.size(end, 2) for end in (min(sizes), max(sizes)))
        texts.append(with_unit(" to ".join(ends), display.unit))
    return texts
