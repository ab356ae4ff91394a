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

    `t` are the times of n samples, s, (n,). `q` are the unit quaternions of the attitudes, (n, 4),
    scalar first, which rotate from body to world once the declared convention is applied. `p` are
    the places, x, y, z on axes of the world, m, (n, 3). Values that are not known are not-a-number.
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
    """Return the rotations of a body over m short intervals, by a Reference, to test the gyroscope.

    The three results are the starts of the intervals, s, (m,), their ends, s, (m,), and the
    rotation vectors from start to end, rad, on axes of the body, (m, 3). An interval begins at each
    sample of `reference` with an attitude. It ends at the first such sample that is at least
    `seconds` later. Intervals of 1.5 times `seconds` or more, as over a gap, are left out.
    """
    rows = np.flatnonzero(reference.has_attitude)
    t, rotation = reference.t[rows], Rotation.from_quat(reference.q[rows], scalar_first=True)
    last = np.searchsorted(t, t + seconds)
    first = np.flatnonzero(last < len(t))
    first = first[t[last[first]] - t[first] < 1.5 * seconds]
    last = last[first]
    return t[first], t[last], (rotation[first].inv() * rotation[last]).as_rotvec()


def angles(t, w, start, end):
    """Return the integrals of the angular rate over m intervals, trapezoidal, rad, (m, 3).

    The second axis is x, y, z of the sensor. `t` are the times of n samples, s, (n,), and `w` their
    angular rates, rad/s, (n, 3). `start` and `end` are the times at which the intervals start and
    end, s, (m,) each.
    """
    total = cumulative_trapezoid(w, t, axis=0, initial=0)
    first, last = (np.column_stack([np.interp(x, t, c) for c in total.T]) for x in (start, end))
    return last - first


def at_instants(reference, t):
    """Return attitude and place by a Reference at other times, a dict of columns, (m,) each.

    The m times are `t`, s, (m,), on the clock of `reference`. The columns are `ORIENTATION`, a
    quaternion, and `POSITION`, m. Values between samples come from cubic splines. They are
    not-a-number in a gap longer than both `BRIDGED`, s, and 1.5 usual steps of the samples, and in
    parts between gaps with fewer than four samples.
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
    """Return values at other times, (m, k), by cubic splines through n samples of k quantities.

    `t` are the m times, s, (m,). The samples have the `times`, s, (n,), and the `values`, (n, k).
    The result is not-a-number in gaps longer than `longest`, s, and in parts between gaps with
    fewer than four samples.
    """
    at_t = np.full((len(t), values.shape[1]), np.nan)
    breaks = np.flatnonzero(np.diff(times) > longest) + 1
    for begin, end in zip([0, *breaks], [*breaks, len(times)], strict=True):
        if end - begin >= 4:
            inside = (t >= times[begin] - 1e-9) & (t <= times[end - 1] + 1e-9)
            at_t[inside] = CubicSpline(times[begin:end], values[begin:end])(t[inside])
    return at_t
