"""The choice of effects: an effect is added if it is significant and lowers the held-out error."""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.estimate.error_ratio import ErrorChange, ratio_interval
from imuloop.estimate.search import Search, Trial, kinds_of


@dataclass(frozen=True)
class Choice:
    """The effects that were added to the model, and those that failed cross-validation."""

    # test of each added effect, with all other added effects in the model
    added: tuple[Trial, ...] = ()
    # effects that passed the test but did not lower the held-out error: interval of the ratio, by
    # kind
    failed: dict = field(default_factory=dict)

    @property
    def effects(self):
        """The added effects, in their best shapes."""
        return tuple(trial.effect for trial in self.added)


class Choices:
    """The choice of effects for a problem, with the searches and errors of cross-validation.

    The problem is a `StaticProblem`, `PoseProblem` or `MotionProblem` of `imuloop.diagnose`: the
    rows of one kind of record, their folds, and the shapes to try.
    """

    def __init__(self, problem):
        self.problem = problem
        self._searches, self._errors, self._choice = {}, {}, None

    def search(self, held_out=frozenset()):
        """Return the Search in the rows without the folds in `held_out`; by default in all rows."""
        if held_out not in self._searches:
            self._searches[held_out] = Search(self.problem, held_out)
        return self._searches[held_out]

    def errors(self, choose_effects):
        """Return the held-out error of every row on each axis, (N, a), SI.

        Each fold is predicted by a fit to the other rows. `choose_effects` takes the Search in
        these rows and returns the effects of the fit. Rows of no fold are nan. The verdict uses
        the errors with `nested_choice` as `choose_effects`.
        """
        errors, problem = None, self.problem
        for fold in range(problem.folds):
            search = self.search(frozenset({fold}))
            effects = choose_effects(search)
            residuals = problem.residuals(search, effects)
            errors = np.full(residuals.shape, np.nan) if errors is None else errors
            rows = problem.fold_of_row == fold
            errors[rows] = residuals[rows]
            search.training_fit(effects).release()
        return errors

    def errors_with(self, kinds):
        """Return the held-out errors, (N, a), SI, of models with effects of the given kinds.

        The shapes of the effects are chosen again without each fold.
        """
        if kinds not in self._errors:
            self._errors[kinds] = self.errors(lambda search: search.effects_of_kinds(kinds))
        return self._errors[kinds]

    def choice(self):
        """Return the Choice that all rows lead to.

        1. The effect with the smallest p-value is added if it lowers the held-out error. If no
           effect does so alone, two effects are added together if the pair does.
        2. Step 1 is repeated until nothing is added.
        3. Each effect is tested with all others in the model. An effect that no longer lowers the
           held-out error is removed, and step 3 starts again.
        4. The constants of the remaining effects are refined between those of the shapes.
        """
        if self._choice is None:
            effects, (extended, failed) = (), self._with_next(())
            while extended != effects:
                effects, (extended, failed) = extended, self._with_next(extended)
            trials = None
            while trials is None:
                effects, trials = self._confirm(effects, failed)
            refined = zip(effects, self.search().refine(effects), strict=True)
            added = tuple(replace(trials[effect], effect=shape) for effect, shape in refined)
            self._choice = Choice(added, failed)
        return self._choice

    def _with_next(self, effects):
        """Return the effects plus the next effect, or pair of them, that lowers held-out errors.

        The first result is `effects` itself if there is no such effect. The second result has the
        effects that failed on the way: the interval of the error ratio by kind.
        """
        search, failed = self.search(), {}
        while best := search.best_trial(effects, [k for k in search.kinds if k not in failed]):
            extended, change = self._extend(effects, best)
            if change.certain:
                return extended, failed
            failed[best.effect.kind] = change.ratio
        # a second effect that the model lacks can hide that the first one lowers the errors
        further_kinds = [kind for kind in search.kinds if kind not in failed]
        for first in [search.trial(effects, kind) for kind in failed]:
            if second := search.best_trial((*effects, first.effect), further_kinds):
                extended, change = self._extend(effects, first, second.effect)
                if change.certain:
                    return extended, failed
        return effects, failed

    def _extend(self, effects, trial, *further):
        """Return the effects plus the one of a trial and `further` ones, and their ErrorChange."""
        extended = self.search().with_best_shapes((*effects, trial.effect, *further))
        self.problem.refit(extended)
        return extended, self._error_change(effects, trial, extended)

    def _confirm(self, effects, failed):
        """Test each effect with all others in the model, until one does not lower the errors.

        Returns
        -------
        tuple of Effect
            The effects without the one that failed.
        dict of Effect to Trial, or None
            The test of each effect; None if one failed. `failed`, a dict, then has the interval of
            its error ratio by its kind.
        """
        search, trials = self.search(), {}
        # effects of time are removed first, before those of temperature
        for effect in sorted(effects, key=lambda e: not e.after_temperature):
            other_effects = tuple(e for e in effects if e is not effect)
            trial = search.test(other_effects, effect)
            # without a trial the other effects explain all that this one does
            if trial is None:
                return other_effects, None
            change = self._error_change(other_effects, trial, effects)
            if not change.certain:
                failed[effect.kind] = change.ratio
                return other_effects, None
            best_shape = search.trial(other_effects, effect.kind)
            tries = best_shape.tries if best_shape else 0.0
            trials[effect] = replace(trial, log_p=trial.log_p + tries, tries=tries, change=change)
        return effects, trials

    def _error_change(self, effects, trial, extended):
        """Return the ErrorChange from a model with `effects` to one with the `extended` effects.

        The ratio is that of the axis on which the trial is clearest. If this axis does not confirm
        the effect, but all axes together do, it is the ratio of all axes, with the errors of each
        axis divided by their root mean square.
        """
        problem = self.problem
        try:
            before, after = (self.errors_with(kinds_of(e)) for e in (effects, extended))
        except np.linalg.LinAlgError:
            # with few folds, the rows without one of them may not determine the parameters
            return ErrorChange("", np.zeros((0, 1)), np.zeros((0, 1)), [np.inf, np.inf])
        residual_kind, rows = problem.most_changed_rows(self.search(), effects, trial)
        index = np.arange(len(before))[rows]
        index = index[np.isfinite(before[index, 0]) & np.isfinite(after[index, 0])]
        before, after, folds = before[index], after[index], problem.fold_of_row[index]
        scale = np.broadcast_to(problem.error_scale, len(problem.fold_of_row))[index, None]
        on_axis = before[:, [trial.axis]], after[:, [trial.axis]]
        ratio = ratio_interval(folds, *(errors / scale for errors in on_axis))
        change = ErrorChange(residual_kind, *on_axis, ratio)
        if not change.certain and before.shape[1] > 1:
            size = np.sqrt((before**2).mean(axis=0))
            size = np.where(size > 0, size, 1.0)
            ratio = ratio_interval(folds, before / size, after / size)
            on_all_axes = ErrorChange(residual_kind, before, after, ratio)
            return on_all_axes if on_all_axes.certain else change
        return change

    def nested_choice(self, search):
        """Return the effects that a Search without one fold finds significant, a tuple.

        Only kinds of effects that all rows add are tried. Whether they are significant, their
        shapes and their sizes do not depend on the fold.
        """
        return search.significant_effects(kinds_of(self.choice().effects))
