"""An effect composed by a search: a sum of products of logged quantities."""

import re
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.memory import first_order_lag, in_pieces
from imuloop.effects.axes import AXES
from imuloop.effects.mechanics import WINDOW, vibration
from imuloop.effects.temperature import ROOM, lagged_rate, temperature

# rad/s; faster is a turn
TURNING = 0.15
# s; mean rate over the end of a turn, with its sense
TURN = 3.0
# s; lag of the rate of temperature
LAG = 30.0
# SI unit of each factor, by its letter; v is the rate of the last turn, q a mean square vibration
UNITS = {"f": "m/s^2", "w": "rad/s", "T": "K", "R": "K/s", "t": "s", "s": "", "v": "rad/s"}
# what a factor with a letter stands for, for readers
MEANINGS = {
    "f": "specific force",
    "w": "angular rate",
    "T": "temperature less {reference_temperature:.4g} degC",
    "R": f"rate of the temperature through a lag of {LAG:g} s",
    "t": "time since the start of the log",
    "s": "exp(-time since the last turn / the number of seconds)",
    "v": f"mean rate over the last {TURN:g} s of the last turn",
    "q": "mean square of the sensor's own vibration",
}
_FACTOR = re.compile(r"(abs_)?([fwvq][xyz]|[TRt]|s[1-9]\d*)(?:\^(\d))?")


def _rate(channels, sensor):
    return channels.other if sensor == "accelerometer" else channels.output


def _last_turn(channels, rate, values):
    """Return when the last turn ended, s, (n,), and values, (n, m), at that time.

    Before the first turn of a log that is -inf, and zero.
    """
    t, past = channels.t, channels.past
    end, last = -np.inf, np.zeros(values.shape[1])
    if past is not None and "t" in past:
        k = max(np.searchsorted(past["t"], t[0]) - 1, 0)
        end, last = past["end"][k], past["last"][k]
    k = np.where(np.linalg.norm(rate, axis=1) > TURNING, np.arange(len(t)), -1)
    k = np.maximum.accumulate(k)
    end = np.where(k >= 0, t[k], end)
    last = np.where(k[:, None] >= 0, values[k], last)
    if past is not None:
        past.update(t=t, end=end, last=last)
    return end, last


@in_pieces
def settling(channels, sensor, tau):
    """Return ``exp(-s/τ)``, (n,), s the time since the last turn: zero before the first."""
    rate = _rate(channels, sensor)
    return np.exp((_last_turn(channels, rate, rate)[0] - channels.t) / tau)


@in_pieces
def turn_rate(channels, sensor):
    """Return the mean rate at the end of the last turn, rad/s, (n, 3): zero before the first."""
    rate, past = _rate(channels, sensor), channels.past
    lag = None if past is None else past.setdefault("lag", {})
    return _last_turn(channels, rate, first_order_lag(channels.t, rate, TURN, lag))[1]


def parse(formula):
    """Return (axis, ((factor, power, whether absolute), …)) of each term of a formula.

    A formula is ``x: fy^2*fz; z: wx*T``. Raises ValueError for anything else.
    """
    terms = []
    for text in filter(None, (part.strip() for part in formula.split(";"))):
        axis, _, product = text.partition(": ")
        matches = [_FACTOR.fullmatch(factor) for factor in product.split("*")]
        if axis not in tuple(AXES) or not all(matches):
            raise ValueError(f"'{text[:60]}' is no term of a formula, as x: fy^2*fz is")
        factors = ((m[2], int(m[3] or 1), bool(m[1])) for m in matches)
        terms.append((AXES.index(axis), tuple(factors)))
    return tuple(terms)


@dataclass(frozen=True)
class Discovered(Effect):
    """``e_i = Σ_k c_k Π_j x_j^p``: products of logged quantities, composed by a search.

    Factors: f and w specific force and angular rate on x, y, z, one of them the sensor's own
    output; T temperature less `reference_temperature`; R its rate; t time since the start of the
    log; s3, s12 … exp(-time since the last turn/3 s …); v the rate of the last turn; q the mean
    square of the sensor's vibration; ``abs_`` an absolute value.
    Leaves: what no effect with a physical reason explains. Imitated by: see `diagnosis.json`.
    """

    formula: str = ""
    sensor: str = "accelerometer"
    reference_temperature: float = ROOM

    name = "discovered"
    equation = "e_i = Σ_k c_k Π_j x_j^p"
    reference = "a search of this device's residual; no physical reason is known"
    # looked for by `imuloop.discover` alone
    records = ()
    reach = WINDOW

    def __post_init__(self):
        if not isinstance(self.formula, str) or self.sensor not in ("accelerometer", "gyroscope"):
            raise ValueError("it needs a formula and a sensor")
        parse(self.formula)
        # without a vibration it looks at the sample alone
        object.__setattr__(self, "reach", WINDOW if "q" in self.letters else 0.0)
        object.__setattr__(self, "needs", ("temperature",) if self.letters & set("TR") else ())
        object.__setattr__(self, "sensors", (self.sensor,))
        # at rest what goes with the time since the start of one log says nothing of the next
        object.__setattr__(self, "lasting", "t" not in self.letters)

    @cached_property
    def terms(self):
        """Axis and factors of each term."""
        return parse(self.formula)

    @cached_property
    def letters(self):
        """Letters of all factors."""
        return {factor[0] for _, product in self.terms for factor, _, _ in product}

    @property
    def degree(self):
        """Largest sum of powers in a term; an absolute value is even, and counts as a square."""
        return max(sum(power + absolute for _, power, absolute in p) for _, p in self.terms)

    @property
    def complexity(self):
        """Degree, and longest time constant, s: the order in which formulas are preferred.

        One that is longer than the rests says of the bias what none of them shows.
        """
        factors = (f for _, product in self.terms for f, _, _ in product)
        return self.degree, max((int(f[1:]) for f in factors if f[0] == "s"), default=0)

    @property
    def parameters(self):
        """Names and units of the coefficients."""
        return {f"c{k}{AXES[i]}": unit(factors) for k, (i, factors) in enumerate(self.terms)}

    @property
    def timed(self):
        """Whether it depends on the log's past."""
        return bool(self.letters & set("Rtsvq"))

    def design(self, channels):
        """Return the products, each on the axis of its term, shape (n, 3, p)."""
        factor_of = cache(lambda factor: self._factor(factor, channels))

        @cache
        def product(factors):
            values = np.ones(len(channels.t))
            for factor, power, absolute in factors:
                x = factor_of(factor)
                values = values * (np.abs(x) if absolute else x) ** power
            return values

        design = np.zeros((len(channels.t), 3, len(self.terms)))
        for k, (axis, factors) in enumerate(self.terms):
            design[:, axis, k] = product(factors)
        return design

    def _factor(self, factor, channels):
        letter, rest = factor[0], factor[1:]
        if letter == "T":
            return temperature(channels) - self.reference_temperature
        if letter == "R":
            return channels.remembered(lagged_rate, LAG)
        if letter == "t":
            return channels.t
        if letter == "s":
            return channels.remembered(settling, self.sensor, int(rest))
        if letter == "q":
            vectors = channels.remembered(vibration)
        elif letter == "v":
            vectors = channels.remembered(turn_rate, self.sensor)
        else:
            is_own = (letter == "f") == (self.sensor == "accelerometer")
            vectors = channels.output if is_own else channels.other
        return vectors[:, AXES.index(rest)]


def unit(factors):
    """Return the unit of a coefficient that multiplies factors."""
    powers = {}
    for factor, power, _ in factors:
        # a mean square vibration has the unit of the sensor's output, squared
        one, times = ("output", 2) if factor[0] == "q" else (UNITS[factor[0]], 1)
        powers[one] = powers.get(one, 0) + power * times
    powers.pop("", None)
    parts = [f"({u})^{p}" if p > 1 else u for u, p in powers.items()]
    if not parts:
        return "output"
    return f"output per ({' '.join(parts)})" if parts[1:] else f"output per {parts[0]}"
