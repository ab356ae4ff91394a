"""Windows of a log in which one sensor is compared with a reference, such as motion capture.

The comparison has a set-up: the offset of the clock, the mounting, the place of the marker and the
biases.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
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
from imuloop.model.prior import data_sheet
from imuloop.model.state import BASE, NAMES

# length of a window of the gyroscope, and half the length of a window of the accelerometer, s
TURN, HALF = 1.0, 0.2
# fewest windows of a sensor that determine its parameters and leave folds for cross-validation
LEAST_WINDOWS = 20
# step of numerical derivatives, SI
STEP = 1e-6
# wide prior standard deviations of the parameters that sessions share, SI
LOOSE = {"dt": 0.1, "d": 0.02, "rx": 1.0, "ry": 1.0, "rz": 1.0}
# prior standard deviations of the twelve parameters of a session, SI: bias of the gyroscope, bias
# of the accelerometer, mounting, and tilt of the reference's world, three components each
SESSION_STD = np.repeat([0.5, 2.0, 0.3, 0.3], 3)


@dataclass(frozen=True)
class ReferenceLog:
    """The log of a session, N samples, with a reference: both sensors, attitude and place."""

    t: np.ndarray  # (N,): time, s
    f: np.ndarray  # (N, 3): calibrated specific force, m/s^2
    w: np.ndarray  # (N, 3): calibrated angular rate, rad/s
    # (N, 3, 3): rotation matrices from axes near the body's axes to the axes of the reference's
    # world: the attitude of the reference times `frame`; not-a-number where the reference was lost
    attitude: np.ndarray
    place: np.ndarray  # (N, 3): position of the marker, m
    frame: np.ndarray  # (3, 3): estimated rotation from the body to the axes of the tracked body
    noise: tuple[float, float]  # standard deviations of the attitude, rad, and of the place, m


def read_reference(sessions, calibration):
    """Return the ReferenceLog of each session with a reference, a dict by name.

    `sessions` is a dict by name of dicts with the ``kind`` of the session and the paths of its
    ``samples`` and ``segments``. `calibration` is the Calibration of the device. It is applied to
    the samples. Exception: its effects that depend on time, or on channels that not every log has,
    such as temperature, are not subtracted.
    """
    logs, sensors = {}, {}
    for name in SENSORS:
        sensor = getattr(calibration, name)
        steady = tuple(e for e in sensor.effects if not (e.effect.timed or e.effect.needs))
        sensors[name] = replace(sensor, effects=steady)
    calibration = replace(calibration, **sensors)
    for name, session in sessions.items():
        metadata = read_metadata(session["samples"]).get("reference") or {}
        if session["kind"] == "reference_motion" and "noise" in metadata:
            samples = read_columns(session["samples"])
            log, frame = Log.of(samples), np.array(metadata["frame"])
            f, w = calibration.calibrated(log.f, log.w, log.t, temperature=None)
            q, place = (np.column_stack([samples[c] for c in n]) for n in (ORIENTATION, POSITION))
            # not-a-number where the reference was lost
            attitude, valid = np.full((len(q), 3, 3), np.nan), np.isfinite(q[:, 0])
            attitude[valid] = Rotation.from_quat(q[valid], scalar_first=True).as_matrix() @ frame
            # a reference without positions has no noise of them
            noise = metadata["noise"]["orientation"], metadata["noise"]["position"] or 0.0
            logs[name] = ReferenceLog(
                t=log.t, f=f, w=w, attitude=attitude, place=place, frame=frame, noise=noise
            )
    return logs


class Windows:
    """The m windows of the logs, short parts in which one sensor is compared with the reference.

    Each sensor has a subclass, which computes the residuals. The set-up has the parameters x, (p,):
    first the parameters of each session, then the parameters that all sessions share. All windows
    are padded to k samples by repeating the last sample.

    Parameters
    ----------
    logs : list of ReferenceLog
        The sessions, s of them.
    gravity : float
        Local gravity, m/s^2.
    calibration : Calibration
        The calibration of the device, which was applied to the logs.

    Attributes
    ----------
    session : ndarray of int, shape (m,)
        Index of the log of each window.
    first, middle, last : ndarray of int, shape (m,)
        Index of the sample at the start, the middle and the end of each window.
    rows, t : ndarray, shape (m, k)
        Index and time, s, of all samples of each window.
    shared : ndarray of int
        Indices in x of the shared parameters of this sensor. The first are the parameters of
        `effects`, such as the offset of the clock, then the `entries` of the matrix A. A is the
        error of the calibration's misalignment T and scale factors K: calibrated values y with the
        bias b become ``(1 + A) (y - b)``.
    prior : ndarray
        Prior standard deviations of the shared parameters, SI.
    places : ndarray of int, shape (s, q)
        Indices in x of the q parameters of each session for this sensor: bias, mounting, and for
        the accelerometer the tilt of the reference's world. `SESSION_STD` has the parameters of a
        session for both sensors; `session_entries` are the indices of this sensor's parameters in
        it.
    """

    def __init__(self, logs, gravity, calibration):
        """Find the windows and set the attributes, but for `shared`, which `fit_set_up` sets.

        The arguments `logs`, `gravity` and `calibration` are described in the class.
        """
        self.logs, self.gravity = logs, gravity
        by_session = (self._find_windows(session, log) for session, log in enumerate(logs))
        rows = [np.zeros((0, 4), int), *by_session]
        self.session, self.first, self.middle, self.last = np.concatenate(rows).T
        length = np.max(self.last - self.first, initial=-1) + 1
        self.rows = np.minimum(self.first[:, None] + np.arange(length), self.last[:, None])
        self.t = self.read_logs("t", self.rows)
        # the prior standard deviations of A are the standard errors of T and, relative to K, of K,
        # or the tolerance of the data sheet if this is smaller
        sensor, sheet = getattr(calibration, self.sensor), data_sheet().std[BASE[self.sensor]]
        names = [f"K{i}" if i == j else f"T{i}{j}" for i, j in zip(*self.entries, strict=True)]
        scale = [sensor.K[int(n[1])] if n[0] == "K" else 1.0 for n in names]
        std = np.array([sensor.std.get(n, np.inf) for n in names]) / scale
        std = np.minimum(std, sheet[[NAMES[self.sensor].index(n) for n in names]])
        # the parameters of all effects with their units: an effect of the set-up has several
        self.units = {n: unit for units in self.effects.values() for n, unit in units.items()}
        self.prior = np.append([LOOSE[n] for n in self.units], std)
        self.places = len(SESSION_STD) * np.arange(len(logs))[:, None] + self.session_entries

    def _find_windows(self, session, log):
        """Return the windows of a ReferenceLog in which no sample is missing, (n, 4) of int.

        `log` is the ReferenceLog and `session` its index. The four columns of the result are this
        index and the indices of the first, middle and last sample of each of n windows. A window
        lasts twice `self.half` seconds. The reference is known at these three samples; for the
        accelerometer its attitude is known at all samples.
        """
        step, lost = np.median(np.diff(log.t)), ~np.isfinite(log.attitude[:, 0, 0])
        valid = ~lost & np.isfinite(getattr(log, self.channel)[:, 0])
        # a number that rises at each interruption: a window lies where it is constant
        part = np.append(0, np.cumsum(np.diff(log.t) > gap_limit(step)))
        if self.sensor == "accelerometer":
            part, valid = part + np.cumsum(lost), valid & np.isfinite(log.place[:, 0])
        half, first, windows = round(self.half / step), 0, []
        while first + 2 * half < len(log.t):
            rows = [first, first + half, first + 2 * half]
            if valid[rows].all() and part[rows[0]] == part[rows[2]]:
                windows.append([session, *rows])
                # the next one begins more than a second later: windows of the gyroscope do not
                # touch
                first += round(TURN / step) + 5
            else:
                # try again a little later
                first += 1 + half // 10
        return np.array(windows, int).reshape(-1, 4)

    def read_logs(self, values, rows):
        """Return values of the logs at chosen samples of each of m windows, (m, …) or (m, c, …).

        `values` is the name of a field of the logs, or a list with an array (N, …) for each log of
        N samples. `rows`, (m,) or (m, c), has the indices of the samples in the log of the window,
        one or c for each window.
        """
        if isinstance(values, str):
            values = [getattr(log, values) for log in self.logs]
        return np.array([values[s][i] for s, i in zip(self.session, rows, strict=True)])

    def output(self, x, drift=0.0):
        """Return the sensor's output ``(1 + A) (y - b)`` at the k samples of m windows, (m, k, 3).

        The unit is m/s^2 or rad/s. y are the calibrated values of the sensor, interpolated at the
        times of the reference. The parameters `x`, (p,), hold the error A of the calibration's
        misalignment T and scale factors K, the bias b of the session, and the offset dt of the
        clock. A sample with the time stamp s was taken at ``s + dt + d (s - s_m)`` on the clock of
        the reference, where s_m is the middle of the log, and d, the argument `drift`, is the drift
        of the clock.
        """
        # the first shared parameter is the offset of the clock, the last are the entries of A
        shared, gain, values = x[self.shared], np.eye(3), []
        gain[self.entries] += shared[-len(self.entries[0]) :]
        for log in self.logs:
            times = log.t + shared[0] + drift * (log.t - (log.t[0] + log.t[-1]) / 2)
            columns = getattr(log, self.channel).T
            values.append(np.column_stack([np.interp(log.t, times, c) for c in columns]))
        bias = x[self.places[:, :3]][self.session]
        return (self.read_logs(values, self.rows) - bias[:, None]) @ gain.T

    def mounting(self, x):
        """Return the mounting of each of m windows, a rotation matrix M, (m, 3, 3).

        M rotates from the axes of the body to the axes, near the body axes, from which the
        `attitude` of a ReferenceLog rotates. It follows from the parameters `x`, (p,).
        """
        return Rotation.from_rotvec(x[self.places[:, 3:6]]).as_matrix()[self.session]

    def derivative(self, x):
        """Return the derivative of the 3 m residuals with respect to the p parameters x, (3 m, p).

        There are three residuals for each of the m windows. `x`, (p,), is where the derivative is
        taken, numerically. A window depends only on the shared parameters and on the parameters of
        its session. So a parameter of the sessions, such as a bias, is changed in all sessions at
        once.
        """
        residual, jacobian = self.values(x), np.zeros((3 * len(self.t), len(x)))
        # index of each parameter by session, which is the same for a shared parameter
        shared = np.tile(self.shared, (len(self.logs), 1))
        for by_session in np.hstack([shared, self.places]).T:
            moved = x.copy()
            moved[by_session] += STEP
            change = (self.values(moved) - residual).ravel() / STEP
            jacobian[np.arange(len(jacobian)), by_session[self.session].repeat(3)] = change
        return jacobian

    def noise(self, model):
        """Return the variances of the reference in each of m windows, and the sensor's white noise.

        There are three results. The first is the variance of the attitude, rad², (m,). The second
        is the variance of the place, m², (m,). The third is the squared density N² of the sensor's
        white noise by the NoiseModel `model`, averaged over the axes.
        """
        attitude, place = np.array([log.noise for log in self.logs])[self.session].T ** 2
        white = np.mean([model.axes[c].N.square for c in SENSORS[self.sensor]])
        return attitude, place, white


class Turns(Windows):
    """Windows of the gyroscope; their residuals are errors of the rotation over a window, rad.

    The residual ``ε = log(Mᵀ Qᵀ M C)`` is a rotation vector. C is the rotation by the gyroscope
    from the body axes at the end of the window to the body axes at its start. Q is the same
    rotation by the reference, on the axes near the body's from which its `attitude` rotates. The
    mounting M rotates from the body axes to these axes.
    """

    sensor, channel, kind, unit = "gyroscope", "w", "reference_rotation", "rad"
    effects: ClassVar = {"time_offset": {"dt": "s"}, "clock_drift": {"d": "1"}}
    half, entries, session_entries = TURN / 2, np.divmod(np.arange(9), 3), [0, 1, 2, 6, 7, 8]

    def values(self, x):
        """Return the residuals, rotation vectors in rad, (m, 3), for the parameters `x`, (p,)."""
        _, drift, *_ = x[self.shared]
        steps = step_vectors(self.output(x, drift), np.diff(self.t, axis=1))
        C, M = matrix(prefix_product(exponential(steps))[:, -1]), self.mounting(x)
        # Q M at both ends
        start, end = (self.read_logs("attitude", rows) @ M for rows in (self.first, self.last))
        return Rotation.from_matrix(end.swapaxes(1, 2) @ start @ C).as_rotvec()

    def floor(self, x, model):
        """Return the variance of a component of the residuals by the noise alone, rad², (m,).

        The noise is the error of the reference's attitude at both ends of each of m windows, and
        the white noise of the gyroscope over the window, by the NoiseModel `model`. The parameters
        `x` are not used; all subclasses of Windows have the same arguments.
        """
        attitude, _, white = self.noise(model)
        return 2 * attitude + white * np.ptp(self.t, axis=1)


class Places(Windows):
    """Windows of the accelerometer; their residuals are errors of the mean acceleration, m/s².

        ε = ∫ tri (C M f) dt / h² - g u - Δ²(p + C M r) / h²

    ε is the residual of a window. The first two terms are the acceleration by the accelerometer. f
    is the specific force on body axes. The mounting M rotates it to axes near the body's, and the
    `attitude` C of the reference from there to the axes of its world. tri is a triangular weight
    over the window, whose length is 2 h. g is gravity and u the upward direction.

    The last term is the acceleration by the reference: the second difference Δ², with the step h,
    of the place of the accelerometer. p is the place of the marker, and r the arm from the marker
    to the accelerometer, on body axes.
    """

    sensor, channel, kind, unit = "accelerometer", "f", "reference_force", "m/s^2"
    effects: ClassVar = {"time_offset": {"dt": "s"}, "lever_arm": {f"r{k}": "m" for k in "xyz"}}
    half, entries, session_entries = HALF, np.triu_indices(3), [3, 4, 5, 6, 7, 8, 9, 10, 11]

    def __init__(self, *arguments):
        super().__init__(*arguments)
        # `windows_of` leaves out a sensor with too few windows, so nothing more is computed
        if len(self.session) < LEAST_WINDOWS:
            return
        # weights of a mean, which fall linearly from the middle to zero; times the attitude they
        # are one matrix for all samples of a window, (m, 3, 3 k)
        distance = np.abs(self.t - (self.t[:, :1] + self.t[:, -1:]) / 2)
        weights = np.gradient(self.t, axis=1) * (np.ptp(self.t, axis=1)[:, None] / 2 - distance)
        self.weights = weights / weights.sum(axis=1, keepdims=True)
        mean = self.read_logs("attitude", self.rows) * self.weights[..., None, None]
        self.mean = mean.swapaxes(1, 2).reshape(len(mean), 3, -1)
        # attitude, (m, 3, 3, 3), and place, (m, 3, 3), at the start, middle and end of each window
        ends = np.column_stack([self.first, self.middle, self.last])
        self.attitude, self.place = (self.read_logs(name, ends) for name in ("attitude", "place"))
        up = self.subtract_motion(self.read_logs("f", self.rows), np.zeros((1, 3, 1)))
        # first estimate of the upward direction of each session, without mounting and arm; any for
        # a session without windows
        by_session = (up[self.session == s] / self.gravity for s in range(len(self.logs)))
        self.up = np.array([np.median(u, axis=0) if len(u) else np.eye(3)[2] for u in by_session])

    def subtract_motion(self, f, arm):
        """Return the mean specific force less the acceleration by the reference, m/s², (m, 3).

        There is one vector, on the axes of the reference's world, for each of m windows. `f` is the
        specific force, m/s², of the k samples of each window, (m, k, 3). `arm` is the vector from
        the marker to the sensor, m, (m, 3, 1), or (1, 3, 1) for all windows; the last axis has
        length one, for products with matrices. `f` and `arm` are on the axes near the body's from
        which the `attitude` of a ReferenceLog rotates.
        """
        # place of the sensor at the start, middle and end, and its second difference
        place = self.place + (self.attitude @ arm[:, None])[..., 0]
        half = np.ptp(self.t, axis=1)[:, None] / 2
        acceleration = np.diff(place, 2, axis=1)[:, 0] / half**2
        return (self.mean @ f.reshape(len(f), -1, 1))[..., 0] - acceleration

    def values(self, x):
        """Return the residuals of the acceleration, m/s², (m, 3), for the parameters `x`, (p,)."""
        M, up = self.mounting(x), self.up + x[self.places[:, 6:]]
        gravity = up * (self.gravity / np.linalg.norm(up, axis=1, keepdims=True))
        # the shared parameters are the offset of the clock, the arm from the marker, and A
        force, arm = self.output(x) @ M.swapaxes(1, 2), M @ x[self.shared[1:4], None]
        return self.subtract_motion(force, arm) - gravity[self.session]

    def floor(self, x, model):
        """Return the variance of a component of the residuals by the noise alone, (m/s²)², (m,).

        The noise is the error of the reference's attitude and place in each of m windows, and the
        white noise of the accelerometer, by the NoiseModel `model`. `x` are the parameters, (p,).
        """
        attitude, place, white = self.noise(model)
        # a wrong attitude turns gravity, and the arm, whose length is in the parameters
        step = np.median(np.diff(self.t, axis=1), axis=1)
        force = self.gravity**2 * attitude + white / step
        place = place + np.sum(x[self.shared[1:4]] ** 2) * attitude
        # a second difference has the variance of 1 + 4 + 1 values
        return force * (self.weights**2).sum(axis=1) + 6 * place / HALF**4


def windows_of(logs, gravity, calibration):
    """Return the windows of the gyroscope, Turns, and of the accelerometer, Places, as one tuple.

    A sensor with fewer than `LEAST_WINDOWS` windows is left out. `logs` is a list of ReferenceLog,
    `gravity` is local gravity, m/s^2, and `calibration` the Calibration of the device.
    """
    windows = [cls(logs, gravity, calibration) for cls in (Turns, Places)]
    return tuple(w for w in windows if len(w.session) >= LEAST_WINDOWS)
