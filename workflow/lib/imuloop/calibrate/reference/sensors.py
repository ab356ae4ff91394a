"""Both sensors beside a reference: rotations against attitudes, specific force against places."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.accelerometer import SpecificForce
from imuloop.calibrate.gyroscope import GyroscopeModel, cross_matrix
from imuloop.calibrate.least_squares import Solution, fit, known_rows
from imuloop.calibrate.poses import Rotations
from imuloop.calibrate.prior import GENERIC
from imuloop.calibrate.raw_units import as_logged, si_factor
from imuloop.calibrate.recording import OWN
from imuloop.calibrate.reference.recording import HALF
from imuloop.calibrate.reference.session_nuisances import ReferenceModel
from imuloop.core.effect import Channels, effect_design
from imuloop.core.model import SensorCalibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE

# of the set-up, not of the sensor
BESIDE = ("time_offset", "clock_drift", "lever_arm")
# what says nothing of axes and scale factors
UNFITTED = ("nominal", "static")
# rad; attitudes closer than this have errors of the reference in common: the same markers are seen
ALIKE = 0.35
# what turns T about each axis: T01 T02 T10 T12 T20 T21
TURN = np.array([[0, 0, 0, -1, 0, 1], [0, 1, 0, 0, -1, 0], [-1, 0, 1, 0, 0, 0]]).T


@dataclass(frozen=True, eq=False)
class ReferenceSensor:
    """A sensor beside a reference.

    The state is that of its calibration: T, K, b and the effects that other records show, then
    those of a fit beside the reference. Each session has a bias of its own: no window depends on b.
    """

    noise: NoiseModel
    gravity: float
    known: SensorCalibration  # by the other records
    weight: np.ndarray | None = None  # inverse variance of each window, (m,)
    # of each session, SI as logged: biases to start from
    bias: np.ndarray | None = None

    @property
    def fitted(self):
        """Whether other records show axes and scale factors."""
        return self.known.method not in UNFITTED

    @cached_property
    def effects(self):
        """The FittedEffects of the state."""
        names = {name.partition(".")[0] for name in self.known.names}
        return tuple(e for e in self.known.effects if self.fitted and e.name in names)

    @property
    def shown(self):
        """Those of them that act on its windows alike: not by time, temperature or the set-up."""
        each = ((e, e.effect) for e in self.effects)
        return [f for f, e in each if not (e.name in BESIDE or e.timed or e.needs)]

    @cached_property
    def state(self):
        """The state as other records have it, SI as logged, (p,)."""
        base = as_logged(self.known, self.base)
        return np.concatenate([base, *(e.vector for e in self.effects)])

    @property
    def names(self):
        """Names of the state's entries."""
        return self.known.names if self.fitted else self.base

    @cached_property
    def covariance(self):
        """Covariance of the state by other records, (p, p)."""
        factor = si_factor(self.known.names, self.known.raw_unit)
        return self.known.covariance * np.outer(factor, factor)

    def prior_rows(self):
        """Return rows R, (k, p), and z of what is known of the state: ``R x - z`` of variance one.

        By other records. Where these show nothing, of what no window depends on: the bias, here
        of a session each, and how a gyroscope's axes lie, by its data sheet.
        """
        rows = known_rows(self.covariance) if self.fitted else self.unseen
        return rows, rows @ self.state

    def white(self, channels):
        """Return the mean of the squares of white noise of some channels."""
        return np.mean([self.noise.axes[c].N.square for c in channels])

    def rows(self, recording):
        """Return the window that each residual is of, twice, (N, 2), and its kind, (N,)."""
        window = np.repeat(np.arange(len(self.windows(recording))), 3)
        return np.column_stack([window, window]), np.zeros(len(window), int)

    def model(self, solution, recording, shapes=()):
        """Return the ReferenceModel about a solution, with more effects."""
        x = np.append(solution.fit.x, np.zeros(sum(len(e.parameters) for e in shapes)))
        return self.model_at(x, recording, (*solution.effects, *shapes))

    def derivative(self, solution, recording, shapes, base):
        """Return what more effects, of size zero, add to the residuals of a recording, (N, q).

        The model about the solution without them has nothing that is the same with them.
        """
        count = sum(len(e.parameters) for e in shapes)
        model = self.model(solution, recording, shapes)
        _, jacobian = model.residuals(np.append(solution.fit.x, np.zeros(count)))
        return jacobian[:, -count:]

    def seen(self, x):
        """Return the places of parameters that windows may depend on, those of `shown` effects."""
        hidden = [np.full(len(e.values), e not in self.shown) for e in self.effects]
        hidden = np.flatnonzero(np.concatenate([np.zeros(len(self.base), bool), *hidden]))
        return np.delete(np.arange(len(x)), hidden)

    def design(self, own, recording, effects):
        """Return the derivative of e over whole logs, (N, 3, q) by session, at seen parameters."""
        found, (_, K, _) = [], self.unpack(own)
        effects = (*(e.effect for e in self.shown), *effects)
        for log, b in zip(recording.logs, self.bias, strict=True):
            y, other = (getattr(log, name) for name in OWN[self.sensor])
            channels = Channels(log.t, K * (y - b), other, log.temperature)
            found.append(effect_design(effects, channels, own[len(self.base) :]))
        return found

    def _model(self, windows, values, change, nuisance, x):
        """Return the ReferenceModel, by its derivative with respect to what is seen."""
        derivative = np.zeros((*values.shape, len(x)))
        derivative[:, :, self.seen(x)] = change
        # each session has a bias of its own
        derivative[:, :, len(self.base) - 3 : len(self.base)] = 0.0
        return ReferenceModel(values, derivative, nuisance, windows.session, self.weight, x)

    def fit(self, recording, effects, start, prior):
        """Return the Solution for a recording, from parameters and rows of `prior_rows`' kind."""

        def residuals(x):
            return self.model_at(x, recording, effects).residuals()

        return Solution(effects, fit(residuals, start, np.repeat(1 / self.weight, 3), prior))

    def rejection_reason(self, solution, recording):
        """Return why a fit is none, or None if it is one."""
        T, K, _ = self.unpack(solution.fit.x)
        if np.all(np.abs(T - np.eye(3)) < 0.3) and np.all(np.abs(K - 1) < 0.3):
            return None
        return "axes or scale factors come out more than 0.3 from those of the data sheet"


class Gyroscope(ReferenceSensor):
    """Rotation over a window, C by the gyroscope from its start, Q by the reference.

        ε = log(Qᵀ C),     δε = Qᵀ ∫ C δw dt      (rad, on the axes at its end)

    A rotation between the two bodies is each session's own: no window depends on that of T.
    """

    sensor, base = "gyroscope", gyroscope.NAMES
    kinds: ClassVar = {"reference_rotation": ("rad", 3)}
    unpack = staticmethod(gyroscope.unpack)
    unseen = np.vstack(
        [
            np.pad(TURN.T / 2 / GENERIC["accelerometer"].misalignment, ((0, 0), (0, 6))),
            np.eye(12)[9:],
        ]
    )

    @staticmethod
    def windows(recording):
        """Return the windows of a recording."""
        return recording.turns

    @cached_property
    def axes(self):
        """Rotation to the axes of T as other records have it, (3, 3)."""
        return Rotation.from_matrix(self.unpack(self.state)[0]).as_matrix()

    def ends(self, turns):
        """Return attitudes where windows start and end, and Q on the axes of T, (m, 3, 3) each."""
        start, end = (turns.of_logs("attitude", rows) for rows in (turns.first, turns.last))
        return start, end, self.axes @ start.swapaxes(1, 2) @ end @ self.axes.T

    def rates(self, solution, recording):
        """Return calibrated rates of each log, (N, 3), on the axes that the reference has."""
        model, own = self.model(solution, recording), solution.fit.x[self.seen(solution.fit.x)]
        (T, K, _), biases = self.unpack(own), self.bias + model.nuisances[:, :3]
        designs = self.design(own, recording, solution.effects)
        each = zip(recording.logs, biases, designs, strict=True)
        return [(K * (log.w - b) - D @ own[12:]) @ T.T @ self.axes for log, b, D in each]

    def model_at(self, x, recording, effects=()):
        """Return the ReferenceModel at parameters x."""
        turns, own = recording.turns, x[self.seen(x)]
        t, w = turns.of_logs("t"), turns.of_logs("w") - self.bias[turns.session][:, None]
        rotations = Rotations(np.arange(len(t)), t[:, 0], t[:, -1], t, w, np.zeros((0, 3)), None)
        design, none = turns.of_logs(self.design(own, recording, effects)), np.zeros((0, 3))
        model = GyroscopeModel(none, none[..., None], rotations, design, none)
        own[9:12] = 0.0
        path, back = model.path(own), self.ends(turns)[2].swapaxes(1, 2)
        values = Rotation.from_matrix(back @ path.last).as_rotvec()
        change = back @ model.summed(path.middle, own)
        # a turn M of the axes makes M C Mᵀ of C
        turn = back @ (np.eye(3) - path.last)
        nuisance = np.concatenate([change[:, :, 9:12], turn], axis=2)
        if not self.fitted:
            # on axes of its own T is symmetric
            change[:, :, :6] -= change[:, :, :6] @ TURN @ TURN.T / 2
        return self._model(turns, values, change, nuisance, x)

    def common(self, recording):
        """Return the covariance of the residuals if the reference errs by 1 rad with attitude.

        An error δ of its own axes at both ends changes ε by ``Qᵀ δ₀ - δ₁``.
        """
        start, end, Q = self.ends(recording.turns)
        gain = np.concatenate([Q.swapaxes(1, 2), np.tile(-np.eye(3), (len(Q), 1, 1))])
        both, m = _common(np.concatenate([start, end]), gain), 3 * len(Q)
        return both.reshape(2, m, 2, m).sum(axis=(0, 2))

    def floor(self, recording):
        """Return the variance that the noise of both gives each component, rad², (m,)."""
        turns = recording.turns
        own = np.array([log.noise[0] for log in recording.logs])[turns.session]
        return 2 * own**2 + self.white(ANGULAR_RATE) * np.ptp(turns.of_logs("t"), axis=1)


class Accelerometer(ReferenceSensor):
    """Second difference of the place, p, over 2 h, with C the reference's attitude.

        r = ∫ tri (C M f) dt / h² - g u - (p(t - h) - 2 p(t) + p(t + h)) / h²      (m/s²)

    M, a small rotation between the two bodies, the tilt of u, which is up, and the bias are those
    of a session.
    """

    sensor, base = "accelerometer", accelerometer.NAMES
    kinds: ClassVar = {"reference_force": ("m/s^2", 3)}
    unpack = staticmethod(accelerometer.unpack)
    unseen = np.eye(9)[6:]

    @staticmethod
    def windows(recording):
        """Return the windows of a recording."""
        return recording.places

    def model_at(self, x, recording, effects=()):
        """Return the ReferenceModel at parameters x."""
        places, own = recording.places, x[self.seen(x)]
        f = places.of_logs("f") - self.bias[places.session][:, None]
        m, k, _ = f.shape
        model = SpecificForce(f, places.of_logs(self.design(own, recording, effects)))
        own[6:9] = 0.0
        # of each window the sum over its samples is one product
        C, force = places.attitudes.swapaxes(1, 2).reshape(m, 3, 3 * k), model.values(own)
        values = (C @ force.reshape(m, 3 * k, 1))[..., 0]
        values = values - self.gravity * places.up - places.acceleration
        change = model.summed(places.attitudes, own)
        turn = -C @ cross_matrix(force.reshape(m * k, 3)).reshape(m, 3 * k, 3)
        tilt = -self.gravity * cross_matrix(places.up)
        nuisance = np.concatenate([change[:, :, 6:9], turn, tilt], axis=2)
        return self._model(places, values, change, nuisance, x)

    def common(self, recording):
        """Return the covariance of the residuals if the reference errs by 1 rad with attitude.

        An error δ of its own axes tilts gravity: it changes r by ``-g u × C δ``.
        """
        places = recording.places
        C = places.of_logs("attitude", places.middle)
        return _common(C, self.gravity * cross_matrix(places.up) @ C)

    def floor(self, recording):
        """Return the variance that the noise of both gives each component, (m/s²)², (m,)."""
        places = recording.places
        each = [(*log.noise, np.median(np.diff(log.t))) for log in recording.logs]
        turn, place, step = np.array(each)[places.session].T
        own = self.gravity**2 * turn**2 + self.white(ACCELERATION) / step
        return own * (places.weights**2).sum(axis=1) + 6 * place**2 / HALF**4


SENSORS = {cls.sensor: cls for cls in (Accelerometer, Gyroscope)}


def _common(attitudes, gain):
    """Return the covariance of ``A δ``, A (n, 3, 3), if δ is alike where attitudes are, (3 n,)²."""
    flat = attitudes.reshape(len(attitudes), 9)
    # 1 - cos of the angle between them
    alike = np.exp(-(3 - flat @ flat.T) / 2 / ALIKE**2)
    parts = np.einsum("ij,iab,jcb->iajc", alike, gain, gain, optimize=True)
    return parts.reshape((3 * len(attitudes),) * 2)


def started(sensor, recording):
    """Return the sensor with each session's bias, weights all alike."""
    weight = np.ones(len(sensor.windows(recording)))
    sensor = replace(sensor, weight=weight, bias=np.zeros((len(recording.logs), 3)))
    for _ in range(2):
        model = sensor.model_at(sensor.state, recording)
        sensor = replace(sensor, bias=sensor.bias + model.nuisances[:, :3])
    return sensor
