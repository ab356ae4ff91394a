"""Units of effects' parameters as data sheets give them, by the SI units that effects name."""

from imuloop.core.units import DEGREE, HOUR, STANDARD_GRAVITY
from imuloop.report.numbers import (
    DEGREE_PER_SECOND,
    DEGREES,
    MILLI_G,
    Display,
    missing,
    number,
    typeset,
    with_unit,
)

_G, _MILLI_G = STANDARD_GRAVITY, 1e3 / STANDARD_GRAVITY
# an effect whose unit is not here is shown in SI
_DATA_SHEET = {
    "1": Display("ppm", 1e6),
    "1 per K": Display("ppm/K", 1e6),
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


def data_sheet(unit):
    """Return the unit to show values of a parameter in, given its SI unit."""
    return _DATA_SHEET.get(unit) or Display(typeset(unit or "SI"), 1.0)


def spans(values, units):
    """Return the least and greatest of values (SI, by name) that share a unit, two digits each."""
    found = {}
    for name, value in values.items():
        if not missing(value):
            found.setdefault(units.get(name), []).append(value)
    texts = []
    for unit, sizes in found.items():
        display = data_sheet(unit)
        low, high = (number(size * display.factor, 2) for size in (min(sizes), max(sizes)))
        text = low if low == high else f"{low} to {high}"
        texts.append(with_unit(text, display.unit))
    return texts
