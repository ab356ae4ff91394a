"""A bias that jumps."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis


def before(channels, time):
    """Return whether samples of a whole log come before a time, 1 or 0, shape (n,)."""
    return (channels.t < time).astype(float)


@dataclass(frozen=True)
class Steps(Effect):
    """``e_i = Σ_k h_ki H(t - t_k)``: the bias jumps at the times t_k, H the unit step.

    At poses one is looked for, in the log of one session, and ``e_i = h_i (H(t - t_1) - 1)``: b is
    the bias after it, which later logs have.
    Leaves: levels that change at once. Imitated by: a device that was moved, which tilts an
    accelerometer; random walk, which the noise of the test allows for.

    Attributes
    ----------
    times, sessions : tuple of float, tuple of str
        t_k, s from the start of the log, and the session of each.
    spans : tuple of float
        Length of the span, s, about each time in which nobody looked: the step may lie anywhere
        in it, and the expected value counts, which goes up evenly.
    """

    times: tuple[float, ...] = (0.0,)
    sessions: tuple[str, ...] = ("",)
    spans: tuple[float, ...] = (0.0,)

    name = "steps"
    equation = "e_i = Σ_k h_ki H(t - t_k)"
    reference = "IEEE Std 1293-2018, burst noise (telegraph noise)"
    timed = True
    records = ("poses", "static_record")
    lasting = False

    @property
    def parameters(self):
        """Names and units, all axes of the first step first."""
        return per_axis({f"h{k}": "output" for k in range(1, len(self.times) + 1)})

    @classmethod
    def shapes(cls, channels):
        """Return none: a scan of the record finds the times."""
        return ()

    def design(self, channels):
        """Return ``H(t - t_k) - 1`` on each axis, its mean over a pose, shape (n, 3, 3 k)."""
        return on_each_axis(*(-channels.evaluate(before, t) for t in self.times))

    def in_session(self, channels, session, windows):
        """Return the share of windows, shape (n, 2), after each step, shape (n, 3, 3 k)."""
        steps = zip(self.times, self.sessions, self.spans, strict=True)
        return on_each_axis(*(share_after(windows, t, x) * (s == session) for t, s, x in steps))


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
    parts = (zip(one.sessions, one.times, one.spans, strict=True) for one in steps)
    sessions, times, spans = zip(*sorted(part for one in parts for part in one), strict=True)
    return Steps(times, sessions, spans)
