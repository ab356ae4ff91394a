"""The covariance of the residuals of the joint fit by the noise of the six channels."""

from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from imuloop.core.samples import ANGULAR_RATE, CHANNELS
from imuloop.factors.directions import cross_matrix
from imuloop.factors.means import PARTS


class ResidualCovariance:
    """The covariance that the noise predicts for the residuals of Linearised factors.

    The noise of each channel enters the residuals in two ways. Slow noise and the noise of rests
    enter by M means, over the n rests and the parts of the m moves (`ChannelMeans`); the gain is
    the derivative of the residuals with respect to these means. White noise within a move, and
    errors by undersampling, dropped samples and jitter, enter the residuals of that move only; they
    correlate its rotation and its velocity. Noise of different power cycles is independent.

    Takes the Linearised factors, which have N residuals that count.
    """

    def __init__(self, at):
        measured, self.means = at.measured, at.measured.recording.means
        self.rests, self.moves, self.counted = measured.rests, measured.moves, measured.counted
        self.rows, self.places, self.weights = at.move_rows, at.places, at.weights
        self.force, self.force_gain = at.force_at_rest, at.force.gain
        # few means enter each residual
        self.gains = [csr_array(gain) for gain in self._gains(at.rest_rows)]

    def by(self, noise, aliasing=True):
        """Return the covariance of the residuals that count by a NoiseModel, (N, N).

        It includes the errors by undersampling if `aliasing` is true.
        """
        covariance, places, moves = 0.0, self.places, self.moves
        for gain, channel in zip(self.gains, range(6), strict=True):
            covariance = covariance + _propagate(gain, self.means.covariance(noise, channel))
        white = [noise.axes[name].N.square for name in CHANNELS]
        within = np.tensordot(white, self._within, 1)
        within += self._extra(moves.time_covariance + aliasing * moves.aliasing_covariance)
        covariance[places[:, :, None], places[:, None]] += within
        for axis, columns in zip(ANGULAR_RATE, self._tilt_columns, strict=True):
            covariance += noise.axes[axis].N.square * (columns @ columns.T)
        return self._select_counted(covariance)

    def component(self, channel, term):
        """Return the covariance of the residuals that count by one noise term of size one, (N, N).

        The term is flicker, 'B', or random walk, 'K', of the channel with the given name.
        """
        gain = self.gains[CHANNELS.index(channel)]
        return self._select_counted(_propagate(gain, self.means.of_one[term]))

    def of_aliasing(self):
        """Return the covariance of the residuals that count by undersampling, (N, N)."""
        total, places = np.zeros((len(self.counted),) * 2), self.places
        total[places[:, :, None], places[:, None]] = self._extra(self.moves.aliasing_covariance)
        return self._select_counted(total)

    def _select_counted(self, covariance):
        """Return the rows and columns of the residuals that count."""
        counted = self.counted
        return covariance if counted.all() else covariance[np.ix_(counted, counted)]

    @cached_property
    def _within(self):
        """Covariance of a move's residuals by white noise of density one, (6, m, a, a)."""
        a = self.rows.residual.shape[1]
        made, turned = np.zeros((6, len(self.moves), a, a)), np.moveaxis(self.rows.by_turn, -1, 0)
        made[3:] = (turned * self.moves.steps[..., None]).swapaxes(2, 3) @ turned
        if self.rows.by_force is not None:
            pushed = np.moveaxis(self.rows.by_force @ self.force_gain, -1, 0)
            made[:3, :, 2:, 2:] = (pushed * self.weights[..., None]).swapaxes(2, 3) @ pushed
        return made

    def _extra(self, covariance):
        """Return the covariance of a move's residuals by errors of its rotation, (m, a, a).

        Takes the covariance of the errors that arise in each part of a rotation, (m, g, 3, 3).
        """
        steps = self.moves.extra_at
        gain = self.rows.by_turn[np.arange(len(steps))[:, None], steps]
        return (gain @ covariance @ gain.swapaxes(2, 3)).sum(axis=1)

    @cached_property
    def _tilt_columns(self):
        """Columns C, (3, N, c), of the covariance ``C Cᵀ`` by white noise of each rate at tilts.

        The direction of gravity at a rest that tilts is turned by the gyroscope to the start or the
        end of the rest, of duration T. White noise n of density one changes these turns by
        ``∫ n s/T ds`` to the end and ``-∫ n (1 - s/T) ds`` to the start, with the time s since the
        start. Their variances are T/3, their covariance is -T/6.
        """
        rests, first, columns = self.rests, self.moves.first, []
        for k in np.flatnonzero(rests.tilt > 0):
            leaving, arriving = np.zeros((2, len(self.counted), 3))
            leaving[self.places[first == k]] = self.rows.by_start[first == k]
            arriving[self.places[first + 1 == k]] = self.rows.by_end[first + 1 == k]
            crossed = np.sqrt(rests.duration_s[k] / 3) * cross_matrix(self.force[k])
            columns += [(leaving - arriving / 2) @ crossed, np.sqrt(3) / 2 * arriving @ crossed]
        return np.array(columns).reshape(-1, len(self.counted), 3).transpose(2, 1, 0)

    def _gains(self, rest_rows):
        """Return the derivative of all residuals with respect to the M means, (6, N, M).

        K and T of the gyroscope are taken as one, which they are within a few percent. Takes the
        RestRows of both sensors.
        """
        rows, places, n, m = self.rows, self.places, len(self.rests), len(self.moves)
        gains, rests = np.zeros((6, len(self.counted), n + PARTS * m)), np.arange(n)
        first, parts = self.moves.first[:, None], n + np.arange(PARTS * m).reshape(m, PARTS, 1)
        force_gain, rate_gain = (np.moveaxis(sensor.gain, -1, 0) for sensor in rest_rows)
        gains[:3, rests[:, None], rests[:, None]] = force_gain
        gains[3:, n + np.arange(3 * n).reshape(n, 3), rests[:, None]] = rate_gain
        steps, passed = self.moves.steps, self.moves.steps.cumsum(axis=1)
        turned = _integrate_parts(rows.by_turn, steps, passed - steps / 2)
        gains[3:, places[:, None], parts] = np.moveaxis(turned, -1, 0)
        gains[:3, places, first] += np.moveaxis(rows.by_start @ self.force_gain, -1, 0)
        gains[:3, places, first + 1] += np.moveaxis(rows.by_end @ self.force_gain, -1, 0)
        if rows.by_force is not None:
            passed = np.pad(passed, ((0, 0), (1, 0)))
            pushed = _integrate_parts(rows.by_force @ self.force_gain, self.weights, passed)
            gains[:3, places[:, None, 2:], parts] = np.moveaxis(pushed, -1, 0)
        return gains


def _integrate_parts(values, seconds, passed):
    """Return integrals of values, (m, k, a, 3), over the parts of each move, (m, parts, a, 3).

    Takes the duration of each value and its time since the start of the move, s, (m, k) each.
    """
    part = np.minimum((passed / passed.max(axis=1, keepdims=True) * PARTS).astype(int), PARTS - 1)
    weights = (part[:, None] == np.arange(PARTS)[:, None]) * seconds[:, None]
    m, k, a, _ = values.shape
    return (weights @ values.reshape(m, k, 3 * a)).reshape(m, PARTS, a, 3)


def _propagate(gain, covariance):
    """Return ``G C Gᵀ`` of a gain G, (N, M), and a covariance C, (M, M)."""
    return gain @ (gain @ covariance).T
