"""Multi-position model of a gyroscope: its rotations carry gravity from pose to pose."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from imuloop.calibrate.poses import Rotations
from imuloop.core.effect import effect_design
from imuloop.core.rotation import exponential, matrix, multiply, prefix_product, step_vectors
from imuloop.core.samples import ANGULAR_RATE, CHANNELS

# parameters of the base model
NAMES = ("T01", "T02", "T10", "T12", "T20", "T21", "K0", "K1", "K2", "b0", "b1", "b2")
_OFF_DIAGONAL = ((0, 0, 1, 1, 2, 2), (1, 2, 0, 2, 0, 1))


def unpack(x):
    """Return T (3, 3), K (3,) and b (3,) of the parameters in the order of `NAMES`."""
    T = np.eye(3)
    T[_OFF_DIAGONAL] = x[:6]
    return T, x[6:9], x[9:12]


@dataclass(frozen=True)
class AttitudePath:
    """What residuals and covariances take of the attitude C along m rotations.

    C takes body axes to those at the start of the rotation.
    """

    last: np.ndarray  # C at the end, (m, 3, 3)
    middle: np.ndarray  # C at the middle of each step, (m, k - 1, 3, 3)
    steps: np.ndarray  # s
    after: np.ndarray  # quaternions of C after each step, (m, k - 1, 4)
    added: np.ndarray | None  # covariance of time stamps, on axes at the start, rad², (m, 3, 3)

    @cached_property
    def mean(self):
        """``∫ C dt``, s, (m, 3, 3)."""
        return np.einsum("mkij,mk->mij", self.middle, self.steps)

    @cached_property
    def spread(self):
        """``∫ c cᵀ dt`` with c the column of C of each axis of the sensor, s, (m, 3, 3, 3)."""
        columns = self.middle.transpose(0, 3, 2, 1)
        return (columns * self.steps[:, None, None]) @ columns.swapaxes(2, 3)


@dataclass(frozen=True)
class GyroscopeModel:
    """``w = T (K (y - b) - e)``, from the mean rate of n poses and every rotation between them."""

    # mean angular rate of each pose, rad/s as logged, (n, 3), and the derivative of e, (n, 3, p)
    rate: np.ndarray
    rate_design: np.ndarray
    rotations: Rotations  # m of k samples
    rotation_design: np.ndarray  # the derivative of e along them, (m, k, 3, p)
    directions: np.ndarray  # unit vector of calibrated specific force at each pose, (n, 3)
    # turns from there to the start and to the end of a pose, rad, (n, 3) or zero
    to_start: np.ndarray | float = 0.0
    to_end: np.ndarray | float = 0.0
    # part of e that is known, rad/s, (n, 3) and (m, k, 3)
    rate_known: np.ndarray | float = 0.0
    rotation_known: np.ndarray | float = 0.0
    # the last path, which depends on no direction: residuals and covariance at one x share it
    _paths: dict = field(default_factory=dict, compare=False, repr=False)

    def start(self):
        """Return parameters to start from: as logged, the mean rate of the poses as bias."""
        effects = np.zeros(self.rate_design.shape[2])
        return np.concatenate([np.zeros(6), np.ones(3), self.rate.mean(axis=0), effects])

    def pose_rates(self, x):
        """Return ``K (y - b) - e`` at the poses, zero at rest, and its derivative.

        On the sensor's own axes, rad/s, shape (n, 3); the derivative has (n, 3, 12 + p).
        """
        _, K, b = unpack(x)
        jacobian = np.zeros((len(self.rate), 3, len(x)))
        axes = np.arange(3)
        jacobian[:, axes, 6 + axes] = self.rate - b
        jacobian[:, axes, 9 + axes] = -K
        jacobian[:, :, 12:] = -self.rate_design
        return K * (self.rate - b) - self.rate_known - self.rate_design @ x[12:], jacobian

    def path(self, x):
        """Return the AttitudePath with parameters x."""
        key = np.asarray(x, dtype=float).tobytes()
        if key not in self._paths:
            self._paths.clear()
            self._paths[key] = self._path(x)
        return self._paths[key]

    def _path(self, x):
        rotations, rates = self.rotations, self.output(x) @ unpack(x)[0].T
        half = exponential(step_vectors(rates, rotations.steps, rotations.uneven) / 2)
        after = prefix_product(multiply(half, half))
        # the middle of a step is half a step back from its end
        half[..., 1:] *= -1
        middle = matrix(multiply(after, half))
        return AttitudePath(
            matrix(after[:, -1]), middle, rotations.steps, after, self._added(middle)
        )

    def output(self, x):
        """Return ``K (y - b) - e`` along the rotations, rad/s, (m, k, 3)."""
        _, K, b = unpack(x)
        found = K * (self.rotations.w - b) - self.rotation_known
        # effects of a search are hundreds, and zero about the fit without them
        return found - self.rotation_design @ x[12:] if x[12:].any() else found

    def summed(self, middle, x):
        """Return ``∫ A (dw/dx) dt`` of matrices A in the middle of each step, (m, 3, 12 + p).

        Takes (m, k - 1, 3, 3). A step's rate is the mean of those at its ends.
        """
        T, K, b = unpack(x)
        m, k = self.rotations.w.shape[:2]
        # half of each step to the samples at its ends: entry of A, sample
        half = (middle * (self.rotations.steps[..., None, None] / 2)).reshape(m, k - 1, 9)
        entries = np.zeros((m, 9, k))
        entries[:, :, 1:] = half.swapaxes(1, 2)
        entries[:, :, :-1] += half.swapaxes(1, 2)
        # moments: entry of A, axis
        of_raw, of_output = (
            (entries @ seen).reshape(m, 3, 3, 3) for seen in (self.rotations.w - b, self.output(x))
        )
        found = np.zeros((m, 3, len(x)))
        found[:, :, :6] = of_output[:, :, *_OFF_DIAGONAL]
        found[:, :, 6:9] = np.einsum("maij,ij->maj", of_raw, T)
        found[:, :, 9:12] = -entries.sum(axis=2).reshape(m, 3, 3) @ (T * K)
        if len(x) > 12:
            seen = (T.T @ entries.reshape(m, 3, 3, k)).swapaxes(2, 3).reshape(m, 3, 3 * k)
            found[:, :, 12:] = -seen @ self.rotation_design.reshape(m, 3 * k, -1)
        return found

    def _added(self, middle):
        """Return the covariance that time stamps add, each error turned by the attitude there."""
        rotations = self.rotations
        if rotations.added is None:
            return None
        attitude = middle[np.arange(len(middle))[:, None], rotations.added_at]
        return (attitude @ rotations.added @ attitude.swapaxes(2, 3)).sum(axis=1)

    def rotation_errors(self, x):
        """Return the angle between predicted and measured gravity, and its derivative.

        With C the attitude, ``u_end = Cᵀ u_start`` and a small change of rate δw gives
        ``δu_end = Cᵀ (u_start × φ), φ = ∫ C(t) δw(t) dt``. In the plane normal to the measured
        direction, rad, (m, 2); the derivative has (m, 2, 12 + p).
        """
        path, start = self.path(x), self.departures
        across = cross_matrix(start) @ self.summed(path.middle, x)
        return self.angles(x), self.plane @ (path.last.swapaxes(1, 2) @ across)

    def angles(self, x):
        """Return the angles of `rotation_errors` alone."""
        turned = np.einsum("mji,mj->mi", self.path(x).last, self.departures)
        return np.einsum("mij,mj->mi", self.plane, turned)

    @cached_property
    def plane(self):
        """Two unit vectors normal to the measured direction after each rotation, (m, 2, 3)."""
        return tangents(self._turned(self.to_start)[self.rotations.first + 1])

    @cached_property
    def departures(self):
        """Direction of gravity where each rotation starts, (m, 3)."""
        return self._turned(self.to_end)[self.rotations.first]

    def _turned(self, turns):
        """Return the directions at the poses after small turns from there, (n, 3)."""
        return self.directions + np.cross(self.directions, np.broadcast_to(turns, self.rate.shape))

    def residuals(self, x):
        """Return all residuals in one vector, and their derivative."""
        rates, of_rates = self.pose_rates(x)
        errors, of_errors = self.rotation_errors(x)
        parts = [each.reshape(-1, len(x)) for each in (of_rates, of_errors)]
        return np.concatenate([rates.ravel(), errors.ravel()]), np.concatenate(parts)

    def covariance(self, x, poses, directions, noise):
        """Return the covariance of all residuals that the noise model predicts: rates, rotations.

        Angular rate: white noise is turned by the attitude while it is summed; slow noise acts like
        a bias of each rotation (`slow_covariance`). Time stamps: what lost samples and scatter add.
        Gravity: the error of a pose's direction enters the rotation before and the one after it;
        `directions`, (3 n, 3 n), is their covariance. Ordered pose by pose, the three axes of each
        together, then rotation by rotation; (rad/s)² and rad², shape (3 n + 2 m, 3 n + 2 m).
        """
        rotations, path, n, m = self.rotations, self.path(x), len(poses), len(self.rotations)
        plane = self.plane
        # error in the plane per rotation vector on the axes at the start: P Cᵀ [u ×]
        carried = plane @ path.last.swapaxes(1, 2)
        to_error = carried @ cross_matrix(self.departures)
        # the two components of each rotation's error
        pairs = 3 * n + 2 * np.arange(m)[:, None] + [0, 1]
        # what the means at the poses and over the rotations make of a residual
        gains, at, turns = np.zeros((3, 3 * n + 2 * m, n + m)), np.arange(n), n + np.arange(m)
        for axis, gain in enumerate(gains):
            gain[3 * at + axis, at] = 1.0
            gain[pairs, turns[:, None]] = (to_error @ path.mean)[..., axis]
        covariance = slow_covariance(poses, rotations, noise, gains, ANGULAR_RATE)
        within = sum(
            noise.axes[name].N.square * (to_error @ path.spread[:, axis] @ to_error.swapaxes(1, 2))
            for axis, name in enumerate(ANGULAR_RATE)
        )
        if path.added is not None:
            within = within + to_error @ path.added @ to_error.swapaxes(1, 2)
        covariance[pairs[:, :, None], pairs[:, None]] += within
        # of all directions only those of the poses at both ends enter a rotation
        of_ends = ((rotations.first, carried), (rotations.first + 1, -plane))
        by_pose = directions.reshape(n, 3, 3 * n)
        half = sum(of_end @ by_pose[pose] for pose, of_end in of_ends).reshape(2 * m, n, 3)
        whole = sum(np.einsum("xmk,mjk->xmj", half[:, pose], of_end) for pose, of_end in of_ends)
        covariance[3 * n :, 3 * n :] += whole.reshape(2 * m, 2 * m)
        return covariance


def slow_covariance(poses, rotations, noise, gains, channels):
    """Return the covariance of N residuals by noise of means at n poses and over m rotations.

    `gains`, (c, N, n + m), are what the means of each channel make of a residual. What a rotation
    has of slow noise the poses beside it have too; noise of different runs is independent. White
    noise within a rotation is left out: it does not act as its mean does.
    """
    covariance, means = np.zeros((gains.shape[1],) * 2), poses.mean_covariance(noise)
    ends, of_run = np.column_stack([rotations.start_s, rotations.end_s]), poses.run[rotations.first]
    for run in np.unique(poses.run):
        at, turns = np.flatnonzero(poses.run == run), np.flatnonzero(of_run == run)
        together = noise.pose_mean_covariance(np.concatenate([poses.windows[at], ends[turns]]))
        own, turned = np.arange(len(at)), len(at) + np.arange(len(turns))
        for gain, name in zip(gains, channels, strict=True):
            axis = CHANNELS.index(name)
            slow = np.array(together[axis])
            if slow.any():
                slow[turned, turned] -= noise.axes[name].N.square / np.ptp(ends[turns], axis=1)
                if poses.added is not None:
                    slow[own, own] += poses.added[at, axis]
            else:
                # of an axis without noise the poses' own variance is known
                slow[np.ix_(own, own)] = means[axis][np.ix_(at, at)]
            seen = gain[:, np.concatenate([at, len(poses) + turns])]
            covariance += seen @ slow @ seen.T
    return covariance


def midpoints(values):
    """Return the means of neighbours along the second axis."""
    return (values[:, 1:] + values[:, :-1]) / 2


def tangents(directions):
    """Return two unit vectors normal to each direction and to each other, shape (n, 2, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def cross_matrix(vectors):
    """Return the matrices of ``v ×``, shape (n, 3, 3)."""
    return np.cross(np.eye(3), vectors[:, None])


def gyroscope_model(recording, force, x=None, effects=(), known=()):
    """Return the model of a Recording's rates at rest and rotations, beside its Force.

    With effects to estimate and known FittedEffects, which depend on the output with K and b of
    the parameters x; as logged without.
    """
    _, K, b = (None, 1.0, 0.0) if x is None else unpack(x)
    values = () if x is None else x[len(NAMES) :]
    rotations, shape = recording.rotations, recording.rotations.w.shape

    def output(y):
        return K * (y - b)

    poses = recording.pose_channels("gyroscope", output, force.poses)
    design = np.zeros((*shape, sum(len(effect.parameters) for effect in effects)))
    added = 0.0
    if len(rotations) and (effects or known):
        along = recording.rotation_channels("gyroscope", output, force.rotations)
        design = effect_design(effects, along, values).reshape(design.shape)
        added = sum(effect.output(along).reshape(shape) for effect in known)
    return GyroscopeModel(
        rate=recording.poses.w,
        rate_design=effect_design(effects, poses, values),
        rotations=rotations,
        rotation_design=design,
        directions=force.poses / np.linalg.norm(force.poses, axis=1, keepdims=True),
        to_start=recording.poses.to_start,
        to_end=recording.poses.to_end,
        rate_known=sum(effect.output(poses) for effect in known),
        rotation_known=added,
    )
