"""The units that people think in, and how many of each an SI unit is."""

from dataclasses import dataclass

from imuloop.core.units import DEGREE, HOUR, STANDARD_GRAVITY
from imuloop.report.numbers import missing, number, typeset, with_unit


@dataclass(frozen=True)
class Display:
    """A unit as printed, and how many of it an SI unit is: ``shown = SI * factor``."""

    unit: str
    factor: float

    def size(self, value, digits=3):
        """Return an SI value, of which there may be none, as a number in this unit."""
        return number(None if missing(value) else value * self.factor, digits)

    def text(self, value, digits=3):
        """Return the same with the unit."""
        return with_unit(self.size(value, digits), self.unit)


_G, _MILLI_G, _MICRO_G = STANDARD_GRAVITY, 1e3 / STANDARD_GRAVITY, 1e6 / STANDARD_GRAVITY
_DEGREE_PER_HOUR = HOUR / DEGREE

MILLI_G = Display("mg", _MILLI_G)
DEGREE_PER_SECOND = Display("°/s", 1 / DEGREE)
DEGREES = Display("°", 1 / DEGREE)
PERCENT = Display("%", 1e2)
MILLIRADIAN = Display("mrad", 1e3)

# of a residual, by its SI unit
RESIDUAL = {
    "m/s^2": MILLI_G,
    "rad/s": DEGREE_PER_SECOND,
    "rad": DEGREES,
    "m/s": Display("mm/s", 1e3),
}
# of an effect's parameter, by its SI unit; what is not here is shown in SI
_DATA_SHEET = {
    "1": Display("ppm", 1e6),
    "1 per K": Display("ppm/K", 1e6),
    "m": Display("mm", 1e3),
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
# of the noise coefficients: SI, then those of data sheets, the usual one first
_NOISE = {
    "accelerometer": {
        "Q": (("m/s", 1.0), ("mm/s", 1e3)),
        "N": (("m/s²/√Hz", 1.0), ("µg/√Hz", _MICRO_G), ("m/s/√h", HOUR**0.5)),
        "B": (("m/s²", 1.0), ("µg", _MICRO_G)),
        "K": (("m/s³/√Hz", 1.0), ("µg/√s", _MICRO_G)),
        "R": (("m/s³", 1.0), ("µg/h", _MICRO_G * HOUR)),
        "amplitude": (("m/s²", 1.0), ("mg", _MILLI_G)),
    },
    "gyroscope": {
        "Q": (("rad", 1.0), ("arcsec", HOUR / DEGREE)),
        "N": (("rad/s/√Hz", 1.0), ("°/√h", HOUR**0.5 / DEGREE), ("°/s/√Hz", 1 / DEGREE)),
        "B": (("rad/s", 1.0), ("°/h", _DEGREE_PER_HOUR)),
        "K": (("rad/s²/√Hz", 1.0), ("°/h/√h", _DEGREE_PER_HOUR * HOUR**0.5)),
        "R": (("rad/s²", 1.0), ("°/h/h", _DEGREE_PER_HOUR * HOUR)),
        "amplitude": (("rad/s", 1.0), ("°/h", _DEGREE_PER_HOUR)),
    },
}
# in the order of the tables
COEFFICIENTS = "QNBKR"


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
        ends = dict.fromkeys(number(f(sizes) * display.factor, 2) for f in (min, max))
        texts.append(with_unit(" to ".join(ends), display.unit))
    return texts


@dataclass(frozen=True)
class Quantity:
    """A noise coefficient: letter and name, its unit in SI, those of data sheets, usual first."""

    words: str
    si: Display
    sheet: tuple[Display, ...]


def quantities(sensor):
    """Return the `Quantity` of each coefficient of a sensor by its name in noise.json."""
    units = _NOISE[sensor]
    units = units | {"q": units["K"], "tc": (("s", 1.0),) * 2, "frequency": (("Hz", 1.0),) * 2}
    walk, white = (
        ("acceleration random walk", "velocity random walk")
        if sensor == "accelerometer"
        else ("rate random walk", "angle random walk")
    )
    found = {
        "Q": "Q, quantisation",
        "N": f"N, white noise ({white})",
        "B": "B, bias instability",
        "K": f"K, {walk}",
        "R": "R, ramp",
        "q": "q, drive of a Gauss–Markov process",
        "tc": "T, its correlation time",
        "amplitude": "Ω, amplitude of a line",
        "frequency": "f, its frequency",
    }
    result = {}
    for key, words in found.items():
        shown, *sheet = (Display(*each) for each in units[key])
        result[key] = Quantity(words, shown, tuple(sheet))
    return result
