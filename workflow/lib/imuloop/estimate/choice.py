"""The choice of effects: an effect is added if it is significant and lowers the held-out error."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from imuloop.estimate.error_ratio import ratio_interval
from imuloop.estimate.search import Search, Trial, kinds_of
from imuloop.model.effect import Effect


class ErrorChange(NamedTuple):
    """The held-out errors without and with an effect."""

    residual_kind: str  # kind of residual that the effect changes most
    before: np.ndarray  # (n, k): held-out errors of that kind without the effect
    after: np.ndarray  # (n, k): held-out errors of that kind with the effect
    ratio: list  # 95 % interval of the root mean square after over before

    @property
    def certain(self):
        """Whether the whole interval of the ratio is below one."""
        return self.ratio[1] < 1


@dataclass(frozen=True)
class Added:
    """An effect that was added to the model, tested with all other added effects in the base."""

    effect: Effect  # the shape
    trial: Trial
    change: ErrorChange


@dataclass(frozen=True)
class Choice:
    """The effects that were added to the model, and those that failed cross-validation."""

    base: tuple[Effect, ...] = ()  # the added effects, in their best shapes
    added: tuple[Added, ...] = ()  # the tests of the same effects, in the same order
    # effects that passed the test but did not lower the held-out error: interval of the ratio, by
    # kind
    failed: dict = field(default_factory=dict)


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

    def errors(self, chosen):
        """Return the held-out error of every row on each axis, (N, a), SI.

        Each fold is predicted by a fit to the other rows. `chosen` takes the Search without the
        fold and returns the effects of that fit. Rows of no fold are nan. The verdict uses the
        errors with `nested_choice` as `chosen`.
        """
        errors, problem = None, self.problem
        for fold in range(problem.folds):
            search = self.search(frozenset({fold}))
            base = chosen(search)
            residuals = problem.residuals(search, base)
            errors = np.full(residuals.shape, np.nan) if errors is None else errors
            rows = problem.fold_of_row == fold
            errors[rows] = residuals[rows]
            search.training_fit(base).release()
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
        3. Each effect is tested with all others in the base. An effect that no longer lowers the
           held-out error is removed, and step 3 starts again.
        4. The constants of the remaining effects are refined between those of the shapes.
        """
        if self._choice is None:
            self._choice = self._make_choice()
        return self._choice

    def _make_choice(self):
        """Return the Choice; `choice` describes the steps."""
        search, base, (wide, failed) = self.search(), (), self._with_next(())
        while wide != base:
            base, (wide, failed) = wide, self._with_next(wide)
        while True:
            added = {}
            # effects of time are removed first, before those of temperature
            for effect in sorted(base, key=lambda e: not e.after_temperature):
                others = tuple(e for e in base if e is not effect)
                trial = search.test(others, effect)
                # without a trial the other effects explain all that this one does
                if trial is None:
                    break
                change = self._error_change(others, trial, base)
                if not change.certain:
                    failed[effect.kind] = change.ratio
                    break
                shapes = search.trial(others, effect.kind)
                tries = shapes.tries if shapes else 0.0
                trial = replace(trial, log_p=trial.log_p + tries, tries=tries)
                added[effect] = Added(effect, trial, change)
            else:
                effects = search.refine(base)
                added = tuple(
                    replace(a, effect=e, trial=replace(a.trial, effect=e))
                    for a, e in zip(map(added.get, base), effects, strict=True)
                )
                return Choice(effects, added, failed)
            base = others

    def _with_next(self, base):
        """Return the base plus the next effect, or pair of effects, that lowers held-out errors.

        The result is the base itself if there is no such effect. The second result has the effects
        that failed on the way: the interval of the error ratio by kind.
        """
        search, failed = self.search(), {}
        while best := search.best_trial(base, [k for k in search.kinds if k not in failed]):
            wide, change = self._extend(base, best)
            if change.certain:
                return wide, failed
            failed[best.effect.kind] = change.ratio
        # a second effect that the model lacks can hide that the first one lowers the errors
        others = [kind for kind in search.kinds if kind not in failed]
        for first in [search.trial(base, kind) for kind in failed]:
            if more := search.best_trial((*base, first.effect), others):
                wide, change = self._extend(base, first, more.effect)
                if change.certain:
                    return wide, failed
        return base, failed

    def _extend(self, base, trial, *more):
        """Return the base plus the effect of a trial and `more` effects, and their ErrorChange."""
        wide = self.search().reshape((*base, trial.effect, *more))
        self.problem.refit(wide)
        return wide, self._error_change(base, trial, wide)

    def _error_change(self, base, trial, wide):
        """Return the ErrorChange from the base effects to the `wide` effects.

        The ratio is that of the axis on which the trial is clearest. If this axis does not confirm
        the effect, but all axes together do, it is the ratio of all axes, with the errors of each
        axis divided by their root mean square.
        """
        try:
            errors = [self.errors_with(kinds_of(e)) for e in (base, wide)]
        except np.linalg.LinAlgError:
            # with few folds, the rows without one of them may not determine the parameters
            return ErrorChange("", np.zeros((0, 1)), np.zeros((0, 1)), [np.inf, np.inf])
        residual_kind, rows = self.problem.most_changed_rows(self.search(), base, trial)
        errors = [e[rows] for e in errors]
        finite = np.isfinite(errors[0][:, 0]) & np.isfinite(errors[1][:, 0])
        fold_of_row, errors = self.problem.fold_of_row[rows][finite], [e[finite] for e in errors]
        before, after = (e[:, [trial.axis]] for e in errors)
        scale = np.broadcast_to(self.problem.error_scale, len(self.problem.fold_of_row))
        scale = scale[rows][finite, None]
        change = ErrorChange(
            residual_kind, before, after, ratio_interval(fold_of_row, before / scale, after / scale)
        )
        if not change.certain and errors[0].shape[1] > 1:
            size = np.sqrt((errors[0] ** 2).mean(axis=0))
            relative = (e / np.where(size > 0, size, 1.0) for e in errors)
            of_all = ErrorChange(residual_kind, *errors, ratio_interval(fold_of_row, *relative))
            return of_all if of_all.certain else change
        return change

    def nested_choice(self, search):
        """Return the effects that a Search without one fold finds significant.

        Of the kinds that all rows add. Whether they are significant, their shapes and their sizes
        do not depend on the fold.
        """
        return search.significant_effects(kinds_of(self.choice().base))
