"""Both sensors beside a reference: rotations against attitudes, specific force against places."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from imuloop.calibrate import accelerometer
from imuloop.calibrate.gyroscope import GyroscopeModel, cross_matrix
from imuloop.calibrate.least_squares import FitResult, Solution, covariance_of
from imuloop.calibrate.poses import Rotations
from imuloop.calibrate.reference.recording import HALF
from imuloop.calibrate.reference.session_nuisances import ReferenceModel
from imuloop.core.effect import Channels, effect_design
from imuloop.core.noise_model import NoiseModel

# rad; attitudes closer than this have errors of the reference in common: the same markers are seen
ALIKE = 0.35


@dataclass(frozen=True, eq=False)
class ReferenceSensor:
    """A sensor beside a reference; `weight`, (m,), are inverse variances of its windows."""

    noise: NoiseModel
    gravity: float
    weight: np.ndarray | None = None
    # of each session, SI as logged: biases to start from
    bias: np.ndarray | None = None
    axes = ()
    # parameters of the base model: misalignment, then scale factors
    first: ClassVar = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])

    def rows(self, recording):
        """Return the window that each residual is of, twice, (N, 2), and its kind, (N,)."""
        window = np.repeat(np.arange(len(self.windows(recording)[0])), 3)
        return np.column_stack([window, window]), np.zeros(len(window), int)

    def windows(self, recording):
        """Return the windows of a recording."""
        return recording.windows(self.of)

    def start(self, effects=()):
        """Return parameters to start from: as logged."""
        return np.concatenate([self.first, np.zeros(sum(len(e.parameters) for e in effects))])

    def model(self, solution, recording, shapes=()):
        """Return the model about a solution, with more effects."""
        return self.model_at(solution.fit.x, recording, (*solution.effects, *shapes))

    def design(self, recording, effects, values, gain):
        """Return the derivative of e over whole logs, (N, 3, p) by session."""
        found = []
        for log, b in zip(recording.logs, self.bias, strict=True):
            own, other = (log.f, log.w) if self.sensor == "accelerometer" else (log.w, log.f)
            channels = Channels(log.t, gain * (own - b), other, log.temperature)
            found.append(effect_design(effects, channels, values))
        return found

    def fit(self, recording, effects=(), start=None, prior=None):
        """Return the Solution for a recording, and its model.

        Weighted least squares, a few Gauss-Newton steps from the model `start`, as logged without.
        """
        model = start or self.model_at(None, recording, effects)
        x, model = model.x, replace(model, weight=self.weight)
        root = np.repeat(np.sqrt(self.weight), 3)
        for _ in range(3 if start is None else 2):
            r, jacobian = model.residuals()
            white = np.column_stack([r, jacobian]) * root[:, None]
            if prior is not None:
                known, z = prior
                white = np.concatenate([white, np.column_stack([known @ x - z, known])])
            size = np.linalg.norm(white[:, 1:], axis=0)
            size[size == 0] = 1.0
            step = np.linalg.lstsq(white[:, 1:] / size, -white[:, 0], rcond=1e-10)[0] / size
            x = x + step
            model = self.model_at(x, recording, effects)
            if np.all(np.abs(step) * size < 1e-4):
                break
        left = white[:, 0] + white[:, 1:] @ step
        fit = FitResult(
            x, covariance_of(white[:, 1:]), left @ left, len(left) - len(x), jacobian, left
        )
        return Solution(tuple(effects), fit), model

    def lost(self, solution, recording):
        """Return why a fit is none, or None if it is one."""
        if np.all(np.abs(solution.fit.x[: len(self.first)] - self.first) < 0.3):
            return None
        return "axes or scale factors come out more than 0.3 from those of the data sheet"


class Gyroscope(ReferenceSensor):
    """Rotation over a window, C by the gyroscope from its start, Q by the reference.

        ε = log(Qᵀ C),     δε = Qᵀ ∫ C δw dt      (rad, on the axes at its end)

    T is symmetric: an antisymmetric part is a rotation between the two bodies, each session's own.
    """

    sensor, of, names = "gyroscope", "rotation", ("S01", "S02", "S12", "K0", "K1", "K2")
    kinds: ClassVar = {"reference_rotation": ("rad", 3)}

    def gathered(self, recording):
        """Return the Rotations of the windows, rates less the session's bias, and Q, (m, 3, 3)."""
        key = "gyroscope", self.bias.tobytes()
        if key not in recording._designs:
            session, first, _, last = self.windows(recording)
            at = np.minimum(first[:, None] + np.arange(np.max(last - first) + 1), last[:, None])
            logs = recording.logs
            t, w = (
                np.array([v(logs[s], self.bias[s])[i] for s, i in zip(session, at, strict=True)])
                for v in (lambda log, _: log.t, lambda log, b: log.w - b)
            )
            ends = zip(session, first, last, strict=True)
            Q = [logs[s].attitude[i].T @ logs[s].attitude[j] for s, i, j in ends]
            place = np.arange(len(first))
            rotations = Rotations(place, t[:, 0], t[:, -1], t, w, np.zeros((0, 3)), None)
            recording._designs[key] = rotations, np.array(Q), at
        return recording._designs[key]

    def model_at(self, x, recording, effects):
        """Return the ReferenceModel at parameters x."""
        x = self.start(effects) if x is None else x
        x = np.append(x, np.zeros(len(self.start(effects)) - len(x)))
        session = self.windows(recording)[0]
        rotations, Q, at = self.gathered(recording)
        designs = self.design(recording, effects, x[6:], x[3:6])
        design = np.array([designs[s][i] for s, i in zip(session, at, strict=True)])
        turn = GyroscopeModel(
            np.zeros((0, 3)), np.zeros((0, 3, design.shape[3])), rotations, design, np.zeros((0, 3))
        )
        own = np.concatenate([x[[0, 1, 0, 2, 1, 2]], x[3:6], np.zeros(3), x[6:]])
        path = turn.path(own)
        values = Rotation.from_matrix(Q.swapaxes(1, 2) @ path.last).as_rotvec()
        change = Q.swapaxes(1, 2) @ turn.summed(path.middle, own)
        # T01 T02 T10 T12 T20 T21
        axes = change[:, :, [0, 1, 3]] + change[:, :, [2, 4, 5]]
        turned = change[:, :, [5, 1, 2]] - change[:, :, [3, 4, 0]]
        derivative = np.concatenate([axes, change[:, :, 6:9], change[:, :, 12:]], axis=2)
        nuisance = np.concatenate([change[:, :, 9:12], turned], axis=2)
        return ReferenceModel(values, derivative, nuisance, session, self.weight, x)

    @staticmethod
    def unpack(x):
        """Return T and K of parameters."""
        T = np.eye(3)
        T[[0, 0, 1], [1, 2, 2]] = T[[1, 2, 2], [0, 0, 1]] = x[:3]
        return T, x[3:6]

    def common(self, recording):
        """Return the covariance of the residuals if the reference errs by 1 rad with attitude.

        An error δ of its own axes at both ends changes ε by ``Qᵀ δ₀ - δ₁``.
        """
        session, first, _, last = self.windows(recording)
        _, Q, _ = self.gathered(recording)
        ends = [
            np.array([recording.logs[s].attitude[i] for s, i in zip(session, rows, strict=True)])
            for rows in (first, last)
        ]
        m, both = len(Q), np.concatenate(ends)
        gain = np.concatenate([Q.swapaxes(1, 2), np.tile(-np.eye(3), (m, 1, 1))])
        parts = _alike(both)[:, :, None, None] * np.einsum("iab,jcb->ijac", gain, gain)
        parts = parts.reshape(2, m, 2, m, 3, 3).sum(axis=(0, 2))
        return parts.swapaxes(1, 2).reshape(3 * m, 3 * m)

    def floor(self, recording):
        """Return the variance that the noise of both gives each component, rad², (m,)."""
        session, first, _, last = self.windows(recording)
        white = np.mean([self.noise.axes[a].N.square for a in ("gx", "gy", "gz")])
        length = [
            np.ptp(recording.logs[s].t[[i, j]])
            for s, i, j in zip(session, first, last, strict=True)
        ]
        own = np.array([log.noise[0] for log in recording.logs])[session]
        return 2 * own**2 + white * np.array(length)


class Accelerometer(ReferenceSensor):
    """Second difference of the place, p, over 2 h, with C the reference's attitude.

        r = ∫ tri (C M f) dt / h² - g u - (p(t - h) - 2 p(t) + p(t + h)) / h²      (m/s²)

    M, a small rotation between the two bodies, the tilt of u, which is up, and the bias are those
    of a session.
    """

    sensor, of = "accelerometer", "position"
    names = accelerometer.NAMES[:6]
    kinds: ClassVar = {"reference_force": ("m/s^2", 3)}

    def gathered(self, recording):
        """Return attitude times weight, (m, k, 3, 3), force, rows, second difference and up."""
        if "accelerometer" not in recording._designs:
            session, first, middle, last = self.windows(recording)
            at = np.minimum(first[:, None] + np.arange(np.max(last - first) + 1), last[:, None])
            logs, rows = recording.logs, list(zip(session, at, strict=True))
            C, f, t = (
                np.array([getattr(logs[s], name)[i] for s, i in rows])
                for name in ("attitude", "f", "t")
            )
            h = (t[:, -1] - t[:, 0]) / 2
            middle_s = np.array([logs[s].t[i] for s, i in zip(session, middle, strict=True)])
            steps = np.diff(t, axis=1)
            trapezoid = (np.pad(steps, ((0, 0), (1, 0))) + np.pad(steps, ((0, 0), (0, 1)))) / 2
            weight = np.maximum(h[:, None] - np.abs(t - middle_s[:, None]), 0) * trapezoid
            weight /= weight.sum(axis=1, keepdims=True)
            ends = zip(session, first, middle, last, strict=True)
            place = [logs[s].place[[i, j, k]] for s, i, j, k in ends]
            second = np.array([p[0] - 2 * p[1] + p[2] for p in place]) / h[:, None] ** 2
            carried = C * weight[..., None, None]
            mean = np.einsum("mkij,mkj->mi", carried, f) - second
            up = np.array([np.median(mean[session == s], axis=0) for s in range(len(logs))])
            up = (up / np.linalg.norm(up, axis=1)[:, None])[session]
            recording._designs["accelerometer"] = carried, f, at, second, up, weight
        return recording._designs["accelerometer"]

    def model_at(self, x, recording, effects):
        """Return the ReferenceModel at parameters x."""
        x = self.start(effects) if x is None else x
        x = np.append(x, np.zeros(len(self.start(effects)) - len(x)))
        session = self.windows(recording)[0]
        carried, f, at, second, up, _ = self.gathered(recording)
        T, K = self.unpack(x)
        designs = self.design(recording, effects, x[6:], K)
        design = np.array([designs[s][i] for s, i in zip(session, at, strict=True)])
        raw = f - self.bias[session][:, None]
        output, (m, k) = K * raw - design @ x[6:], f.shape[:2]
        turned = carried.swapaxes(1, 2).reshape(m, 3, 3 * k)
        aligned = output @ T.T
        values = (turned @ aligned.reshape(m, 3 * k, 1))[..., 0]
        values = values - self.gravity * up - second
        of_output = np.einsum("mkai,mkj->maij", carried, output, optimize=True)
        of_raw = np.einsum("mkai,mkj->maij", carried, raw, optimize=True)
        rows, columns = accelerometer.UPPER
        turn = cross_matrix(aligned.reshape(-1, 3)).reshape(m, 3 * k, 3)
        derivative = [
            of_output[:, :, rows, columns],
            np.einsum("maij,ij->maj", of_raw, T),
            -turned @ (T @ design).reshape(m, 3 * k, design.shape[3]),
        ]
        bias = -carried.sum(axis=1) @ (T * K)
        tilt = -self.gravity * cross_matrix(up)
        nuisance = np.concatenate([bias, -turned @ turn, tilt], axis=2)
        derivative = np.concatenate(derivative, axis=2)
        return ReferenceModel(values, derivative, nuisance, session, self.weight, x)

    @staticmethod
    def unpack(x):
        """Return T and K of parameters."""
        T, K, _ = accelerometer.unpack(np.append(x[:6], np.zeros(3)))
        return T, K

    def common(self, recording):
        """Return the covariance of the residuals if the reference errs by 1 rad with attitude.

        An error δ of its own axes tilts gravity: it changes r by ``-g u × C δ``.
        """
        session, _, middle, _ = self.windows(recording)
        rows = zip(session, middle, strict=True)
        C = np.array([recording.logs[s].attitude[i] for s, i in rows])
        gain = self.gravity * cross_matrix(self.gathered(recording)[4]) @ C
        parts = _alike(C)[:, :, None, None] * np.einsum("iab,jcb->ijac", gain, gain)
        return parts.swapaxes(1, 2).reshape((3 * len(C),) * 2)

    def floor(self, recording):
        """Return the variance that the noise of both gives each component, (m/s²)², (m,)."""
        session, *_ = self.windows(recording)
        weight = self.gathered(recording)[-1]
        white = np.mean([self.noise.axes[a].N.square for a in ("ax", "ay", "az")])
        turn, place = np.array([log.noise for log in recording.logs])[session].T
        squares = (weight**2).sum(axis=1)
        step = np.array([np.median(np.diff(log.t)) for log in recording.logs])[session]
        own = self.gravity**2 * turn**2 + white / step
        return own * squares + 6 * place**2 / HALF**4


def _alike(attitudes):
    """Return the correlation of the reference's errors at attitudes, (n, n)."""
    flat = attitudes.reshape(len(attitudes), 9)
    # 1 - cos of the angle between them
    return np.exp(-(3 - flat @ flat.T) / 2 / ALIKE**2)


def started(sensor, recording):
    """Return the sensor with each session's bias, weights all alike."""
    session = sensor.windows(recording)[0]
    sensor = replace(sensor, weight=np.ones(len(session)), bias=np.zeros((len(recording.logs), 3)))
    for _ in range(2):
        model = sensor.model_at(None, recording, ())
        sensor = replace(sensor, bias=sensor.bias + model.nuisances[:, :3])
    return sensor
