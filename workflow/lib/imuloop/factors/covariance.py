"""The covariance of the residuals of the joint fit by the noise of the six channels."""

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from imuloop.core.noise_model import AxisNoise, Coefficient, edges
from imuloop.core.samples import ANGULAR_RATE, CHANNELS
from imuloop.factors.rows import cross_matrix

# number of parts of a move; each has its own mean of the slow noise. One mean per move is not
# enough, as early noise changes the velocity at the end more than late noise
PARTS = 4


class ChannelMeans:
    """Means of the noise of a channel over M windows of a recording, and their covariance.

    The windows are the n rests, then `PARTS` parts of equal length of each of the m moves: M = n +
    `PARTS` m. Slow noise (flicker and random walk) is taken relative to its mean over all rests,
    because that mean is part of the estimated bias.

    Parameters
    ----------
    rests, moves : Poses, Rotations
        The rests, and the moves between them.
    """

    def __init__(self, rests, moves):
        """Compute the M windows from the `rests` and `moves`: start and end of each, s, (M, 2)."""
        self.rests = rests
        ends = np.linspace(moves.start_s, moves.end_s, PARTS + 1)
        parts = np.stack([ends[:-1].T.ravel(), ends[1:].T.ravel()], axis=1)
        self.windows, cycle = np.concatenate([rests.windows, parts]), rests.power_cycle
        cycle = np.append(cycle, np.repeat(cycle[moves.first], PARTS))
        # edges of the windows by power cycle, computed once for all channels
        self.edges = edges(self.windows, cycle)

    @cached_property
    def of_one(self):
        """Covariance of M means of slow noise with a coefficient of one SI unit, a dict of (M, M).

        The means are averages of one channel over M windows: the rests, then parts of the moves.
        The key 'B' stands for flicker, 'K' for random walk. Noise with another coefficient has this
        covariance times the square of the coefficient.
        """
        ones = {term: AxisNoise(**{term: Coefficient(1.0)}) for term in "BK"}
        return {term: self._subtract_mean(self._covariance(one)) for term, one in ones.items()}

    def covariance(self, noise, channel):
        """Return the covariance of M means of one channel by its noise, (M, M), SI units squared.

        The means are averages of the channel over the n rests, then over `PARTS` parts of each
        move. `channel` is the index of the channel, in the order ax … gz, and `noise` is the
        NoiseModel. The variances of rests include errors by rounding and tilts. If the model has
        neither white noise nor quantisation, the scatter of the samples within each rest gives the
        variances of rests instead. White noise in moves is left out: `ResidualCovariance` adds it
        sample by sample.
        """
        rests, model, n = self.rests, noise.axes[CHANNELS[channel]], len(self.rests)
        # only white noise and quantisation: all other noise is slow
        fast = replace(model, B=Coefficient(), K=Coefficient(), gauss_markov=())
        covariance = self._covariance(fast)
        if model.B.square or model.K.square or model.gauss_markov:
            slow = self._subtract_mean(self._covariance(model) - covariance)
        else:
            slow = 0.0
        diagonal = covariance.diagonal().copy()
        if model.N.square or model.Q.square:
            diagonal[:n] += rests.extra_variance[:, channel]
            # the mean over a part of duration T has the variance N²/T by white noise
            diagonal[n:] -= model.N.square / np.ptp(self.windows[n:], axis=1)
        else:
            # white noise is not known: it is estimated by the variance within the rests
            diagonal[:n] += rests.variance[:, channel] / rests.n
        np.fill_diagonal(covariance, diagonal)
        return covariance + slow

    def _covariance(self, model):
        """Return the covariance of the M means of a channel with the noise `model`, (M, M).

        The means are averages over M windows: the rests, then parts of the moves. `model` is an
        AxisNoise, the coefficients of the noise of one channel.
        """
        return model.mean_covariance(self.windows, self.edges)

    def _subtract_mean(self, covariance):
        """Return the covariance, (M, M), of M means minus their average over all rests.

        The M means are averages of the noise of one channel over the rests, then over parts of the
        moves. `covariance`, (M, M), is their covariance before the subtraction. In the average over
        all rests the weight of a rest is its duration. The estimated bias absorbs this average.
        """
        share = np.zeros(len(covariance))
        share[: len(self.rests)] = self.rests.duration_s / self.rests.duration_s.sum()
        centred = covariance - share @ covariance
        return centred - (centred @ share)[:, None]


class ResidualCovariance:
    """The covariance of the residuals of a recording by noise, at given parameters of the sensors.

    The recording has n rests and m moves between them. The noise of each channel enters the
    residuals in two ways:

    - Slow noise, and the noise of rests, enter by M means of the channel: over the rests and over
      `PARTS` parts of each move. The gain is the derivative of the residuals with respect to these
      means.
    - White noise within a move, and errors by undersampling, dropped samples and jitter, enter the
      residuals of that move only. They correlate the residuals of its rotation and its velocity.

    Noise of different power cycles is independent.

    The argument `linearised` is a Linearised: the residuals of the recording and their derivatives,
    at these parameters. The fit uses N of these residuals.
    """

    def __init__(self, linearised):
        """Store the residuals of the moves in `linearised`, and compute the gain of each channel.

        The gain is the derivative of the residuals with respect to the means of the channel over
        rests and over parts of moves.
        """
        measured, self.means = linearised.measured, linearised.measured.recording.means
        self.rests, self.moves, self.counted = measured.rests, measured.moves, measured.counted
        self.rows, self.places = linearised.move_rows, linearised.places
        self.weights = linearised.weights
        self.force, self.force_gain = linearised.force_at_rest, linearised.force.gain
        # few means enter each residual
        self.gains = [csr_array(gain) for gain in self._gains(linearised.rest_rows)]

    def by(self, noise, aliasing=True):
        """Return the covariance, (N, N), that noise gives the N residuals in the fit.

        `noise` is the NoiseModel, the coefficients of the noise of each channel. If `aliasing` is
        true, errors of rotations by undersampling are included; if false, they are left out. Errors
        of rotations by dropped samples and jitter are always included.
        """
        covariance, places, moves = 0.0, self.places, self.moves
        for gain, channel in zip(self.gains, range(6), strict=True):
            covariance = covariance + _propagate(gain, self.means.covariance(noise, channel))
        # (m, a, a): of the a residuals of each move by white noise within it
        white = [noise.axes[name].N.square for name in CHANNELS]
        within = np.tensordot(white, self._within, 1)
        # errors by dropped samples and jitter always count
        within += self._extra(moves.time_covariance + aliasing * moves.aliasing_covariance)
        covariance[places[:, :, None], places[:, None]] += within
        for axis, columns in zip(ANGULAR_RATE, self._tilt_columns, strict=True):
            covariance += noise.axes[axis].N.square * (columns @ columns.T)
        return self._select_counted(covariance)

    def component(self, channel, term):
        """Return the covariance of the N residuals in the fit, (N, N), by one term of slow noise.

        `channel` is the name of the channel that has this noise. `term` is 'B', flicker, or 'K',
        random walk. The coefficient of the noise is one SI unit; the covariance grows with the
        square of the coefficient.
        """
        gain = self.gains[CHANNELS.index(channel)]
        return self._select_counted(_propagate(gain, self.means.of_one[term]))

    def of_aliasing(self):
        """Return the covariance, (N, N), that undersampling gives the N residuals in the fit.

        Undersampling: the samples of a move are too far apart to show all of its motion. Then the
        rotation that is integrated from them has an error, which enters the residuals of this move.
        """
        total, places = np.zeros((len(self.counted),) * 2), self.places
        total[places[:, :, None], places[:, None]] = self._extra(self.moves.aliasing_covariance)
        return self._select_counted(total)

    def _select_counted(self, covariance):
        """Return the part of a covariance that belongs to the N residuals in the fit, (N, N).

        `covariance`, (L, L), belongs to all L residuals of the recording; N of them count in the
        fit.
        """
        counted = self.counted
        return covariance if counted.all() else covariance[np.ix_(counted, counted)]

    @cached_property
    def _within(self):
        """Covariance of the residuals of each move by white noise of density one, (6, m, a, a).

        The axes are the channel that has the noise, in the order ax … gz, the m moves, and twice
        the a residuals of a move. For a channel with another density, its entry is multiplied by
        the square of this density.
        """
        a = self.rows.residual.shape[1]
        by_turn = np.moveaxis(self.rows.by_turn, -1, 0)
        covariance = np.zeros((6, len(self.moves), a, a))
        covariance[3:] = (by_turn * self.moves.steps[..., None]).swapaxes(2, 3) @ by_turn
        if self.rows.by_force is not None:
            by_force = np.moveaxis(self.rows.by_force @ self.force_gain, -1, 0)
            weighted = by_force * self.weights[..., None]
            # the first two residuals belong to the rotation, which the force does not enter
            covariance[:3, :, 2:, 2:] = weighted.swapaxes(2, 3) @ by_force
        return covariance

    def _extra(self, covariance):
        """Return the covariance, (m, a, a), that rotation errors give the a residuals of each move.

        Dropped samples, jitter or undersampling cause these errors. Each of m moves has g errors,
        at g of its time steps. An error is a small rotation, rad, about the three body axes.
        `covariance`, (m, g, 3, 3), rad², has the covariance of each error; different errors are
        independent.
        """
        # (m, g): index of the time step of the move at which the errors of each part enter
        steps = self.moves.extra_at
        gain = self.rows.by_turn[np.arange(len(steps))[:, None], steps]
        return (gain @ covariance @ gain.swapaxes(2, 3)).sum(axis=1)

    @cached_property
    def _tilt_columns(self):
        """A matrix C for each angular rate, (3, L, c), for white noise in rests with a tilt.

        ``C Cᵀ`` is the covariance of all L residuals, also of those that the fit does not use. It
        has one cause: white noise of density one in this rate during rests in which the device
        tilts. C has two columns for each such rest, c in all.

        If the device tilts in a rest of duration T, the direction of gravity at its start and at
        its end follows from the mean direction and a small rotation by the gyroscope. White noise n
        changes these rotations by ``∫ n s/T ds`` to the end and ``-∫ n (1 - s/T) ds`` to the start,
        with the time s since the start of the rest. The variances of both errors are T/3, and their
        covariance is -T/6.
        """
        rests, first, columns = self.rests, self.moves.first, []
        for k in np.flatnonzero(rests.tilt > 0):
            leaving, arriving = np.zeros((2, len(self.counted), 3))
            leaving[self.places[first == k]] = self.rows.by_start[first == k]
            arriving[self.places[first + 1 == k]] = self.rows.by_end[first + 1 == k]
            # two independent columns give these variances and this covariance
            crossed = np.sqrt(rests.duration_s[k] / 3) * cross_matrix(self.force[k])
            columns += [(leaving - arriving / 2) @ crossed, np.sqrt(3) / 2 * arriving @ crossed]
        return np.array(columns).reshape(-1, len(self.counted), 3).transpose(2, 1, 0)

    def _gains(self, rest_rows):
        """Return the derivative of all L residuals with respect to the means of each channel.

        The result is (6, L, M): the six channels in the order ax … gz, the residuals, and M means
        of the channel, first over the n rests, then over `PARTS` parts of each move. The scale
        factors K and the misalignment T of the gyroscope are taken as one, which they are within a
        few percent. `rest_rows` has the residuals at rests and their derivatives, RestRows of
        accelerometer and gyroscope.
        """
        rows, places, n, m = self.rows, self.places, len(self.rests), len(self.moves)
        gains, rests = np.zeros((6, len(self.counted), n + PARTS * m)), np.arange(n)
        # index of the rest before each move, and of the means over its parts
        first, parts = self.moves.first[:, None], n + np.arange(PARTS * m).reshape(m, PARTS, 1)
        # the order of residuals is: n norms of gravity, 3 n rates, then the residuals of moves
        force_gain, rate_gain = (np.moveaxis(sensor.gain, -1, 0) for sensor in rest_rows)
        gains[:3, rests[:, None], rests[:, None]] = force_gain
        gains[3:, n + np.arange(3 * n).reshape(n, 3), rests[:, None]] = rate_gain
        # a time step counts to the part of the move that its middle lies in
        steps, passed = self.moves.steps, self.moves.steps.cumsum(axis=1)
        by_rate = _integrate_parts(rows.by_turn, seconds=steps, passed=passed - steps / 2)
        gains[3:, places[:, None], parts] = np.moveaxis(by_rate, -1, 0)
        gains[:3, places, first] += np.moveaxis(rows.by_start @ self.force_gain, -1, 0)
        gains[:3, places, first + 1] += np.moveaxis(rows.by_end @ self.force_gain, -1, 0)
        if rows.by_force is not None:
            passed = np.pad(passed, ((0, 0), (1, 0)))
            by_raw_force = rows.by_force @ self.force_gain
            by_force = _integrate_parts(by_raw_force, seconds=self.weights, passed=passed)
            # the first two residuals of a move belong to the rotation
            gains[:3, places[:, None, 2:], parts] = np.moveaxis(by_force, -1, 0)
        return gains


def _integrate_parts(values, seconds, passed):
    """Return the integrals over time of values in `PARTS` equal parts of each move.

    The result is (m, `PARTS`, a, 3). Its axes are the moves, the parts of a move, and the two axes
    of a value. `values`, (m, k, a, 3), has k values of shape (a, 3) for each of m moves. `seconds`,
    (m, k), is the time that each value lasts, s. `passed`, (m, k), is the time from the start of
    the move to each value, s; it says which part a value belongs to.
    """
    part = np.minimum((passed / passed.max(axis=1, keepdims=True) * PARTS).astype(int), PARTS - 1)
    weights = (part[:, None] == np.arange(PARTS)[:, None]) * seconds[:, None]
    m, k, a, _ = values.shape
    return (weights @ values.reshape(m, k, 3 * a)).reshape(m, PARTS, a, 3)


def _propagate(gain, covariance):
    """Return the covariance ``G C Gᵀ``, (N, N), of G x, if x has the covariance C, (M, M).

    Here G x are the errors of N residuals by the errors x of M means of a channel. G is the `gain`,
    (N, M), which may be sparse, and C is `covariance`.
    """
    return gain @ (gain @ covariance).T
