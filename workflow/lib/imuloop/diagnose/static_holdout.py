"""Held-out errors of static records: each block of time predicted by the others."""

import numpy as np

from imuloop.diagnose.search import HeldOut, ratio_interval
from imuloop.diagnose.static_estimate import output
from imuloop.diagnose.static_model import block_of, folds
from imuloop.diagnose.static_noise import mean_covariance


class Blocks:
    """Blocks of time of every record, each held out once, and their errors.

    Parameters
    ----------
    model : StaticModel
        Model.
    searches : sequence of StaticSearch
        One a fold, that does not see its blocks.
    """

    def __init__(self, model, searches):
        self.model, self.searches = model, tuple(searches)
        self.folds = folds(model.records, len(self.searches))

    def know(self, steps):
        """Let every search take the steps of a trial of all data, or none."""
        for search in self.searches:
            search.steps = steps

    def errors(self, chosen):
        """Return the error of every mean, the level that of the other blocks.

        Parameters
        ----------
        chosen : sequence of tuple of Pattern
            The effects of each search.

        Returns
        -------
        list of ndarray, shape (n, 3)
            One a record, SI.
        """
        found = [np.empty_like(r.values) for r in self.model.records]
        for fold, (search, base) in enumerate(zip(self.searches, chosen, strict=True)):
            for i, record in enumerate(self.model.records):
                held = self.folds[i] == fold
                left = record.values - output(search, base, i)
                found[i][held] = left[held] - left[~held].mean(axis=0)
        return found

    def floor(self, noise):
        """Return the variance that noise alone gives the errors without effects.

        ``var(e_h - mean e_s)`` with s the means that are seen: the slow noise at the windows of
        the fit, the rest at the means' own.

        Parameters
        ----------
        noise : sequence of three AxisNoise
            Of the sensor's axes.

        Returns
        -------
        list of ndarray, shape (n, 3)
            One a record, SI squared.
        """
        return [self._floor(noise, i) for i in range(len(self.model.records))]

    def _floor(self, noise, i):
        record, fitted = self.model.records[i], self.model.fitted[i]
        at = np.searchsorted(fitted.windows[:, 0], record.windows[:, 0], side="right") - 1
        blocks = block_of(fitted, len(self.searches))
        found = np.empty_like(record.values)
        for axis, process in enumerate(noise):
            c = mean_covariance(process, fitted.windows)
            variance = np.empty(len(c))
            for block in np.unique(blocks):
                held = blocks == block
                shared = c[np.ix_(held, ~held)].mean(axis=1)
                variance[held] = np.diag(c)[held] - 2 * shared + c[np.ix_(~held, ~held)].mean()
            fast = [
                process.N.square / length + 2 * process.Q.square / length**2
                for length in (record.length, fitted.length[at])
            ]
            found[:, axis] = variance[at] + fast[0] - fast[1]
        return found

    def ratio_interval(self, before, after, settings):
        """Return the 95 % interval of held-out error after over before, blocks drawn again.

        Parameters
        ----------
        before, after : list of ndarray, shape (n, 3)
            Errors of each record.
        settings : DiagnoseSettings
            Draws and seed.
        """
        number = np.concatenate([f + len(self.searches) * i for i, f in enumerate(self.folds)])
        return ratio_interval(
            HeldOut(number, np.concatenate(before), np.concatenate(after)), settings
        )
