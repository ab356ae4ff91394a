"""The covariance of the residuals of both sensors by the noise of their six channels."""

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from imuloop.calibrate import accelerometer
from imuloop.calibrate.gyroscope import cross_matrix
from imuloop.calibrate.undersampling import PARTS as ALIASED
from imuloop.core.noise_model import AxisNoise, Coefficient, edges
from imuloop.core.samples import ANGULAR_RATE, CHANNELS

# parts of a move over each of which slow noise has a mean: early noise moves a velocity more
PARTS = 4


class PairCovariance:
    """The covariance of the residuals of a PairModel that the noise predicts.

    Every channel has means at the poses and over parts of each move; what each makes of a residual
    is the gain. What a move has of slow noise the poses beside it have too; noise of different
    power cycles is independent. White noise within a move, and errors of its time stamps, enter its
    rotation and its velocity alike.
    """

    def __init__(self, x, model, recording):
        self.model, self.poses, self.rotations = model, recording.poses, model.turn.rotations
        self.of_force, self.moves = model.at(x)[0], model.moves_at(x)
        # few means enter each residual
        self.gains = [csr_array(gain) for gain in self._gains()]

    def by(self, noise, aliasing=True):
        """Return the covariance of the residuals that count by a noise model, shape (N, N).

        With what samples too far apart lose, or as if they were close enough.
        """
        found = 0.0
        for gain, axis in zip(self.gains, range(6), strict=True):
            found = found + _through(gain, self._mean_covariance(noise, axis))
        white, at = [noise.axes[name].N.square for name in CHANNELS], self.model.moves
        extra = self._extra_covariance(slice(None) if aliasing else slice(ALIASED, None))
        found[at[:, :, None], at[:, None]] += np.tensordot(white, self.within, 1) + extra
        for axis, columns in zip(ANGULAR_RATE, self.tilted, strict=True):
            found += noise.axes[axis].N.square * (columns @ columns.T)
        return self._counted(found)

    def component(self, axis, term):
        """Return that of flicker, 'B', or walk, 'K', of one channel alone, of size one."""
        gain = self.gains[CHANNELS.index(axis)]
        return self._counted(_through(gain, self._of_one[term]))

    @cached_property
    def _of_one(self):
        """Covariance of the means by flicker and by walk of size one, the bias taken out."""
        ones = {term: AxisNoise(**{term: Coefficient(1.0)}) for term in "BK"}
        return {
            term: self._about_mean(one.mean_covariance(self._windows, self._edges))
            for term, one in ones.items()
        }

    def of_aliasing(self):
        """Return what samples too far apart add to the covariance of the residuals that count."""
        found, at = np.zeros((len(self.model.counted),) * 2), self.model.moves
        found[at[:, :, None], at[:, None]] = self._extra_covariance(slice(ALIASED))
        return self._counted(found)

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
    def _windows(self):
        """Windows of all means, at the poses and over parts of the moves, s, (M, 2)."""
        poses, rotations = self.poses, self.rotations
        edges = np.linspace(rotations.start_s, rotations.end_s, PARTS + 1)
        parts = np.stack([edges[:-1].T.ravel(), edges[1:].T.ravel()], axis=1)
        return np.concatenate([poses.windows, parts])

    @cached_property
    def _edges(self):
        """What the covariances of all axes share."""
        cycle = self.poses.power_cycle
        moves = np.repeat(cycle[self.rotations.first], PARTS)
        return edges(self._windows, np.append(cycle, moves))

    def _mean_covariance(self, noise, axis):
        """Return the covariance of one channel's means at the poses and over the moves.

        `AxisNoise.mean_covariance`, and `extra_variance` of the poses.
        """
        poses, model, n = self.poses, noise.axes[CHANNELS[axis]], len(self.poses)
        fast = replace(model, B=Coefficient(), K=Coefficient(), gauss_markov=())
        whole = quick = model.mean_covariance(self._windows, self._edges)
        if fast != model:
            quick = fast.mean_covariance(self._windows, self._edges)
        slow, diagonal = self._about_mean(whole - quick), quick.diagonal().copy()
        if model.N.square or model.Q.square:
            diagonal[:n] += poses.extra_variance[:, axis]
            # white noise within a move does not act as its mean does
            diagonal[n:] -= model.N.square / np.ptp(self._windows[n:], axis=1)
        else:
            # where white noise is not known, the variance within the poses is taken for it
            diagonal[:n] += poses.variance[:, axis] / poses.n
        np.fill_diagonal(quick, diagonal)
        return quick + slow

    @cached_property
    def within(self):
        """Covariance of a move's residuals by white noise of each channel, (6, m, w, w)."""
        width, (T, K, _) = self.moves.values.shape[1], accelerometer.unpack(self.of_force)
        found = np.zeros((6, len(self.rotations), width, width))
        for axis in range(3):
            own = self.moves.by_turn[..., axis]
            found[3 + axis] = (own * self.rotations.steps[..., None]).swapaxes(1, 2) @ own
            if self.model.along:
                own = (self.moves.by_force @ (T * K))[..., axis]
                weighted = own * self.model.weights[..., None]
                found[axis, :, 2:, 2:] = weighted.swapaxes(1, 2) @ own
        return found

    def _extra_covariance(self, part):
        """Return what time stamps, and samples too far apart, add to the residuals, (m, w, w)."""
        at, extra = (x[:, part] for x in (self.rotations.extra_at, self.rotations.extra_covariance))
        gain = self.moves.by_turn[np.arange(len(at))[:, None], at]
        return (gain @ extra @ gain.swapaxes(2, 3)).sum(axis=1)

    def _by_part(self, change, seconds, passed):
        """Return integrals over each part of each move, (m, parts, w, 3).

        Takes what is integrated, (m, k, w, 3), the time that each stands for, and the time since
        the start of the move, s, (m, k).
        """
        part = (passed / passed.max(axis=1, keepdims=True) * PARTS).astype(int)
        inside = np.minimum(part, PARTS - 1)[:, None] == np.arange(PARTS)[:, None]
        return np.einsum("mpk,mkwa->mpwa", inside * seconds[:, None], change)

    @cached_property
    def tilted(self):
        """Effect of white noise of each rate on residuals where a rest tilts, (3, N, k).

        A direction at a tilted pose is turned by the gyroscope to where its rotation starts or
        ends. With white noise n over T those turns are off by ``∫ n s/T ds`` to the end and
        ``-∫ n (1 - s/T) ds`` to the start: variances of T/3, and a covariance of -T/6.
        """
        poses, first, rows = self.poses, self.rotations.first, self.model.moves
        force, found = self.model.force.values(self.of_force), []
        for k in np.flatnonzero(poses.tilt > 0):
            leaving, arriving = np.zeros((2, len(self.model.counted), 3))
            leaving[rows[first == k]] = self.moves.by_start[first == k]
            arriving[rows[first + 1 == k]] = self.moves.by_end[first + 1 == k]
            crossed = np.sqrt(poses.duration_s[k] / 3) * cross_matrix(force[[k]])[0]
            found += [(leaving - arriving / 2) @ crossed, np.sqrt(3) / 2 * arriving @ crossed]
        return np.array(found).reshape(-1, len(self.model.counted), 3).transpose(2, 1, 0)

    def _gains(self):
        """Return what each channel's mean at a pose or over a part of a move adds, (6, N, M)."""
        model, moves, n, m = self.model, self.moves, len(self.poses), len(self.rotations)
        T, K, _ = accelerometer.unpack(self.of_force)
        force = model.force.values(self.of_force)
        norm = (force / np.linalg.norm(force, axis=1)[:, None]) @ T * K
        gains, poses = np.zeros((6, len(model.counted), n + PARTS * m)), np.arange(n)
        for axis in range(3):
            gains[axis, poses, poses] = norm[:, axis]
        first, rows = self.rotations.first[:, None], model.moves
        parts = n + np.arange(PARTS * m).reshape(m, PARTS, 1)
        started, ended = moves.by_start @ (T * K), moves.by_end @ (T * K)
        steps, passed = self.rotations.steps, self.rotations.steps.cumsum(axis=1)
        turned = self._by_part(moves.by_turn, steps, passed - steps / 2)
        if model.along:
            passed = np.pad(passed, ((0, 0), (1, 0)))
            pushed = self._by_part(moves.by_force @ (T * K), model.weights, passed)
        for axis in range(3):
            gains[axis, rows, first] += started[..., axis]
            gains[axis, rows, first + 1] += ended[..., axis]
            gains[3 + axis, n + 3 * poses + axis, poses] = 1.0
            gains[3 + axis, rows[:, None], parts] = turned[..., axis]
            if model.along:
                gains[axis, rows[:, None, 2:], parts] = pushed[..., axis]
        return gains


def _through(gain, covariance):
    """Return ``G C Gᵀ``."""
    return gain @ (gain @ covariance).T
