"""A bias that jumps."""

from dataclasses import dataclass

import numpy as np

from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.model.effect import Effect


def is_before(channels, time):
    """Return 1 at the samples of a log that are before `time`, s, and 0 at all others, (n,).

    `channels` are the Channels of the n samples.
    """
    return (channels.t < time).astype(float)


@dataclass(frozen=True)
class Steps(Effect):
    """``e_i = Σ_k h_ki H(t - t_k)``: the bias jumps at the times t_k; H is the unit step.

    h_ki is the height of jump k on axis i, and t the time since the start of the log. At poses only
    one step in the log of one session is tested, with ``e_i = h_i (H(t - t_1) - 1)``: the bias b is
    then the bias after the step, which later logs have.
    Leaves this trace: the means over poses, or of a static record, jump. Imitated by: a device that
    was moved, which tilts an accelerometer; random walk, which the test allows for as part of the
    noise.

    Attributes
    ----------
    times : tuple of float
        The times t_k, s from the start of the log.
    sessions : tuple of str
        Name of the session of each step.
    spans : tuple of float
        Length, s, of a span without data about each time. The step may lie anywhere in the span, so
        the expected value of H is used, which rises linearly from 0 to 1 over the span.
    """

    times: tuple[float, ...] = (0.0,)
    sessions: tuple[str, ...] = ("",)
    spans: tuple[float, ...] = (0.0,)

    name = "steps"
    reference = "IEEE Std 1293-2018, burst noise (telegraph noise)"
    timed = True
    records = ("poses", "static_record")
    lasting = False

    @property
    def parameters(self):
        """Units of the parameters by name: each axis of the first step, then of the next.

        ``output`` stands for the SI unit of the sensor.
        """
        return per_axis({f"h{k}": "output" for k in range(1, len(self.times) + 1)})

    @classmethod
    def variants(cls, channels):
        """Return an empty tuple: the times of steps come from a scan of the record instead.

        So the `channels` are not used.
        """
        return ()

    def design(self, channels):
        """Return the derivative of e with respect to h at n poses or samples, (n, 3, 3 k).

        e is the error of the class' equation, with the k steps of heights h at the times t_k; H is
        the unit step. For step k the derivative is ``H(t - t_k) - 1`` on each axis: -1 before the
        step and 0 after it. At a pose it is the mean over the samples of the pose. The axes of the
        result are: n points of `channels`, axis of the sensor, parameter.
        """
        return on_each_axis(*(-channels.evaluate(is_before, t) for t in self.times))

    def in_session(self, channels, session, windows):
        """Return the derivative of the mean output in n windows by the heights h, (n, 3, 3 k).

        There are k steps, each with a height h for each axis. For a step the derivative is, on each
        axis, the share of each window that lies after the step; it is zero for a step of another
        session. `session` is the name of the session. `windows`, (n, 2), has start and end of each
        window, s. The Channels `channels` are not used.
        """
        is_here = [name == session for name in self.sessions]
        return on_each_axis(*(share_after(windows, self.times, self.spans) * is_here).T)


def share_after(windows, times, spans=0.0):
    """Return the share of each of n windows that lies after each of k times, (n, k), from 0 to 1.

    If a time is known only within a span, the result is the mean of the share over all times in the
    span. It is exact for a window that lies in the span, contains it or lies outside it, and an
    approximation for a window that reaches over one end of the span. `windows`, (n, 2), has start
    and end of each window, s; `times`, (k,), are in s; and `spans`, (k,), are the lengths of the
    spans about the times, s, by default zero.
    """
    middle = windows.mean(axis=1, keepdims=True)
    # the share rises linearly; a sample is a window of length zero
    length = np.maximum(np.maximum(np.diff(windows, axis=1), spans), 1e-12)
    return np.clip((middle - times) / length + 0.5, 0, 1)


def joined(steps):
    """Return one Steps that has all jumps of several, `steps`, in order of session and time."""
    jumps = (jump for s in steps for jump in zip(s.sessions, s.times, s.spans, strict=True))
    sessions, times, spans = zip(*sorted(jumps), strict=True)
    return Steps(times=times, sessions=sessions, spans=spans)
