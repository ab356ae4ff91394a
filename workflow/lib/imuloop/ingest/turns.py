"""How far the angular rate turns a device beside how far gravity turns in its axes."""

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE

# turning angle by rate over that by force, of steps of this time (s) and of at least so much
# (rad), so many of them: between rotation about the vertical and a wrong unit lies a factor
TURN_TIME, LEAST_TURN, LEAST_TURNS, PLAUSIBLE_RATIO = 0.5, 0.1, 10, (0.2, 15.0)


class Turns:
    """How far the angular rate turns the device, beside how far gravity turns in its axes."""

    # decades of the ratio
    edges = np.linspace(-8, 8, 321)

    def __init__(self, rate):
        self.rows, self.dt = max(round(TURN_TIME * rate), 1), 1 / rate
        self.counts = np.zeros(len(self.edges) - 1, dtype=int)

    def add(self, x):
        """Take in a row group."""
        m = len(x["ax"]) // self.rows
        force, rate = (
            np.array([x[n][: m * self.rows].reshape(m, self.rows).mean(axis=1) for n in axes])
            for axes in (ACCELERATION, ANGULAR_RATE)
        )
        size = np.sqrt((force**2).sum(axis=0))
        # where gravity is most of the force
        steady = np.abs(size / np.median(size) - 1) < 0.2 if m else size > 0
        force = force / np.where(size > 0, size, 1.0)
        angle = 2 * np.arcsin(np.minimum(np.sqrt((np.diff(force) ** 2).sum(axis=0)) / 2, 1))
        turn = np.sqrt(((rate[:, 1:] + rate[:, :-1]) ** 2).sum(axis=0)) / 2 * self.rows * self.dt
        used = steady[1:] & steady[:-1] & (angle > LEAST_TURN)
        decades = np.clip(np.log10(turn[used] / angle[used]), -7.99, 7.99)
        self.counts += np.histogram(decades, self.edges)[0]

    def ratio(self):
        """Return the median ratio; None where the device hardly turns."""
        n = self.counts.sum()
        if n < LEAST_TURNS:
            return None
        i = np.searchsorted(np.cumsum(self.counts), n / 2)
        return float(10 ** (self.edges[i : i + 2].mean()))
