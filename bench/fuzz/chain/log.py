"""A log as it is to be written and declared, and what draws of it need."""

from dataclasses import dataclass, field

import numpy as np

from imuloop.core import units

# most rows of a log: a case is to take a second or two
MOST_ROWS = 8_000
SENSORS = ("acceleration", "angular_rate")
KINDS = ("static", "six_position", "multi_position")
UNITS = {"acceleration": units.ACCELERATION, "angular_rate": units.ANGULAR_RATE}


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
