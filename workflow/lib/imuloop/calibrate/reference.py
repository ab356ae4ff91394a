"""The set-up of a reference beside a device: clock, mounting, marker and biases, in one fit."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from imuloop.calibrate.recording import Log
from imuloop.core.gaps import gap_limit
from imuloop.core.rotation import exponential, matrix, prefix_product, step_vectors
from imuloop.core.samples import (
    ORIENTATION,
    POSITION,
    SENSORS,
    read_columns,
    read_metadata,
)
from imuloop.estimate.least_squares import covariance_of
from imuloop.model.prior import data_sheet
from imuloop.model.state import BASE, NAMES

# s; from the start of a window to that of the next, and half the length of one of position
TURN, HALF = 1.0, 0.2
# windows of a sensor at least, for its parameters and a part held out
LEAST_WINDOWS = 20
# of a numerical derivative, SI
STEP = 1e-6
# prior standard deviations, SI: next to nothing is known of a set-up
LOOSE = {"dt": 0.1, "d": 0.02, "rx": 1.0, "ry": 1.0, "rz": 1.0}
# those of a session: bias of the gyroscope and of the accelerometer, mounting, tilt of the world
OWN = np.repeat([0.5, 2.0, 0.3, 0.3], 3)


@dataclass(frozen=True)
class ReferenceLog(Log):
    """A session beside a reference: calibrated f and w, SI, (N, 3), and the reference's columns.

    `attitude`, (N, 3, 3), takes axes near the body's to the world's, not-a-number where lost: the
    reference's own times `frame`, the rotation between both as far as turns show it. `place`,
    (N, 3), is in m; `noise` the standard deviations of both, rad and m.
    """

    attitude: np.ndarray
    place: np.ndarray
    frame: np.ndarray
    noise: tuple[float, float]


def read_reference(sessions, calibration):
    """Return the ReferenceLog of each usable session with a reference, by name.

    Takes sessions as in `calibrate.calibrate.usable` and the Calibration of the device. Effects
    that depend on time, or on what is not logged everywhere, are not applied.
    """
    steady, found = {}, {}
    for name, own in ((name, getattr(calibration, name)) for name in SENSORS):
        kept = [e for e in own.effects if not (e.effect.timed or e.effect.needs)]
        steady[name] = replace(own, effects=tuple(kept))
    for name, session in sessions.items():
        known = read_metadata(session["samples"]).get("reference") or {}
        if session["kind"] == "reference_motion" and "noise" in known:
            samples = read_columns(session["samples"])
            log, frame = Log.of(samples), np.array(known["frame"])
            f, w = replace(calibration, **steady).calibrated(log.f, log.w, log.t, None)
            q, place = (np.column_stack([samples[c] for c in n]) for n in (ORIENTATION, POSITION))
            attitude, seen = np.full((len(q), 3, 3), np.nan), np.isfinite(q[:, 0])
            attitude[seen] = Rotation.from_quat(q[seen], scalar_first=True).as_matrix() @ frame
            noise = known["noise"]["orientation"], known["noise"]["position"] or 0.0
            found[name] = ReferenceLog(log.t, f, w, None, attitude, place, frame, noise)
    return found


class Windows:
    """Windows in which one sensor is compared with the reference.

    Session and rows of the start, the middle and the end of each, (m,); of all its samples rows,
    the last repeated, and times, s, (m, k). Parameters are those of `effects`, and the entries of
    A, by which T and K are off, with `prior` standard deviations: sessions share them, at the
    places `shared` of all; and those of a session, at the `places`, (s, q), the `own` of `OWN`.
    """

    def __init__(self, logs, gravity, calibration):
        self.logs, self.gravity = logs, gravity
        found = [np.zeros((0, 4), int), *(self._of_log(*each) for each in enumerate(logs))]
        self.session, self.first, self.middle, self.last = np.concatenate(found).T
        length = np.max(self.last - self.first, initial=-1) + 1
        self.rows = np.minimum(self.first[:, None] + np.arange(length), self.last[:, None])
        self.t = self.of_logs("t", self.rows)
        # A as what is known of T and K, relative
        own, sheet = getattr(calibration, self.sensor), data_sheet().std[BASE[self.sensor]]
        names = [f"K{i}" if i == j else f"T{i}{j}" for i, j in zip(*self.entries, strict=True)]
        scale = [own.K[int(n[1])] if n[0] == "K" else 1.0 for n in names]
        std = np.array([own.std.get(n, np.inf) for n in names]) / scale
        std = np.minimum(std, sheet[[NAMES[self.sensor].index(n) for n in names]])
        self.units = {n: unit for each in self.effects.values() for n, unit in each.items()}
        self.prior = np.append([LOOSE[n] for n in self.units], std)
        self.places = len(OWN) * np.arange(len(logs))[:, None] + np.array(self.own)

    def _of_log(self, session, log):
        """Return session and rows of the windows of a log, (m, 4); no sample is missing in one."""
        step, i, found = np.median(np.diff(log.t)), 0, []
        broken = np.append(0, np.cumsum(np.diff(log.t) > gap_limit(step)))
        lost = ~np.isfinite(log.attitude[:, 0, 0])
        known, half = ~lost & np.isfinite(getattr(log, self.channel)[:, 0]), round(self.half / step)
        if self.sensor == "accelerometer":
            broken, known = broken + np.cumsum(lost), known & np.isfinite(log.place[:, 0])
        while i + 2 * half < len(log.t):
            rows = [i, i + half, i + 2 * half]
            whole = known[rows].all() and broken[i] == broken[i + 2 * half]
            found += [(session, *rows)] * int(whole)
            i += round(TURN / step) + 5 if whole else 1 + half // 10
        return np.array(found, int).reshape(-1, 4)

    def of_logs(self, values, rows):
        """Return what the logs hold at rows of each window, (m, …): by name, or arrays by log."""
        if isinstance(values, str):
            values = [getattr(log, values) for log in self.logs]
        return np.array([values[s][i] for s, i in zip(self.session, rows, strict=True)])

    def output(self, x, drift=0.0):
        """Return ``(1 + A) y`` at instants of the reference, less the bias, (m, k, 3).

        What is stamped s was there at ``s + dt + d (s - s_m)``, s_m the middle of the log.
        """
        A, found, shared = np.eye(3), [], x[self.shared]
        A[self.entries] += shared[-len(self.entries[0]) :]
        for log in self.logs:
            at = log.t + shared[0] + drift * (log.t - (log.t[0] + log.t[-1]) / 2)
            columns = getattr(log, self.channel).T
            found.append(np.column_stack([np.interp(log.t, at, c) for c in columns]))
        return (self.of_logs(found, self.rows) - x[self.places[self.session, None, :3]]) @ A.T

    def mounting(self, x):
        """Return what is left of the rotation between both bodies, (m, 3, 3)."""
        return Rotation.from_rotvec(x[self.places[:, 3:6]]).as_matrix()[self.session]

    def derivative(self, x):
        """Return the derivative of the residuals with respect to all parameters, (3 m, p)."""
        plain, found = self.values(x), np.zeros((3 * len(self.t), len(x)))
        # each parameter in all sessions at once
        for columns in (*np.tile(self.shared, (len(self.logs), 1)).T, *self.places.T):
            moved = x.copy()
            moved[columns] += STEP
            change = (self.values(moved) - plain).ravel() / STEP
            found[np.arange(len(found)), columns[self.session].repeat(3)] = change
        return found

    def noise(self, model):
        """Return the variances of white noise: attitude, place, density of the sensor, (m,)."""
        each = np.array([log.noise for log in self.logs])[self.session].T ** 2
        return *each, np.mean([model.axes[c].N.square for c in SENSORS[self.sensor]])


class Turns(Windows):
    """Rotation over a window, C by the gyroscope from its start, Q by the reference.

    ε = log(Mᵀ Qᵀ M C)     (rad),     M the mounting
    """

    sensor, channel, kind, unit = "gyroscope", "w", "reference_rotation", "rad"
    effects: ClassVar = {"time_offset": {"dt": "s"}, "clock_drift": {"d": "1"}}
    half, entries, own = TURN / 2, np.divmod(np.arange(9), 3), [0, 1, 2, 6, 7, 8]

    def values(self, x):
        """Return the residuals at all parameters, (m, 3)."""
        steps = step_vectors(self.output(x, x[self.shared[1]]), np.diff(self.t, axis=1))
        C, M = matrix(prefix_product(exponential(steps))[:, -1]), self.mounting(x)
        start, end = (self.of_logs("attitude", rows) @ M for rows in (self.first, self.last))
        return Rotation.from_matrix(end.swapaxes(1, 2) @ start @ C).as_rotvec()

    def floor(self, x, model):
        """Return the variance that the noise of both gives each component, (m,)."""
        attitude, _, white = self.noise(model)
        return 2 * attitude + white * np.ptp(self.t, axis=1)


class Places(Windows):
    """Second difference Δ² over h of the sensor's place, p + C M r, with C the attitude.

        ε = ∫ tri (C M f) dt / h² - g u - Δ²(p + C M r) / h²     (m/s²)

    M is the mounting, r the arm from the marker, u up.
    """

    sensor, channel, kind, unit = "accelerometer", "f", "reference_force", "m/s^2"
    effects: ClassVar = {"time_offset": {"dt": "s"}, "lever_arm": {f"r{k}": "m" for k in "xyz"}}
    half, entries, own = HALF, np.triu_indices(3), [3, 4, 5, 6, 7, 8, 9, 10, 11]

    def __init__(self, *given):
        super().__init__(*given)
        if len(self.session) < LEAST_WINDOWS:
            return
        # weights of a mean, which fall linearly from the middle; times the attitude, (m, 3, 3 k)
        far = np.abs(self.t - (self.t[:, :1] + self.t[:, -1:]) / 2)
        weights = np.gradient(self.t, axis=1) * (np.ptp(self.t, axis=1)[:, None] / 2 - far)
        self.weights = weights / weights.sum(axis=1, keepdims=True)
        mean = self.of_logs("attitude", self.rows) * self.weights[..., None, None]
        self.mean = mean.swapaxes(1, 2).reshape(len(mean), 3, -1)
        ends = np.column_stack([self.first, self.middle, self.last])
        self.ends = self.of_logs("attitude", ends), self.of_logs("place", ends)
        left = self.pushed(self.of_logs("f", self.rows), np.zeros((1, 3, 1))) / self.gravity
        # up by the force as it is
        known = (left[self.session == s] for s in range(len(self.logs)))
        self.up = np.array([np.median(x, axis=0) if len(x) else np.eye(3)[2] for x in known])

    def pushed(self, f, arm):
        """Return the mean of the force, (m, k, 3), less the acceleration of its place, (m, 3)."""
        place = self.ends[1] + (self.ends[0] @ arm[:, None])[..., 0]
        half = np.ptp(self.t, axis=1)[:, None] / 2
        force = (self.mean @ f.reshape(len(f), -1, 1))[..., 0]
        return force - np.diff(place, 2, axis=1)[:, 0] / half**2

    def values(self, x):
        """Return the residuals at all parameters, (m, 3)."""
        M, up = self.mounting(x), self.up + x[self.places[:, 6:]]
        up *= self.gravity / np.linalg.norm(up, axis=1, keepdims=True)
        left = self.pushed(self.output(x) @ M.swapaxes(1, 2), M @ x[self.shared[1:4], None])
        return left - up[self.session]

    def floor(self, x, model):
        """Return the variance that the noise of both gives each component, (m,)."""
        attitude, place, white = self.noise(model)
        own = self.gravity**2 * attitude + white / np.median(np.diff(self.t, axis=1), axis=1)
        place = 6 * (place + (x[self.shared[1:4]] ** 2).sum() * attitude) / HALF**4
        return own * (self.weights**2).sum(axis=1) + place


@dataclass(frozen=True)
class SetUp:
    """The set-up of a reference, fitted to all windows of both sensors with a Gaussian prior.

    Parameters x, (p,), SI, are those of each session, and then those that sessions share, for each
    of the `windows`. `white` are the derivative at x and the residuals, (n + p, p + 1), of variance
    one, the prior's last; variances, (n,), are by the noise alone, and by what is left.
    """

    windows: tuple[Windows, ...]
    x: np.ndarray
    covariance: np.ndarray
    white: np.ndarray
    floor: np.ndarray
    variance: np.ndarray

    def of_windows(self, values):
        """Return what the windows of all sensors have, three components each, (n,)."""
        return np.repeat(np.concatenate([values(w) for w in self.windows]), 3)

    def errors(self, parts, without=()):
        """Return what is left of the residuals, (n,), SI, by the derivative at x.

        Each of the parts, (n,), is predicted by the shared parameters of the others, those of its
        session its own; part -1 by all. Parameters at the places `without` are zero.
        """
        first, without = min(w.shared[0] for w in self.windows), [*without]
        r = self.white[:, -1] - self.white[:, without] @ self.x[without]
        of_session = np.linalg.qr(self.white[:, :first])[0]
        both = np.column_stack([np.delete(self.white[:, :-1], without, axis=1)[:, first:], r])
        both -= of_session @ (of_session.T @ both)
        every, left = np.append(parts, np.full(len(self.x), -1)), np.zeros(len(both))
        for part in np.unique(parts):
            held, seen = every == part, both[(every != part) | (every < 0)]
            change = np.linalg.lstsq(seen[:, :-1], -seen[:, -1])[0]
            left[held] = both[held] @ np.append(change, 1.0)
        return left[: len(parts)] * np.sqrt(self.variance)


def windows_of(logs, gravity, calibration):
    """Return the Windows of each sensor that has enough of them in ReferenceLogs.

    Takes local gravity, m/s^2, and the Calibration that the logs are calibrated by.
    """
    windows = [cls(logs, gravity, calibration) for cls in (Turns, Places)]
    return tuple(w for w in windows if len(w.session) >= LEAST_WINDOWS)


def fit_set_up(windows, noise):
    """Return the SetUp of some Windows, their noise by a NoiseModel."""
    prior = np.tile(OWN, len(windows[0].logs))
    for w in windows:
        w.shared, prior = len(prior) + np.arange(len(w.prior)), np.append(prior, w.prior)
    x = np.zeros(len(prior))

    def white(x, size, _):
        return np.concatenate([*(w.values(x).ravel() for w in windows), x]) / size

    # each round with the variances that the one before leaves
    for _ in range(4):
        floor, each = [w.floor(x, noise) for w in windows], [w.values(x) for w in windows]
        variance = np.concatenate([*map(_spread, each, floor)]).repeat(3)
        size = np.append(np.sqrt(variance), prior)
        slope = np.concatenate([*(w.derivative(x) for w in windows), np.eye(len(x))])
        given = size, slope / size[:, None]
        # the derivative changes little on the way
        x = least_squares(white, x, lambda *a: a[-1], args=given, method="lm", x_scale="jac").x
    fit, floor = np.column_stack([given[1], white(x, *given)]), np.concatenate(floor).repeat(3)
    return SetUp(windows, x, covariance_of(given[1]), fit, floor, variance)


def _spread(values, floor):
    """Return the variance of each of m windows by residuals, (m, 3), not below the noise, (m,).

    Beside the noise all have one variance in common, by the median, which is 2.366 for χ² of three
    components; beyond three standard deviations a window has no more influence: Huber's weights.
    """
    square = (values**2).sum(axis=1)
    variance = floor + max(np.median(square / 2.366 - floor), 0.0)
    return variance * np.maximum(np.sqrt(square / variance / 3) / 3, 1.0)
