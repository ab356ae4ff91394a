"""The covariance of the mean noise of a channel at rests and over parts of moves."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient, edges
from imuloop.core.samples import CHANNELS

# number of parts of a move with a mean of slow noise each: early noise changes the velocity at the
# end more than late noise
PARTS = 4


class ChannelMeans:
    """Means of the noise of a channel over windows: the n rests, then the parts of the m moves.

    Slow noise is taken relative to its mean over all rests, because that mean is part of the bias.

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
        """Covariance of the means, (M, M), by flicker, 'B', and random walk, 'K', of size one."""
        ones = {term: AxisNoise(**{term: Coefficient(1.0)}) for term in "BK"}
        return {term: self._subtract_mean(self._covariance(one)) for term, one in ones.items()}

    def covariance(self, noise, channel):
        """Return the covariance of the M means of a channel, (M, M), SI units squared.

        It is the sum of the covariance by the NoiseModel `noise` and the variance of the rests by
        rounding and tilts. `channel` is the index of the channel.
        """
        rests, model, n = self.rests, noise.axes[CHANNELS[channel]], len(self.rests)
        fast = replace(model, B=Coefficient(), K=Coefficient(), gauss_markov=())
        covariance = self._covariance(fast)
        if model.B.square or model.K.square or model.gauss_markov:
            slow = self._subtract_mean(self._covariance(model) - covariance)
        else:
            slow = 0.0
        diagonal = covariance.diagonal().copy()
        if model.N.square or model.Q.square:
            diagonal[:n] += rests.extra_variance[:, channel]
            # `ResidualCovariance` adds the white noise within a move sample by sample
            diagonal[n:] -= model.N.square / np.ptp(self.windows[n:], axis=1)
        else:
            # white noise is not known: it is estimated by the variance within the rests
            diagonal[:n] += rests.variance[:, channel] / rests.n
        np.fill_diagonal(covariance, diagonal)
        return covariance + slow

    def _covariance(self, model):
        """Return the covariance of the means, (M, M), by an AxisNoise."""
        return model.mean_covariance(self.windows, self.edges)

    def _subtract_mean(self, covariance):
        """Return the covariance of the means less their mean over all rests, (M, M)."""
        share = np.zeros(len(covariance))
        share[: len(self.rests)] = self.rests.duration_s / self.rests.duration_s.sum()
        centred = covariance - share @ covariance
        return centred - (centred @ share)[:, None]
