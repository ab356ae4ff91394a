"""A log as it is to be written and declared, and what draws of it need."""

from dataclasses import dataclass, field

import numpy as np

from imuloop.core.units import DEGREE, STANDARD_GRAVITY

# most rows of a log: a case is to take a second or two
MOST_ROWS = 8_000
SENSORS = ("acceleration", "angular_rate")
KINDS = ("static", "six_position", "multi_position")
UNITS = {
    "acceleration": {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1000},
    "angular_rate": {"rad/s": 1.0, "deg/s": DEGREE, "mrad/s": 1e-3, "deg/h": DEGREE / 3600},
}


@dataclass
class Log:
    """A session as it is to be logged and declared.

    Attributes
    ----------
    kind : str
        As declared.
    t : ndarray, shape (n,)
        s.
    x : dict of str to ndarray, shape (n, 3)
        ``acceleration``, m/s^2, and ``angular_rate``, rad/s.
    temperature : ndarray, shape (n,), or None
        degC.
    count : dict
        ``scale`` and ``offset`` of one count by quantity.
    written, declared : dict
        Unit by quantity.
    rate : float or None
        As declared, Hz; the log has no time column then.
    lines : list of (float, str)
        Lines that do not belong into a text log: where, as a share of its rows, and what.
    """

    kind: str
    t: np.ndarray
    x: dict
    temperature: np.ndarray | None
    count: dict
    written: dict
    declared: dict
    rate: float | None = None
    lines: list = field(default_factory=list)

    def __len__(self):
        return len(self.t)

    def take(self, rows):
        """Keep some rows."""
        self.t = self.t[rows]
        self.x = {sensor: values[rows] for sensor, values in self.x.items()}
        if self.temperature is not None:
            self.temperature = self.temperature[rows]

    @property
    def step(self):
        """Median step of time, s; 1 where there is none."""
        steps = np.diff(self.t)
        steps = steps[steps > 0]
        return float(np.median(steps)) if len(steps) else 1.0

    def restamp(self):
        """Stamp the rows one after the other, without a gap."""
        self.t = np.arange(len(self)) * self.step


def some(rng, log, most=0.3):
    """Return which rows are in one to four stretches."""
    rows = np.zeros(len(log), dtype=bool)
    for _ in range(rng.integers(1, 5)):
        first = rng.integers(0, len(log) + 1)
        rows[first : first + int(len(log) * most * rng.random() ** 2) + 1] = True
    return rows


def size(rng, low, high):
    """Return a number between two, any order of size alike."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def middle(rng, log):
    """Return a row in the inner part of a log."""
    return int(len(log) * rng.uniform(0.1, 0.9))


def sensor_of(rng):
    return SENSORS[rng.integers(2)]
