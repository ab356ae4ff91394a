"""The covariance of means of a channel at the rests and over parts of the moves of a recording."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient, edges
from imuloop.core.samples import CHANNELS

# parts of a move over each of which slow noise has a mean: early noise moves a velocity more
PARTS = 4


class ChannelMeans:
    """Means of a channel over windows: at the n rests, then over parts of the m moves.

    Takes the Poses and the Rotations. Slow noise is that about the mean over all rests: the bias is
    that mean.
    """

    def __init__(self, rests, moves):
        self.rests = rests
        ends = np.linspace(moves.start_s, moves.end_s, PARTS + 1)
        parts = np.stack([ends[:-1].T.ravel(), ends[1:].T.ravel()], axis=1)
        self.windows, cycle = np.concatenate([rests.windows, parts]), rests.power_cycle
        cycle = np.append(cycle, np.repeat(cycle[moves.first], PARTS))
        # what the covariances of all channels share
        self.edges = edges(self.windows, cycle)

    @cached_property
    def of_one(self):
        """Covariance of the means by flicker, 'B', and by walk, 'K', of size one."""
        ones = {term: AxisNoise(**{term: Coefficient(1.0)}) for term in "BK"}
        return {term: self._about_mean(self._of(one)) for term, one in ones.items()}

    def covariance(self, noise, channel):
        """Return the covariance of one channel's means by a NoiseModel, with rounding and tilts."""
        rests, model, n = self.rests, noise.axes[CHANNELS[channel]], len(self.rests)
        fast = replace(model, B=Coefficient(), K=Coefficient(), gauss_markov=())
        made = self._of(fast)
        if model.B.square or model.K.square or model.gauss_markov:
            slow = self._about_mean(self._of(model) - made)
        else:
            slow = 0.0
        diagonal = made.diagonal().copy()
        if model.N.square or model.Q.square:
            diagonal[:n] += rests.extra_variance[:, channel]
            # white noise within a move does not act as its mean does
            diagonal[n:] -= model.N.square / np.ptp(self.windows[n:], axis=1)
        else:
            # where white noise is not known, the variance within the rests is taken for it
            diagonal[:n] += rests.variance[:, channel] / rests.n
        np.fill_diagonal(made, diagonal)
        return made + slow

    def _of(self, model):
        return model.mean_covariance(self.windows, self.edges)

    def _about_mean(self, covariance):
        share = np.zeros(len(covariance))
        share[: len(self.rests)] = self.rests.duration_s / self.rests.duration_s.sum()
        left = covariance - share @ covariance
        return left - (left @ share)[:, None]
