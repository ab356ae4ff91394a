"""What a static record alone shows: a ramp, steps, a line, noise with a correlation time.

They are effects of the library, but none goes into a calibration: the next record has others.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imuloop.core.effect import Effect
from imuloop.diagnose.effects.axes import AXES, on_each_axis, per_axis


@dataclass(frozen=True)
class Ramp(Effect):
    """``e_i = d_i t``: the bias changes evenly with time, from the start of each log.

    The same as `bias_drift` between poses. Imitated by: `bias_temperature` where the temperature
    only rises or falls, a long `warm_up`, and random walk, which the noise of the test allows for.
    """

    name = "ramp"
    sensors = ("accelerometer", "gyroscope")
    parameters: ClassVar = per_axis({"d": "output per s"})
    equation = "e_i = d_i t"
    reference = "IEEE Std 952-1997, annex C, rate ramp"
    records = ("static_record",)

    def design(self, channels):
        """Return the time on each axis, shape (n, 3, 3)."""
        return on_each_axis(channels.t)


@dataclass(frozen=True)
class Steps(Effect):
    """``e_i = Σ_k h_ki H(t - t_k)``: the bias jumps at the times t_k, H the unit step.

    Leaves: levels that change at once. Imitated by: a device that was moved, which tilts an
    accelerometer; random walk, which the noise of the test allows for.

    Attributes
    ----------
    times : tuple of float
        t_k, s from the start of the log.
    sessions : tuple of str
        The session of each.
    spans : tuple of float
        Length of the span, s, about each time in which nobody looked. The step may lie anywhere in
        it: there the expected value counts, which goes up evenly.
    """

    times: tuple[float, ...] = (0.0,)
    sessions: tuple[str, ...] = ("",)
    spans: tuple[float, ...] = (0.0,)

    name = "steps"
    sensors = ("accelerometer", "gyroscope")
    equation = "e_i = Σ_k h_ki H(t - t_k)"
    reference = "IEEE Std 1293-2018, burst noise (telegraph noise)"
    records = ("static_record",)

    @property
    def parameters(self):
        """Names and units, all axes of the first step first."""
        return per_axis({f"h{k}": "output" for k in range(1, len(self.times) + 1)})

    @classmethod
    def shapes(cls, channels):
        """Return none: the times are searched."""
        return ()

    def in_session(self, session, windows):
        """Return the share of windows, shape (n, 2), after each step, shape (n, 3, 3 k)."""
        after = [
            share_after(windows, t, span) * (s == session)
            for t, s, span in zip(self.times, self.sessions, self.spans, strict=True)
        ]
        return on_each_axis(*after)


def share_after(windows, t, span=0.0):
    """Return the share of windows, shape (n, 2), after times t: shape (n,), or (n, k) for k times.

    Where a time is known to a span only, the mean of the share over the span, for windows that lie
    whole in it or out of it.
    """
    start, end = windows.T
    length = np.maximum(np.maximum(end - start, span), 1e-12)
    return np.clip((np.subtract.outer((start + end) / 2, t).T / length + 0.5).T, 0, 1)


def joined(steps):
    """Return several steps as one effect, in order of session and time."""
    parts = sorted(
        part for one in steps for part in zip(one.sessions, one.times, one.spans, strict=True)
    )
    sessions, times, spans = zip(*parts, strict=True)
    return Steps(times, sessions, spans)


@dataclass(frozen=True)
class Sinusoid(Effect):
    """``e_i = c_i cos(2π f t) + s_i sin(2π f t)``: a line of one frequency f.

    Each session has its own phase, hence its own c and s. Leaves: a hump of the Allan curve near
    0.37/f with nulls at k/f. Imitated by: `gauss_markov` where the record holds a few periods.

    Attributes
    ----------
    frequency : float
        f, Hz.
    sessions : tuple of str
        The sessions that have it.
    """

    frequency: float = 1.0
    sessions: tuple[str, ...] = ("",)

    name = "sinusoid"
    sensors = ("accelerometer", "gyroscope")
    equation = "e_i = c_i cos(2π f t) + s_i sin(2π f t)"
    reference = "IEEE Std 952-1997, annex C, sinusoidal noise"
    records = ("static_record",)

    @property
    def parameters(self):
        """Names and units, session after session, all axes of the cosine first."""
        ends = [""] if len(self.sessions) == 1 else [f"_{s}" for s in self.sessions]
        return {f"{part}{axis}{end}": "output" for end in ends for part in "cs" for axis in AXES}

    @classmethod
    def shapes(cls, channels):
        """Return none: the frequency is searched."""
        return ()

    def in_session(self, session, windows):
        """Return the means of cosine and sine over windows (n, 2), shape (n, 3, 6 sessions)."""
        length = windows[:, 1] - windows[:, 0]
        phase = np.pi * self.frequency * windows.sum(axis=1)
        mean = np.sinc(self.frequency * length)
        waves = mean * np.cos(phase), mean * np.sin(phase)
        return on_each_axis(*(w * (s == session) for s in self.sessions for w in waves))


@dataclass(frozen=True)
class GaussMarkov(Effect):
    """``dx_i/dt = -x_i/Tc + q_i·(white noise of density 1)``: noise with a correlation time.

    It has no pattern that could be subtracted: it is a term of the noise, ``covariance
    (q² Tc/2) exp(-|d|/Tc)``, beside white noise, flicker and walk. Leaves: a hump of the Allan
    curve at 1.89 Tc. Imitated by: `sinusoid` where the record holds a few periods; flicker.

    Attributes
    ----------
    tc : float
        Correlation time Tc, s.
    """

    tc: float = 1.0

    name = "gauss_markov"
    sensors = ("accelerometer", "gyroscope")
    parameters: ClassVar = per_axis({"q": "output per sqrt(s)"})
    equation = "dx_i/dt = -x_i/Tc + q_i·white, x_i added to the output"
    reference = "IEEE Std 952-1997, annex C, exponentially correlated noise"
    records = ("static_record",)

    @classmethod
    def shapes(cls, channels):
        """Return none: it has no pattern."""
        return ()
