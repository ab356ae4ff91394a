"""Attitudes and places of a reference over time: turns between them, values at instants."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from imuloop.core.samples import ORIENTATION, POSITION

# s; up to here lost samples are bridged by a cubic
BRIDGED = 0.05
# s over which turns are compared
COMPARED = 0.1


@dataclass(frozen=True)
class Reference:
    """A reference: t, s, (n,), quaternions q, (n, 4), scalar first, and places p, m, (n, 3)."""

    t: np.ndarray
    q: np.ndarray
    p: np.ndarray

    @property
    def known(self):
        """Which samples have an attitude."""
        return np.isfinite(self.q[:, 0])

    def without(self, cut):
        """Return the same with what is cut as not-a-number."""
        q, p = self.q.copy(), self.p.copy()
        q[cut], p[cut] = np.nan, np.nan
        return replace(self, q=q, p=p)


def turns(reference, seconds=COMPARED):
    """Return times of start and end, s, and rotation vectors between, rad on body axes, (m, 3)."""
    known = np.flatnonzero(reference.known)
    t = reference.t[known]
    last = np.searchsorted(t, t + seconds)
    first = np.flatnonzero(last < len(t))
    last = last[first]
    near = t[last] - t[first] < 1.5 * seconds
    first, last = first[near], last[near]
    rotation = Rotation.from_quat(reference.q[known], scalar_first=True)
    return t[first], t[last], (rotation[first].inv() * rotation[last]).as_rotvec()


def angles(t, w, start, end):
    """Return the integral of the angular rate from start to end, (m, 3)."""
    steps = np.diff(t)[:, None] * (w[1:] + w[:-1]) / 2
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    ends = (np.column_stack([np.interp(x, t, c) for c in total.T]) for x in (start, end))
    first, last = ends
    return last - first


def at_instants(reference, t):
    """Return the reference at instants, s, by column: cubics between samples, over short losses."""
    found = {name: np.full(len(t), np.nan) for name in (*ORIENTATION, *POSITION)}
    known = np.flatnonzero(reference.known)
    q = reference.q[known]
    # of the two quaternions of an attitude that near the one before
    q = q * np.cumprod(np.append(1, np.where((q[1:] * q[:-1]).sum(axis=1) < 0, -1, 1)))[:, None]
    places = np.flatnonzero(np.isfinite(reference.p[:, 0]))
    for names, at, values in (
        (ORIENTATION, known, q),
        (POSITION, places, reference.p[places]),
    ):
        times = reference.t[at]
        usual = np.median(np.diff(reference.t))
        breaks = np.flatnonzero(np.diff(times) > max(BRIDGED, 1.5 * usual)) + 1
        for part in np.split(np.arange(len(at)), breaks):
            if len(part) < 4:
                continue
            own = times[part]
            inside = np.flatnonzero((t >= own[0] - 1e-9) & (t <= own[-1] + 1e-9))
            value = CubicSpline(own, values[part])(t[inside])
            if names is ORIENTATION:
                value = value / np.linalg.norm(value, axis=1, keepdims=True)
            for name, column in zip(names, value.T, strict=True):
                found[name][inside] = column
    return found
