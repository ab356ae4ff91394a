"""A line of one frequency."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import AXES, on_each_axis


@dataclass(frozen=True)
class Sinusoid(Effect):
    """``e_i = c_i cos(2π f t) + s_i sin(2π f t)``: a line of one frequency f, Hz.

    Each session that has it has its own phase, hence its own c and s. Leaves: a hump of the Allan
    curve near 0.37/f with nulls at k/f. Imitated by: `gauss_markov` where the record holds a few
    periods.
    """

    frequency: float = 1.0
    sessions: tuple[str, ...] = ("",)

    name = "sinusoid"
    equation = "e_i = c_i cos(2π f t) + s_i sin(2π f t)"
    reference = "IEEE Std 952-1997, annex C, sinusoidal noise"
    records = ("static_record",)
    lasting = False

    @property
    def parameters(self):
        """Names and units, session after session, all axes of the cosine first."""
        ends = [""] if len(self.sessions) == 1 else [f"_{s}" for s in self.sessions]
        return {f"{part}{axis}{end}": "output" for end in ends for part in "cs" for axis in AXES}

    def together(self, name):
        """Return the same parameter of every session: a line recurs."""
        return tuple(p for p in self.parameters if p[:2] == name[:2])

    def in_session(self, channels, session, windows):
        """Return the means of cosine and sine over windows (n, 2), shape (n, 3, 6 sessions)."""
        length = windows[:, 1] - windows[:, 0]
        phase = np.pi * self.frequency * windows.sum(axis=1)
        mean = np.sinc(self.frequency * length)
        waves = mean * np.cos(phase), mean * np.sin(phase)
        return on_each_axis(*(w * (s == session) for s in self.sessions for w in waves))
