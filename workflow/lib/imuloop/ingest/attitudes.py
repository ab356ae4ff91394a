"""Attitudes and places by a reference, such as motion capture, over time."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from imuloop.core.samples import ORIENTATION, POSITION

# longest gap that a cubic bridges, s
BRIDGED = 0.05
# time over which turns are compared, s; also the largest offset of two clocks that count as one
COMPARED = 0.1


@dataclass(frozen=True)
class Reference:
    """Attitudes and places of a body over time, measured by another instrument.

    `t` are the times, s, (n,). `q` are the quaternions of the attitudes, (n, 4), scalar first, and
    `p` are the places, m, (n, 3). Values that are not known are not-a-number.
    """

    t: np.ndarray
    q: np.ndarray
    p: np.ndarray

    @property
    def has_attitude(self):
        """Mask of the samples that have an attitude, (n,) of bool."""
        return np.isfinite(self.q[:, 0])

    @property
    def has_place(self):
        """Mask of the samples that have a place, (n,) of bool."""
        return np.isfinite(self.p[:, 0])


def turns(reference, seconds=COMPARED):
    """Return the rotations of a Reference over m intervals of about `seconds`.

    The results are the start and the end of each interval, s, (m,) each, and the rotation vector
    from start to end, rad, on body axes, (m, 3). An interval begins at each sample. Intervals of
    1.5 times `seconds` or more, as over a gap, are left out.
    """
    rows = np.flatnonzero(reference.has_attitude)
    t, rotation = reference.t[rows], Rotation.from_quat(reference.q[rows], scalar_first=True)
    last = np.searchsorted(t, t + seconds)
    first = np.flatnonzero(last < len(t))
    first = first[t[last[first]] - t[first] < 1.5 * seconds]
    last = last[first]
    return t[first], t[last], (rotation[first].inv() * rotation[last]).as_rotvec()


def angles(t, w, start, end):
    """Return the integrals of the angular rate over m intervals, rad, (m, 3).

    `t` are the times of samples, s, (n,), and `w` their angular rates, rad/s, (n, 3). `start` and
    `end` are the times of the ends of the intervals, s, (m,).
    """
    total = cumulative_trapezoid(w, t, axis=0, initial=0)
    first, last = (np.column_stack([np.interp(x, t, c) for c in total.T]) for x in (start, end))
    return last - first


def at_instants(reference, t):
    """Return attitude and place of a Reference at the times `t`, s, (m,), a dict of columns, (m,).

    The columns are `ORIENTATION` and `POSITION`. Values between samples come from cubics. They are
    not-a-number in a gap longer than both `BRIDGED` and 1.5 usual steps, and in stretches of fewer
    than four samples.
    """
    longest = max(BRIDGED, 1.5 * np.median(np.diff(reference.t)))
    times, q = reference.t[reference.has_attitude], reference.q[reference.has_attitude]
    # q and -q are the same attitude: take the sign that is nearer to the quaternion before
    turned = (q[1:] * q[:-1]).sum(axis=1) < 0
    q = q * np.cumprod(np.append(1, np.where(turned, -1, 1)))[:, None]
    q = _by_cubics(t, times, q, longest)
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    p = _by_cubics(t, reference.t[reference.has_place], reference.p[reference.has_place], longest)
    return dict(zip((*ORIENTATION, *POSITION), (*q.T, *p.T), strict=True))


def _by_cubics(t, times, values, longest):
    """Return values at the times `t`, s, (m,), by cubics through n samples, (m, k).

    The samples have the `times`, s, (n,), and the `values`, (n, k). The result is not-a-number in
    gaps longer than `longest`, s, and in stretches of fewer than four samples.
    """
    at_t = np.full((len(t), values.shape[1]), np.nan)
    breaks = np.flatnonzero(np.diff(times) > longest) + 1
    for begin, end in zip([0, *breaks], [*breaks, len(times)], strict=True):
        if end - begin >= 4:
            inside = (t >= times[begin] - 1e-9) & (t <= times[end - 1] + 1e-9)
            at_t[inside] = CubicSpline(times[begin:end], values[begin:end])(t[inside])
    return at_t
