"""The choice of effects: an effect is added if it is significant and lowers the held-out error."""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.estimate.held_out import ErrorChange, ratio_interval
from imuloop.estimate.search import Search, Trial, kinds_of


@dataclass(frozen=True)
class Choice:
    """The effects that were added to the model, and the effects that failed cross-validation."""

    # significance test of each added effect, with all other added effects in the model
    added: tuple[Trial, ...] = ()
    # effects that passed the test but did not lower the held-out error: by kind of effect, the 95 %
    # interval [low, high] of the ratio of the error with the effect to that without
    failed: dict = field(default_factory=dict)

    @property
    def effects(self):
        """The added effects, each with the values of its constants that fit best, a tuple."""
        return tuple(trial.effect for trial in self.added)


class Choices(Search):
    """The choice of the effects that a model needs, by significance tests and cross-validation.

    `problem` is a `StaticProblem`, `PoseProblem` or `MotionProblem` of `imuloop.diagnose`. It has
    the rows, scalar residuals of one kind of record. It also has the folds, groups of rows that are
    held out together, and the variants to try, effects with values of their constants.
    """

    def __init__(self, problem):
        super().__init__(problem, held_out=frozenset())
        self._searches, self._errors, self._choice = {}, {}, None

    def search(self, held_out):
        """Return the Search that uses only the rows outside some folds.

        A row is one scalar residual; a fold has the rows that cross-validation holds out together.
        `held_out`, a frozenset of int, has the numbers of the folds to leave out. Each Search is
        stored.
        """
        if held_out not in self._searches:
            self._searches[held_out] = Search(self.problem, held_out)
        return self._searches[held_out]

    def errors(self, choose_effects):
        """Return the held-out errors of all N rows on a axes, (N, a), SI.

        A row is one scalar residual per axis. A fold has the rows that are held out together. Each
        fold is predicted by a fit to the rows outside it. The effects in this fit may depend on the
        fold: `choose_effects` is a function that takes the Search in the rows outside the fold and
        returns the effects, a tuple. Rows that belong to no fold are not predicted: their errors
        are nan.
        """
        errors, problem = None, self.problem
        for fold in range(problem.folds):
            search = self.search(frozenset({fold}))
            effects = choose_effects(search)
            # residuals of all rows by the fit to the rows outside the fold
            residuals = problem.residuals(search, effects)
            errors = np.full(residuals.shape, np.nan) if errors is None else errors
            rows = problem.fold_of_row == fold
            errors[rows] = residuals[rows]
            # the fit without this fold is deleted, as those of all folds together need much memory
            search.training_fit(effects).release()
        return errors

    def errors_with(self, kinds):
        """Return the held-out errors, (N, a), SI, of a model with one effect of each of some kinds.

        There are N rows, scalar residuals, on a axes. `kinds` is a tuple of kinds of effects. Each
        fold of rows is predicted by a fit to the rows outside it. These rows also choose the
        constants of the effects, such as a time constant, again for each fold.
        """
        if kinds not in self._errors:
            self._errors[kinds] = self.errors(lambda search: search.effects_of_kinds(kinds))
        return self._errors[kinds]

    def choice(self):
        """Return the Choice, the effects that the model needs by all rows. It is computed once.

        1. The effect with the smallest p-value is added if it lowers the held-out error. If no
           effect does so alone, two effects are added together if the pair does.
        2. Step 1 is repeated until nothing is added.
        3. Each effect is tested with all others in the model. An effect that no longer lowers the
           held-out error is removed, and step 3 starts again.
        4. The constants of the remaining effects, which were taken from a grid of variants, are
           refined between the values of the grid.
        """
        if self._choice is None:
            effects, (extended, failed) = (), self._with_next(())
            while extended != effects:
                effects, (extended, failed) = extended, self._with_next(extended)
            trials = None
            while trials is None:
                effects, trials = self._confirm(effects, failed)
            pairs = zip(effects, self.refine(effects), strict=True)
            added = tuple(replace(trials[effect], effect=refined) for effect, refined in pairs)
            self._choice = Choice(added, failed)
        return self._choice

    def _with_next(self, effects):
        """Return the model with the next effect, or pair of effects, that lowers held-out errors.

        Returns
        -------
        tuple of Effect
            `effects`, which are in the model already, and the next ones. If no effect and no pair
            lowers the held-out errors with confidence, this is `effects` itself.
        dict
            The effects that were tried and did not lower the held-out error. A key is the kind of
            such an effect. Its value is the 95 % interval, [low, high], of a ratio: the held-out
            error with the effect over the error without it.
        """
        failed = {}
        while best := self.best_trial(effects, [k for k in self.kinds if k not in failed]):
            extended, change = self._extend(effects, best)
            if change.certain:
                return extended, failed
            failed[best.effect.kind] = change.ratio
        # as long as the model lacks a second effect, the first one may seem not to lower the errors
        further_kinds = [kind for kind in self.kinds if kind not in failed]
        for first in [self.trial(effects, kind) for kind in failed]:
            if second := self.best_trial((*effects, first.effect), further_kinds):
                extended, change = self._extend(effects, first, second.effect)
                if change.certain:
                    return extended, failed
        return effects, failed

    def _extend(self, effects, trial, *further):
        """Return a model with more effects, a tuple, and the ErrorChange by the addition.

        `effects` are in the model already, and `trial` is the Trial of the effect to add. `further`
        are other effects to add with it. The constants of all effects but the last are chosen
        again.
        """
        extended = self.with_best_variants((*effects, trial.effect, *further))
        self.problem.refit(extended)
        return extended, self._error_change(effects, trial, extended)

    def _confirm(self, effects, failed):
        """Return the effects and their tests, or the effects without the first one that fails.

        Each of the `effects` is tested with all others in the model. It fails if its addition to
        the others does not lower the held-out error, or if it cannot be estimated next to the
        others. In the first case its kind is also added to the dict `failed`, with the 95 %
        interval of a ratio: the held-out error with the effect over the error without it.

        Returns
        -------
        tuple of Effect
            All effects if none fails; otherwise all but the first one that fails.
        dict of Effect to Trial, or None
            The test of each effect if none fails; otherwise None.
        """
        trials = {}
        # effects of time are tested, and so removed, before effects of temperature
        for effect in sorted(effects, key=lambda e: not e.after_temperature):
            other_effects = tuple(e for e in effects if e is not effect)
            trial = self.test(other_effects, effect)
            # without a trial the other effects explain all that this one does
            if trial is None:
                return other_effects, None
            change = self._error_change(other_effects, trial, effects)
            if not change.certain:
                failed[effect.kind] = change.ratio
                return other_effects, None
            # the p-value counts how many variants of the effect were tried
            best_trial = self.trial(other_effects, effect.kind)
            log_tries = best_trial.log_tries if best_trial else 0.0
            log_p = trial.log_p + log_tries
            trials[effect] = replace(trial, log_p=log_p, log_tries=log_tries, change=change)
        return effects, trials

    def _error_change(self, effects, trial, extended):
        """Return the ErrorChange from a model with `effects` to one with the `extended` effects.

        `trial` is the Trial of an effect that only the second model has. The ratio of held-out
        errors is taken on the axis on which the trial has the smallest p-value. There is one
        exception: if this axis does not show that the errors fall, but all axes together do, the
        ratio is taken over all axes. The errors of each axis are then divided by their root mean
        square without the effect. If the rows outside some fold do not determine the parameters,
        the ratio is infinite, so the effect counts as one that does not lower the errors.
        """
        problem = self.problem
        try:
            before, after = (self.errors_with(kinds_of(e)) for e in (effects, extended))
        except np.linalg.LinAlgError:
            # with few folds, the rows without one of them may not determine the parameters: then
            # the errors do not fall with confidence
            empty = np.zeros((0, 1))
            return ErrorChange(residual_kind="", before=empty, after=empty, ratio=[np.inf, np.inf])
        # the kind of residual, as rotations, that the effect changes most, and the mask of its rows
        residual_kind, rows = problem.most_changed_rows(self, effects, trial)
        index = np.arange(len(before))[rows]
        index = index[np.isfinite(before[index, 0]) & np.isfinite(after[index, 0])]
        before, after, folds = before[index], after[index], problem.fold_of_row[index]
        # residuals of different units or scatter have equal weights
        scale = np.broadcast_to(problem.error_scale, len(problem.fold_of_row))[index, None]
        one_before, one_after = before[:, [trial.axis]], after[:, [trial.axis]]
        ratio = ratio_interval(folds, one_before / scale, one_after / scale)
        change = ErrorChange(residual_kind, before=one_before, after=one_after, ratio=ratio)
        if not change.certain and before.shape[1] > 1:
            size = np.sqrt((before**2).mean(axis=0))
            size = np.where(size > 0, size, 1.0)
            ratio = ratio_interval(folds, before / size, after / size)
            on_all_axes = ErrorChange(residual_kind, before=before, after=after, ratio=ratio)
            return on_all_axes if on_all_axes.certain else change
        return change

    def nested_choice(self, search):
        """Return the effects that are significant in the training rows of a `search`, a tuple.

        This method is passed to `errors` as `choose_effects`, for the held-out errors of the chosen
        model. The effects are then chosen again for each fold, without its rows, so the choice is
        nested in the cross-validation. The Search tries only the kinds of effects that the choice
        by all rows adds. Its training rows, which it does not hold out, decide which of these kinds
        are significant, and give the constants of the effects.
        """
        return search.significant_effects(kinds_of(self.choice().effects))
