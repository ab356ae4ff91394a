"""The choice of effects: those that are significant and lower the held-out error are added."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from imuloop.core.effect import Effect
from imuloop.estimate.error_ratio import ratio_interval
from imuloop.estimate.search import Search, Trial, kinds_of


class ErrorChange(NamedTuple):
    """What an effect does to the held-out errors."""

    residual_kind: str  # kind of residual in which it shows most
    before: np.ndarray  # (n, k): held-out errors of that kind without it
    after: np.ndarray  # (n, k): and with it
    ratio: list  # 95 % interval of the ratio of their root mean squares

    @property
    def certain(self):
        """Whether the errors fall for certain."""
        return self.ratio[1] < 1


@dataclass(frozen=True)
class Added:
    """An added effect, tested beside all other added ones."""

    effect: Effect  # in its shape
    trial: Trial  # its test
    change: ErrorChange  # of the held-out errors


@dataclass(frozen=True)
class Choice:
    """The effects that a search adds."""

    base: tuple[Effect, ...] = ()  # each in the shape that is best beside the others
    added: tuple[Added, ...] = ()  # the same, each beside all others
    # interval of the ratio of those that passed the test alone, by kind
    failed: dict = field(default_factory=dict)


class Choices:
    """The searches of all data of a problem and without each part, and what the first adds."""

    def __init__(self, problem):
        self.problem = problem
        self._searches, self._errors, self._choice = {}, {}, None

    def search(self, held_out=frozenset()):
        """Return the search that lacks some parts."""
        if held_out not in self._searches:
            self._searches[held_out] = Search(self.problem, held_out)
        return self._searches[held_out]

    def errors(self, chosen):
        """Return the error of every residual, each part predicted by what is seen without it.

        `chosen` takes the search that lacks the part, and returns the effects. The errors, (M, a),
        are in SI. The verdict is by those with `nested` as `chosen`.
        """
        found, problem = None, self.problem
        for part in range(problem.parts):
            search = self.search(frozenset({part}))
            base = chosen(search)
            left = problem.residuals_left(search, base)
            found = np.full(left.shape, np.nan) if found is None else found
            rows = problem.part_of_row == part
            found[rows] = left[rows]
            search.training_fit(base).release()
        return found

    def following(self, kinds):
        """Return the errors with effects of given kinds, their shapes found again for each part."""
        if kinds not in self._errors:
            self._errors[kinds] = self.errors(lambda search: search.following(kinds))
        return self._errors[kinds]

    def choice(self):
        """Return the Choice of all data.

        The best effect that passes the test is added if it lowers the held-out error, or, where no
        other does, with the best that passes beside it; then everything is tested again, until
        nothing passes. What then no longer lowers it beside all others is removed. Constants of
        what stays are then fitted between those of the shapes.
        """
        if self._choice is None:
            self._choice = self._make_choice()
        return self._choice

    def _make_choice(self):
        search, base, (wide, failed) = self.search(), (), self._with_next(())
        while wide != base:
            base, (wide, failed) = wide, self._with_next(wide)
        while True:
            added = {}
            # what time explains goes before what the temperature does
            for effect in sorted(base, key=lambda e: not e.after_temperature):
                others = tuple(e for e in base if e is not effect)
                trial = search.test(others, effect)
                # what those after it take up whole is none of its own
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
                finer = search.finer(base)
                added = tuple(
                    replace(a, effect=e, trial=replace(a.trial, effect=e))
                    for a, e in zip(map(added.get, base), finer, strict=True)
                )
                return Choice(finer, added, failed)
            base = others

    def _with_next(self, base):
        """Return effects with the next that lowers errors, and the ratios of those that do not."""
        search, failed = self.search(), {}
        while best := search.best(base, [kind for kind in search.kinds if kind not in failed]):
            wide, change = self._extended(base, best)
            if change.certain:
                return wide, failed
            failed[best.effect.kind] = change.ratio
        # errors of another effect can hide that one lowers them
        others = [kind for kind in search.kinds if kind not in failed]
        for first in [search.trial(base, kind) for kind in failed]:
            if more := search.best((*base, first.effect), others):
                wide, change = self._extended(base, first, more.effect)
                if change.certain:
                    return wide, failed
        return base, failed

    def _extended(self, base, trial, *more):
        """Return effects with that of a trial, and more, and the ErrorChange by them."""
        wide = self.search().reshaped((*base, trial.effect, *more))
        self.problem.refit(wide)
        return wide, self._error_change(base, trial, wide)

    def _error_change(self, base, trial, wide):
        """Return the ErrorChange from effects to those that are extended by a trial.

        On the axis where it shows most; on all where that axis alone does not confirm it, and all
        do, each in its own size.
        """
        try:
            errors = [self.following(kinds_of(e)) for e in (base, wide)]
        except np.linalg.LinAlgError:
            # of few parts: without one of them what is left determines nothing
            return ErrorChange("", np.zeros((0, 1)), np.zeros((0, 1)), [np.inf, np.inf])
        residual_kind, rows = self.problem.shows(self.search(), base, trial)
        errors = [e[rows] for e in errors]
        known = np.isfinite(errors[0][:, 0]) & np.isfinite(errors[1][:, 0])
        part_of_row, errors = self.problem.part_of_row[rows][known], [e[known] for e in errors]
        before, after = (e[:, [trial.axis]] for e in errors)
        scale = np.broadcast_to(self.problem.error_scale, len(self.problem.part_of_row))
        scale = scale[rows][known, None]
        change = ErrorChange(
            residual_kind, before, after, ratio_interval(part_of_row, before / scale, after / scale)
        )
        if not change.certain and errors[0].shape[1] > 1:
            size = np.sqrt((errors[0] ** 2).mean(axis=0))
            sized = (e / np.where(size > 0, size, 1.0) for e in errors)
            of_all = ErrorChange(residual_kind, *errors, ratio_interval(part_of_row, *sized))
            return of_all if of_all.certain else change
        return change

    def nested(self, search):
        """Return the effects that are significant in the search without some part.

        Of the kinds that all data add; what is significant, in which shape and how large, the part
        does not tell.
        """
        return search.significant(kinds_of(self.choice().base))
