"""The covariance of the residuals of both sensors by the noise of their six channels."""

import math
from dataclasses import replace
from functools import cached_property

import numpy as np

from imuloop.calibrate import accelerometer
from imuloop.calibrate.gyroscope import cross_matrix
from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.core.samples import ANGULAR_RATE, CHANNELS

# parts of a move over each of which slow noise has a mean: early noise moves a velocity more
PARTS = 4


class PairCovariance:
    """The covariance of the residuals of a PairModel that the noise predicts.

    Every channel has means at the poses and over parts of each move; what each makes of a residual
    is the gain. What a move has of slow noise the poses beside it have too; noise of different runs
    is independent. White noise within a move, and errors of its time stamps, enter its rotation and
    its velocity alike.
    """

    def __init__(self, x, model, recording):
        self.model, self.poses = model, recording.poses
        self.of_force, self.of_turn, self.turn = model.at(x)
        self.rotations = self.turn.rotations if self.turn else recording.rotations.select([])
        if self.turn:
            self._along_moves()
        self.gains = self._gains()
        if model.y is not None:
            self.gains = np.array([model.given_rotation(gain) for gain in self.gains])

    def by(self, noise):
        """Return the covariance of the residuals that count by a noise model, shape (N, N)."""
        found = 0.0
        for gain, axis in zip(self.gains, range(6), strict=True):
            found = found + gain @ self._of_means(noise, axis) @ gain.T
        if self.turn and len(self.rotations):
            white = [noise.axes[name].N.square for name in CHANNELS]
            at = self.model.moves
            found[at[:, :, None], at[:, None]] += np.tensordot(white, self.within, 1) + self.added
            for axis, columns in zip(ANGULAR_RATE, self.tilted, strict=True):
                found += noise.axes[axis].N.square * (columns @ columns.T)
        return self._counted(found)

    def component(self, axis, term):
        """Return that of flicker, 'B', or walk, 'K', of one channel alone, of size one."""
        one = AxisNoise(**{term: Coefficient(1.0)})
        gain, means = self.gains[CHANNELS.index(axis)], np.zeros((self.gains.shape[2],) * 2)
        for own, windows, _, _ in self._runs:
            means[np.ix_(own, own)] = one.mean_covariance(windows)
        return self._counted(gain @ self._about_mean(means) @ gain.T)

    def _about_mean(self, means):
        """Return a covariance of means less the mean over all rests: the bias is that mean."""
        share = np.zeros(len(means))
        share[: len(self.poses)] = self.poses.duration_s / self.poses.duration_s.sum()
        left = means - share @ means
        return left - (left @ share)[:, None]

    def _counted(self, covariance):
        counted = self.model.counted
        return covariance if counted.all() else covariance[np.ix_(counted, counted)]

    @cached_property
    def _runs(self):
        """Of each run the places of its means, their windows, its poses and its parts of moves."""
        poses, found = self.poses, []
        edges = np.linspace(self.rotations.start_s, self.rotations.end_s, PARTS + 1)
        ends = np.stack([edges[:-1].T.ravel(), edges[1:].T.ravel()], axis=1)
        of_run = np.repeat(poses.run[self.rotations.first], PARTS)
        for run in np.unique(poses.run):
            at, moves = np.flatnonzero(poses.run == run), np.flatnonzero(of_run == run)
            windows = np.concatenate([poses.windows[at], ends[moves]])
            found.append((np.append(at, len(poses) + moves), windows, at, moves))
        return found

    def _of_means(self, noise, axis):
        """Return the covariance of one channel's means at the poses and over the moves."""
        poses, model = self.poses, noise.axes[CHANNELS[axis]]
        fast = replace(model, B=Coefficient(), K=Coefficient(), gauss_markov=())
        means, slow = np.zeros((2, *(self.gains.shape[2],) * 2))
        for own, windows, at, moves in self._runs:
            whole, quick = (each.mean_covariance(windows) for each in (model, fast))
            rest, turned = np.arange(len(at)), len(at) + np.arange(len(moves))
            slow[np.ix_(own, own)] = whole - quick
            if whole.any():
                # white noise within a move does not act as its mean does
                quick[turned, turned] -= model.N.square / np.diff(windows[len(at) :])[:, 0]
                if poses.added is not None:
                    quick[rest, rest] += poses.added[at, axis]
            else:
                # of a channel without noise the poses' own variance is known
                quick[rest, rest] = poses.variance[at, axis] / poses.n[at]
            means[np.ix_(own, own)] = quick
        return means + self._about_mean(slow)

    def _along_moves(self):
        """Find what turns in the middle of each step, white noise and stamps make of residuals."""
        model, turn, rotations = self.model, self.turn, self.rotations
        self.path = path = turn.path(self.of_turn)
        self.carried = turn.plane @ path.last.swapaxes(1, 2)
        # error of each move per turn on the axes at its start, in the middle of each step
        per_turn = (self.carried @ cross_matrix(turn.departures))[:, None]
        T, K, _ = accelerometer.unpack(self.of_force)
        m, steps = path.steps.shape
        per_turn = np.broadcast_to(per_turn, (m, steps, 2, 3))
        if model.y is not None:
            self.frame = model.frame(turn)
            levers = self.frame[:, None] @ model.levers(self.of_force, path)
            levers = levers - model.of_rotation[:, None] @ per_turn
            per_turn = np.concatenate([per_turn, levers], axis=2)
        turned = per_turn @ path.middle
        passed = path.steps.cumsum(axis=1)
        weighted = turned * path.steps[..., None, None]
        self.turned = self._by_part(weighted, passed - path.steps / 2)
        width = per_turn.shape[2]
        self.within, self.added = np.zeros((6, m, width, width)), np.zeros((m, width, width))
        for axis in range(3):
            own = turned[..., axis]
            self.within[3 + axis] = (own * path.steps[..., None]).swapaxes(1, 2) @ own
            if model.y is not None:
                pushed = (self.frame[:, None] @ model.attitudes(path) @ (T * K))[..., axis]
                own = np.pad(pushed, ((0, 0), (0, 0), (2, 0)))
                self.within[axis] = (own * model.weights[..., None]).swapaxes(1, 2) @ own
        if rotations.added is not None:
            at = np.arange(m)[:, None], rotations.added_at
            gain = turned[at]
            self.added = (gain @ rotations.added @ gain.swapaxes(2, 3)).sum(axis=1)

    def _by_part(self, values, passed):
        """Return sums over each part of each move, (m, parts, …), of values (m, k, …).

        `passed` is the time since the start of the move, s, (m, k).
        """
        part = (passed / passed.max(axis=1, keepdims=True) * PARTS).astype(int)
        inside = np.minimum(part, PARTS - 1)[:, None] == np.arange(PARTS)[:, None]
        flat = values.reshape(*passed.shape, math.prod(values.shape[2:]))
        return (inside.astype(float) @ flat).reshape(*inside.shape[:2], *values.shape[2:])

    @cached_property
    def tilted(self):
        """What white noise of each rate makes of residuals where a rest tilts, (3, N, k).

        A direction at a tilted pose is turned by the gyroscope to where its rotation starts or
        ends. With white noise n over T those turns are off by ``∫ n s/T ds`` to the end and
        ``-∫ n (1 - s/T) ds`` to the start: variances of T/3, and a covariance of -T/6.
        """
        poses, first = self.poses, self.rotations.first
        found = []
        for k in np.flatnonzero(poses.tilt > 0 if poses.tilt is not None else []):
            leaving, arriving = np.zeros((2, self.gains.shape[1], 3))
            rows = self.model.moves[:, :2]
            for move in np.flatnonzero(first == k):
                leaving[rows[move]] += self.carried[move]
            for move in np.flatnonzero(first + 1 == k):
                arriving[rows[move]] -= self.turn.plane[move]
            crossed = np.sqrt(poses.duration_s[k] / 3) * np.cross(
                np.eye(3), self.turn.directions[k]
            )
            found += [(leaving - arriving / 2) @ crossed, np.sqrt(3) / 2 * arriving @ crossed]
        if self.model.y is not None:
            found = [self.model.given_rotation(columns) for columns in found]
        return np.array(found).reshape(-1, self.gains.shape[1], 3).transpose(2, 1, 0)

    def _gains(self):
        """Return what each channel's mean at a pose or over a part of a move adds, (6, N, M)."""
        model, turn, n, m = self.model, self.turn, len(self.poses), len(self.rotations)
        T, K, _ = accelerometer.unpack(self.of_force)
        force = model.force.force(self.of_force)
        norm = (force / np.linalg.norm(force, axis=1)[:, None]) @ T * K
        rows = n + (3 * n + (5 if model.y is not None else 2) * m if turn else 0)
        gains, poses = np.zeros((6, rows, n + PARTS * m)), np.arange(n)
        for axis in range(3):
            gains[axis, poses, poses] = norm[:, axis]
        if not turn:
            return gains
        first, move = turn.rotations.first, model.moves
        parts = n + np.arange(PARTS * m).reshape(m, PARTS)
        across = model.across(self.of_force) @ (T * K)
        begun, ended = self.carried @ across[first], -turn.plane @ across[first + 1]
        if model.y is not None:
            pull = model.force.gravity * model.weights.sum(axis=1)[:, None, None]
            weighted = model.attitudes(self.path) * model.weights[..., None, None]
            passed = np.pad(self.path.steps.cumsum(axis=1), ((0, 0), (1, 0)))
            pushed = self.frame[:, None] @ self._by_part(weighted, passed) @ (T * K)
            begun = np.concatenate([begun, -pull * self.frame @ across[first]], axis=1)
        # the turned means of velocities are already less what the rotation says
        turned = self.turned.copy()
        if model.y is not None:
            turned[:, :, 2:] += model.of_rotation[:, None] @ turned[:, :, :2]
        for axis in range(3):
            gain = gains[axis]
            gain[move, first[:, None]] += begun[:, :, axis]
            gain[move[:, :2], first[:, None] + 1] += ended[:, :, axis]
            if model.y is not None:
                gain[move[:, None, 2:], parts[..., None]] = pushed[..., axis]
            gain = gains[3 + axis]
            gain[n + 3 * poses + axis, poses] = 1.0
            gain[move[:, None], parts[..., None]] = turned[..., axis]
        return gains
