"""Held-out errors of static records: each block of time predicted by the others alone."""

from dataclasses import dataclass, field

import numpy as np

from imuloop.diagnose.search import HeldOut, ratio_interval
from imuloop.diagnose.static_estimate import output
from imuloop.diagnose.static_model import block_of, fold_of, without
from imuloop.diagnose.static_noise import mean_covariance
from imuloop.diagnose.static_search import StaticSearch, StaticTrial


@dataclass(frozen=True)
class Passed:
    """An effect that passed the test and the held-out data.

    Attributes
    ----------
    trial : StaticTrial
        Its trial beside those before it.
    before, after : list of ndarray, shape (n, 1)
        Held-out errors without and with it, each record's, on the axis where it shows most: the
        noise of the others says nothing of it.
    ratio : list of float
        95 % interval of the ratio of these errors.
    """

    trial: StaticTrial
    before: list
    after: list
    ratio: list


@dataclass(frozen=True)
class Choice:
    """What a search adds.

    Attributes
    ----------
    base : tuple of Pattern
        Patterns, each in the shape that is best beside the others.
    passed : tuple of Passed
        The same in the order in which they passed.
    failed : dict of type to list of float
        Interval of the ratio of those that passed the test alone.
    """

    base: tuple = ()
    passed: tuple[Passed, ...] = ()
    failed: dict = field(default_factory=dict)


class Blocks:
    """Blocks of time of every record, and the searches that do not see some of them.

    Parameters
    ----------
    model : StaticModel
        Model.
    shapes : dict of type to tuple of Pattern
        The effects whose shapes are listed.
    settings : DiagnoseSettings
        Settings.
    tests : int
        Number of tests of the family.
    """

    def __init__(self, model, shapes, settings, tests):
        self.model, self.shapes, self.settings, self.tests = model, shapes, settings, tests
        self.count = settings.blocks
        self.folds = [fold_of(r, model, self.count) for r in model.records]
        self.searches, self._choices = {}, {}

    def search(self, out=frozenset()):
        """Return the search that lacks some blocks."""
        if out not in self.searches:
            sight = without(self.model, out, self.count)
            arguments = self.shapes, self.settings.significance, self.tests
            self.searches[out] = StaticSearch(sight, *arguments)
        return self.searches[out]

    def errors(self, chosen, out=frozenset()):
        """Return the error of every mean, each block predicted by what is seen without it.

        Parameters
        ----------
        chosen : callable
            Takes the blocks that are not seen, returns the patterns.
        out : frozenset of int
            Blocks that nobody sees at all.

        Returns
        -------
        list of ndarray, shape (n, 3)
            One a record, SI, the level that of the means that are seen; nan in the blocks `out`.
        """
        found = [np.full_like(r.values, np.nan) for r in self.model.records]
        for block in set(range(self.count)) - out:
            unseen = out | {block}
            search, base = self.search(unseen), chosen(unseen)
            for i, record in enumerate(self.model.records):
                held, seen = self.folds[i] == block, ~np.isin(self.folds[i], list(unseen))
                left = record.values - output(search, base, [p.means[i] for p in base])
                found[i][held] = left[held] - left[seen].mean(axis=0)
            search.sight.release()
        return found

    def following(self, classes, out=frozenset()):
        """Return the errors with given effects, shapes and times found again for each block."""
        return self.errors(lambda unseen: self.search(unseen).following(classes), out)

    def choice(self, out=frozenset()):
        """Return the Choice of the search that lacks some blocks.

        The best effect that passes the test is added if it lowers the error of blocks that are
        held out of what is seen here; then everything is tested again, until nothing passes.
        """
        if out not in self._choices:
            self._choices[out] = self._choice(out)
        return self._choices[out]

    def _choice(self, out):
        search, base, passed, failed = self.search(out), (), (), {}
        while best := search.best(base, failed):
            classes = tuple(type(p.trial.pattern.effect) for p in passed)
            cls = type(best.pattern.effect)
            own = [
                [e[:, [best.axis]] for e in self.following(c, out)]
                for c in (classes, (*classes, cls))
            ]
            ratio = self.ratio_interval(*own)
            if ratio[1] >= 1:
                failed[cls] = ratio
                continue
            passed = (*passed, Passed(best, *own, ratio))
            # what did not stand beside this effect's own pattern may stand without it
            failed = {}
            base = search.reshaped((*base, best.pattern))
        return Choice(base, passed, failed)

    def nested(self, out):
        """Return the patterns that the search without some blocks adds.

        None where the whole search adds none: a model without effects has the errors without
        effects, whatever a part of the data would add.
        """
        return self.choice(out).base if self.choice().base else ()

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
        blocks = block_of(fitted, self.count)
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

    def ratio_interval(self, before, after):
        """Return the 95 % interval of held-out error after over before, blocks drawn again.

        A block in which the prediction changes several times as much as in others, as the first
        one does with a warm-up, is cut into as many parts: a draw without it would tell nothing.

        Parameters
        ----------
        before, after : list of ndarray, shape (n, k)
            Errors of each record, nan where there is none.
        """
        number, last = [], 0
        for fold, b, a in zip(self.folds, before, after, strict=True):
            change = np.nan_to_num(((b - a) ** 2).sum(axis=1))
            part = np.empty(len(fold))
            for k in range(self.count):
                own = change[fold == k]
                # rounding shall not decide
                parts = max(1, int(self.count * own.sum() / max(change.sum(), 1e-300) + 1e-6))
                share = (np.cumsum(own) - own / 2) / max(own.sum(), 1e-300)
                part[fold == k] = last + np.minimum((parts * share + 1e-6).astype(int), parts - 1)
                last += parts
            number.append(part)
        number, before, after = (np.concatenate(v) for v in (number, before, after))
        known = np.isfinite(before[:, 0])
        return ratio_interval(HeldOut(number[known], before[known], after[known]), self.settings)
