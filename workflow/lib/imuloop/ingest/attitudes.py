"""Attitudes and places of a reference over time: turns between them, values at instants."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from imuloop.core.samples import ORIENTATION, POSITION

# s; up to here lost samples are bridged by a cubic
BRIDGED = 0.05
# s over which turns are compared; offset of two clocks up to which they count as one
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

    @property
    def placed(self):
        """Which samples have a place."""
        return np.isfinite(self.p[:, 0])


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
    total = cumulative_trapezoid(w, t, axis=0, initial=0)
    first, last = (np.column_stack([np.interp(x, t, c) for c in total.T]) for x in (start, end))
    return last - first


def at_instants(reference, t):
    """Return the reference at instants, s, by column: cubics between samples, over short losses."""
    found = {name: np.full(len(t), np.nan) for name in (*ORIENTATION, *POSITION)}
    longest = max(BRIDGED, 1.5 * np.median(np.diff(reference.t)))
    for names, known, values in (
        (ORIENTATION, reference.known, reference.q),
        (POSITION, reference.placed, reference.p),
    ):
        times, values = reference.t[known], values[known]
        if names is ORIENTATION:
            # of the two quaternions of an attitude that near the one before
            turned = (values[1:] * values[:-1]).sum(axis=1) < 0
            values = values * np.cumprod(np.append(1, np.where(turned, -1, 1)))[:, None]
        breaks = np.flatnonzero(np.diff(times) > longest) + 1
        for own, part in zip(np.split(times, breaks), np.split(values, breaks), strict=True):
            if len(own) < 4:
                continue
            inside = (t >= own[0] - 1e-9) & (t <= own[-1] + 1e-9)
            value = CubicSpline(own, part)(t[inside])
            if names is ORIENTATION:
                value = value / np.linalg.norm(value, axis=1, keepdims=True)
            for name, column in zip(names, value.T, strict=True):
                found[name][inside] = column
    return found
