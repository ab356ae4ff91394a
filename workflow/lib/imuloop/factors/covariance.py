"""The covariance of all residuals by the noise of the six channels."""

from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from imuloop.core.samples import ANGULAR_RATE, CHANNELS
from imuloop.factors.directions import cross_matrix
from imuloop.factors.means import PARTS


class ResidualCovariance:
    """The covariance that the noise predicts of Linearised factors.

    Every channel has means over windows, at the n rests and over parts of the m moves; what each
    adds to a residual is the gain. What a move has of slow noise the rests beside it have too;
    noise of different power cycles is independent. White noise within a move, and errors of its
    time stamps, enter its rotation and its velocity alike.
    """

    def __init__(self, at):
        measured, self.means = at.measured, at.measured.recording.means
        self.rests, self.moves, self.counted = measured.rests, measured.moves, measured.counted
        self.rows, self.places, self.weights = at.move_rows, at.places, at.weights
        self.force, self.force_gain = at.force_at_rest, at.force.gain
        # few means enter each residual
        self.gains = [csr_array(gain) for gain in self._gains(at.rest_rows)]

    def by(self, noise, aliasing=True):
        """Return the covariance of the residuals that count by a NoiseModel, shape (N, N).

        With what samples too far apart lose, or as if they were close enough.
        """
        covariance, places = 0.0, self.places
        for gain, channel in zip(self.gains, range(6), strict=True):
            covariance = covariance + _through(gain, self.means.covariance(noise, channel))
        white = [noise.axes[name].N.square for name in CHANNELS]
        within = np.tensordot(white, self._within, 1)
        within += self._extra(self.moves.errors(aliasing=aliasing))
        covariance[places[:, :, None], places[:, None]] += within
        for axis, columns in zip(ANGULAR_RATE, self._tilted, strict=True):
            covariance += noise.axes[axis].N.square * (columns @ columns.T)
        return self._chosen(covariance)

    def component(self, channel, term):
        """Return that of flicker, 'B', or walk, 'K', of one channel alone, of size one."""
        return self._chosen(_through(self.gains[CHANNELS.index(channel)], self.means.of_one[term]))

    def of_aliasing(self):
        """Return what samples too far apart add to the covariance of the residuals that count."""
        found, places = np.zeros((len(self.counted),) * 2), self.places
        found[places[:, :, None], places[:, None]] = self._extra(self.moves.errors(others=False))
        return self._chosen(found)

    def _chosen(self, covariance):
        counted = self.counted
        return covariance if counted.all() else covariance[np.ix_(counted, counted)]

    @cached_property
    def _within(self):
        """Covariance of a move's residuals by white noise of each channel, (6, m, a, a)."""
        a = self.rows.residual.shape[1]
        made, turned = np.zeros((6, len(self.moves), a, a)), np.moveaxis(self.rows.by_turn, -1, 0)
        made[3:] = (turned * self.moves.steps[..., None]).swapaxes(2, 3) @ turned
        if self.rows.by_force is not None:
            pushed = np.moveaxis(self.rows.by_force @ self.force_gain, -1, 0)
            made[:3, :, 2:, 2:] = (pushed * self.weights[..., None]).swapaxes(2, 3) @ pushed
        return made

    def _extra(self, errors):
        """Return what errors of turns about some steps add to the residuals, (m, a, a)."""
        at, covariance = errors
        gain = self.rows.by_turn[np.arange(len(at))[:, None], at]
        return (gain @ covariance @ gain.swapaxes(2, 3)).sum(axis=1)

    @cached_property
    def _tilted(self):
        """Effect of white noise of each rate on residuals where a rest tilts, (3, N, k).

        A direction at a tilted rest is turned by the gyroscope to where its move starts or ends.
        With white noise n over T those turns are off by ``∫ n s/T ds`` to the end and
        ``-∫ n (1 - s/T) ds`` to the start: variances of T/3, and a covariance of -T/6.
        """
        rests, first, found = self.rests, self.moves.first, []
        for k in np.flatnonzero(rests.tilt > 0):
            leaving, arriving = np.zeros((2, len(self.counted), 3))
            leaving[self.places[first == k]] = self.rows.by_start[first == k]
            arriving[self.places[first + 1 == k]] = self.rows.by_end[first + 1 == k]
            crossed = np.sqrt(rests.duration_s[k] / 3) * cross_matrix(self.force[k])
            found += [(leaving - arriving / 2) @ crossed, np.sqrt(3) / 2 * arriving @ crossed]
        return np.array(found).reshape(-1, len(self.counted), 3).transpose(2, 1, 0)

    def _gains(self, rest_rows):
        """Return what each channel's mean at a rest or over a part of a move adds, (6, N, M).

        Calibrated rates are as good as those logged: K and T are one but for percents.
        """
        rows, places, n, m = self.rows, self.places, len(self.rests), len(self.moves)
        gains, rests = np.zeros((6, len(self.counted), n + PARTS * m)), np.arange(n)
        first, parts = self.moves.first[:, None], n + np.arange(PARTS * m).reshape(m, PARTS, 1)
        of_force, of_turn = (np.moveaxis(own.gain, -1, 0) for own in rest_rows)
        gains[:3, rests[:, None], rests[:, None]] = of_force
        gains[3:, n + np.arange(3 * n).reshape(n, 3), rests[:, None]] = of_turn
        steps, passed = self.moves.steps, self.moves.steps.cumsum(axis=1)
        turned = _by_part(rows.by_turn, steps, passed - steps / 2)
        gains[3:, places[:, None], parts] = np.moveaxis(turned, -1, 0)
        gains[:3, places, first] += np.moveaxis(rows.by_start @ self.force_gain, -1, 0)
        gains[:3, places, first + 1] += np.moveaxis(rows.by_end @ self.force_gain, -1, 0)
        if rows.by_force is not None:
            passed = np.pad(passed, ((0, 0), (1, 0)))
            pushed = _by_part(rows.by_force @ self.force_gain, self.weights, passed)
            gains[:3, places[:, None, 2:], parts] = np.moveaxis(pushed, -1, 0)
        return gains


def _by_part(change, seconds, passed):
    """Return integrals over each part of each move, (m, parts, a, 3).

    Takes what is integrated, (m, k, a, 3), the time that each stands for, and the time since the
    start of the move, s, (m, k).
    """
    part = np.minimum((passed / passed.max(axis=1, keepdims=True) * PARTS).astype(int), PARTS - 1)
    weights = (part[:, None] == np.arange(PARTS)[:, None]) * seconds[:, None]
    m, k, a, _ = change.shape
    return (weights @ change.reshape(m, k, 3 * a)).reshape(m, PARTS, a, 3)


def _through(gain, covariance):
    """Return ``G C Gᵀ``."""
    return gain @ (gain @ covariance).T
