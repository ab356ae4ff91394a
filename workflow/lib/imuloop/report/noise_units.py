"""The noise coefficients in three systems of units: SI, data sheets, per sample."""

from dataclasses import dataclass
from math import sqrt

from imuloop.report.numbers import MILLI_G, NOISE_UNITS, Display
from imuloop.report.results import UNITS

# in the order of the tables
COEFFICIENTS = "QNBKR"
_WALK = {"accelerometer": "acceleration random walk", "gyroscope": "rate random walk"}
_WHITE = {"accelerometer": "velocity random walk", "gyroscope": "angle random walk"}


@dataclass(frozen=True)
class Quantity:
    """A coefficient: how it is called, and the units it is shown in.

    Attributes
    ----------
    words : str
        Letter and name.
    si : Display
        SI unit.
    sheet : tuple of Display
        Units of data sheets, the usual one first.
    sample : Display or None
        What it is for a filter that runs at the logged rate; None where the rate is not known.
    """

    words: str
    si: Display
    sheet: tuple[Display, ...]
    sample: Display | None


def quantities(sensor, rate=None):
    r"""Return the `Quantity` of each coefficient of a sensor by its name in noise.json.

    Per sample, with r the rate of the log, Hz: white noise has the standard deviation
    :math:`N \sqrt{r}`, where the sensor passes the whole band up to r/2; quantisation
    :math:`\sqrt{2} Q r`, because sample k is :math:`(q_{k+1} - q_k) r` with errors q of standard
    deviation Q; a walk steps by :math:`K/\sqrt{r}`, a ramp by R/r. B is no density and stays.
    """
    si, units = UNITS[sensor], NOISE_UNITS[sensor]
    level = units["B"] if sensor == "gyroscope" else (units["B"][0], MILLI_G)
    second, hertz = Display("s", 1.0), Display("Hz", 1.0)
    r = rate or 1.0
    step, same = Display(f"{si}, σ of a step", 1 / sqrt(r)), Display(f"{si}, as in SI", 1.0)
    found = {
        "Q": ("Q, quantisation", units["Q"], Display(f"{si}, σ of a sample", sqrt(2) * r)),
        "N": (
            f"N, white noise ({_WHITE[sensor]})",
            units["N"],
            Display(f"{si}, σ of a sample", sqrt(r)),
        ),
        "B": ("B, bias instability", units["B"], same),
        "K": (f"K, {_WALK[sensor]}", units["K"], step),
        "R": ("R, ramp", units["R"], Display(f"{si} per sample", 1 / r)),
        "q": ("q, drive of a Gauss–Markov process", units["K"], step),
        "tc": ("T, its correlation time", (second, second), Display("samples", r)),
        "amplitude": ("Ω, amplitude of a line", level, same),
        "frequency": ("f, its frequency", (hertz, hertz), Display("periods per sample", 1 / r)),
    }
    return {
        key: Quantity(words, unit[0], unit[1:], sample if rate else None)
        for key, (words, unit, sample) in found.items()
    }
