"""The covariance of the mean noise of a channel at rests and over parts of moves."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient, edges
from imuloop.core.samples import CHANNELS

# number of parts of a move with a mean of slow noise each: one mean per move is not enough, as
# early noise changes the velocity at the end more than late noise
PARTS = 4


class ChannelMeans:
    """Means of the noise of a channel over M windows: the n rests, then the parts of the m moves.

    Each move has `PARTS` parts of equal length. Slow noise (flicker and random walk) is taken
    relative to its mean over all rests, because that mean is part of the bias.

    Parameters
    ----------
    rests, moves : Poses, Rotations
        The rests, and the moves between them.
    """

    def __init__(self, rests, moves):
        self.rests = rests
        ends = np.linspace(moves.start_s, moves.end_s, PARTS + 1)
        parts = np.stack([ends[:-1].T.ravel(), ends[1:].T.ravel()], axis=1)
        self.windows, cycle = np.concatenate([rests.windows, parts]), rests.power_cycle
        cycle = np.append(cycle, np.repeat(cycle[moves.first], PARTS))
        # computed once for all channels
        self.edges = edges(self.windows, cycle)

    @cached_property
    def of_one(self):
        """Covariance of the M means, (M, M), by slow noise with a coefficient of one SI unit.

        It is a dict with the keys 'B', flicker, and 'K', random walk.
        """
        ones = {term: AxisNoise(**{term: Coefficient(1.0)}) for term in "BK"}
        return {term: self._subtract_mean(self._covariance(one)) for term, one in ones.items()}

    def covariance(self, noise, channel):
        """Return the covariance of the M means of a channel, (M, M), SI units squared.

        It is the sum of the covariance by the NoiseModel `noise` and the variance that rounding and
        tilts add to the rests. The white noise of moves is left out: `ResidualCovariance` adds it
        sample by sample. `channel` is the index of the channel, in the order ax … gz.
        """
        rests, model, n = self.rests, noise.axes[CHANNELS[channel]], len(self.rests)
        # white noise and quantization alone; the rest is slow
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
        """Return the covariance of the M means, (M, M), by an AxisNoise, the noise of a channel."""
        return model.mean_covariance(self.windows, self.edges)

    def _subtract_mean(self, covariance):
        """Return the covariance, (M, M), of the M means less the mean over all rests.

        `covariance`, (M, M), is that of the means themselves. Rests count by their duration.
        """
        share = np.zeros(len(covariance))
        share[: len(self.rests)] = self.rests.duration_s / self.rests.duration_s.sum()
        centred = covariance - share @ covariance
        return centred - (centred @ share)[:, None]
