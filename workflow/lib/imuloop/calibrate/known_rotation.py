"""Turns of a known angle, or at a known rate: a reference of one number each."""

from dataclasses import dataclass

import numpy as np

from imuloop.calibrate.gyroscope import AngularRate
from imuloop.calibrate.recording import Log
from imuloop.core.samples import ANGULAR_RATE, at_rail, read_columns, read_metadata
from imuloop.core.segments import STATIC
from imuloop.core.units import DEGREE

# rad; standard deviation of an end of a turn that is made by hand against an edge, half a turn's
# worth on each axis
BY_HAND = 0.005
# cosine of 20 degrees: gravity so near to the axis is the axis, of a turn on a level table
LEVEL = 0.94


@dataclass(frozen=True)
class KnownTurns:
    """Turns about fixed axes: ``T K (a - b L) = θ u``, with a the integral of the rate as logged.

    `turned` a, rad as logged, (m, 3); `seconds` L, (m,); `target` θ u, rad on body axes, (m, 3);
    `bias` of the rests beside them, rad/s as logged, (3,).
    """

    turned: np.ndarray
    seconds: np.ndarray
    target: np.ndarray
    bias: np.ndarray

    def __len__(self):
        return len(self.seconds)

    def select(self, keep):
        """Return the turns of an index or mask."""
        own = (self.turned[keep], self.seconds[keep], self.target[keep])
        return KnownTurns(*own, self.bias)

    @property
    def _rate(self):
        """Mean angular rate of each turn, as logged."""
        return AngularRate(self.turned / self.seconds[:, None], np.zeros((len(self), 3, 0)))

    def start(self):
        """Return T, K and b by the turns alone, nominal where they determine nothing: (12,)."""
        raw = self.turned - self.seconds[:, None] * self.bias
        found = np.eye(3)
        if len(self) and np.linalg.matrix_rank(raw, tol=0.1 * np.abs(raw).max()) == 3:
            found = np.linalg.lstsq(raw, self.target, rcond=None)[0].T
        K = np.diag(found)
        return np.concatenate([(found / K)[AngularRate.entries], K, self.bias])

    def rows(self):
        """Return rows R, (3 m, 12), and z of what they say: ``R x - z`` has variance one."""
        x, length = self.start(), self.seconds[:, None]
        derivative = self._rate.summed(length[..., None, None] * np.eye(3), x).reshape(-1, 12)
        left = length * self._rate.values(x) - self.target
        return derivative / BY_HAND, (derivative @ x - left.ravel()) / BY_HAND

    def errors(self, calibration):
        """Return what a SensorCalibration leaves of each turn, rad, (m, 3)."""
        return self.seconds[:, None] * calibration.aligned(self._rate.y) - self.target


def read_turns(sessions, force):
    """Return the KnownTurns of a device; sessions as in `calibrate.usable`.

    The axis is the one declared; gravity's direction by the accelerometer `force`, at the start of
    the turn, where it lies along it.
    """
    found, rests = [], []
    for session in sessions.values():
        metadata = read_metadata(session["samples"])
        known = metadata.get("known_rotation")
        if session["kind"] != "known_rotation" or not known:
            continue
        samples = read_columns(session["samples"])
        log = Log.of(samples)
        t = log.t
        if not len(t):
            continue
        clipped = at_rail(samples, metadata.get("rails", {}), ANGULAR_RATE)
        table = read_columns(session["segments"])
        still = np.asarray(table["kind"]) == STATIC
        means = np.column_stack([table[f"{c}_mean"][still] for c in ANGULAR_RATE])
        rests.append((means, table["n"][still]))
        for turn in known:
            first, last = np.searchsorted(t, [turn.get("start", t[0]), turn.get("end", t[-1])])
            rows = slice(first, last + 1)
            if len(t[rows]) < 3 or clipped[rows].any():
                continue
            length = np.ptp(t[rows])
            turned = np.trapezoid(log.w[rows], t[rows], axis=0)
            angle = turn["angle"] if "angle" in turn else turn["rate"] * length
            axis = np.eye(3)["xyz".index(turn["axis"][-1])]
            axis = -axis if turn["axis"][0] == "-" else axis
            up = force.aligned(log.f[max(first - 10, 0) : first + 10]).mean(axis=0)
            up /= np.linalg.norm(up)
            if abs(up @ axis) > LEVEL:
                axis = up * np.sign(up @ axis)
            found.append((turned, length, angle * DEGREE * axis))
    means, n = (np.concatenate(x) for x in zip(*rests, strict=True)) if rests else ([], [])
    bias = np.average(means, axis=0, weights=n) if len(n) else np.zeros(3)
    turned, seconds, target = zip(*found, strict=True) if found else ([], [], [])
    shaped = (np.reshape(turned, (-1, 3)), np.array(seconds), np.reshape(target, (-1, 3)))
    return KnownTurns(*shaped, bias)
