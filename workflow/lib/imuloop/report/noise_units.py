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
    """A coefficient: how it is called and which units it is shown in.

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
    r"""Return the coefficients of a sensor by their names in noise.json.

    Per sample, with r the rate: white noise has the standard deviation :math:`N \sqrt{r}`, where
    the sensor passes the whole band up to r/2; quantisation :math:`\sqrt{2} Q r`, because sample k
    is :math:`(q_{k+1} - q_k) r` with errors q of standard deviation Q; a walk steps by
    :math:`K/\sqrt{r}`, a ramp by R/r. B is no density and stays.

    Parameters
    ----------
    sensor : str
        ``accelerometer`` or ``gyroscope``.
    rate : float, optional
        Rate of the log, Hz.

    Returns
    -------
    dict of str to Quantity
        Q, N, B, K, R; q and tc of a Gauss-Markov process; amplitude and frequency of a line.
    """
    si = UNITS[sensor]
    names = {
        "Q": "Q, quantisation",
        "N": f"N, white noise ({_WHITE[sensor]})",
        "B": "B, bias instability",
        "K": f"K, {_WALK[sensor]}",
        "R": "R, ramp",
        "q": "q, drive of a Gauss–Markov process",
        "tc": "T, its correlation time",
        "amplitude": "Ω, amplitude of a line",
        "frequency": "f, its frequency",
    }
    units = NOISE_UNITS[sensor]
    level = units["B"] if sensor == "gyroscope" else (units["B"][0], MILLI_G)
    second, hertz = Display("s", 1.0), Display("Hz", 1.0)
    units = {
        **units,
        **{"q": units["K"], "tc": (second, second)},
        **{"amplitude": level, "frequency": (hertz, hertz)},
    }
    sample = {}
    if rate:
        step = Display(f"{si}, σ of a step", 1 / sqrt(rate))
        sample = {
            "Q": Display(f"{si}, σ of a sample", sqrt(2) * rate),
            "N": Display(f"{si}, σ of a sample", sqrt(rate)),
            "B": Display(f"{si}, as in SI", 1.0),
            "K": step,
            "R": Display(f"{si} a sample", 1 / rate),
            "q": step,
            "tc": Display("samples", rate),
            "amplitude": Display(f"{si}, as in SI", 1.0),
            "frequency": Display("periods a sample", 1 / rate),
        }
    return {
        key: Quantity(words, units[key][0], units[key][1:], sample.get(key))
        for key, words in names.items()
    }
