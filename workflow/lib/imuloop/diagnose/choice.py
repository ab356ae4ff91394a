"""The choice of effects: those that pass the test and lower the held-out error are added."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from imuloop.core.effect import Effect
from imuloop.diagnose.error_ratio import ratio_interval
from imuloop.diagnose.search import Search, Trial, kinds_of


class ErrorChange(NamedTuple):
    """What a trial does to the held-out errors."""

    residual_kind: str  # kind of residual in which it shows most
    before: np.ndarray  # (n, k): held-out errors of that kind without it
    after: np.ndarray  # (n, k): and with it
    ratio: list  # 95 % interval of the ratio of their root mean squares

    @property
    def upper(self):
        """Upper end of the interval: below 1 the errors fall for certain."""
        return self.ratio[1]


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
    # interval of the ratio of those that passed the test alone, by kind, or tuple of kinds
    failed: dict = field(default_factory=dict)


class Choices:
    """The searches of all data of a problem and without some parts, and what each adds."""

    def __init__(self, problem):
        self.problem = problem
        self._searches, self._choices, self._errors = {}, {}, {}

    def search(self, held_out=frozenset()):
        """Return the search that lacks some parts."""
        if held_out not in self._searches:
            self._searches[held_out] = Search(self.problem, held_out)
        return self._searches[held_out]

    def errors(self, chosen, held_out=frozenset()):
        """Return the error of every residual, each part predicted by what is seen without it.

        `chosen` takes the parts that are not seen, and returns the effects. The errors, (M, a), SI,
        are nan for residuals that touch the parts `held_out`, which nobody sees at all. The verdict
        is by those with `nested` as `chosen`.
        """
        found, problem = None, self.problem
        for part in sorted(set(range(problem.parts)) - held_out):
            missing = held_out | {part}
            search, base = self.search(missing), chosen(missing)
            never_seen = np.isin(problem.row_parts, list(held_out)).any(axis=1)
            rows = (problem.part_of_row == part) & ~never_seen
            left = problem.residuals_left(search, base)
            if found is None:
                found = np.full(left.shape, np.nan)
            found[rows] = left[rows]
            search.training_fit(base).release()
        return found

    def following(self, kinds, held_out=frozenset()):
        """Return the errors with effects of given kinds, their shapes found again for each part."""
        key = kinds, held_out
        if key not in self._errors:
            self._errors[key] = self.errors(lambda u: self.search(u).following(kinds), held_out)
        return self._errors[key]

    def choice(self, held_out=frozenset()):
        """Return the Choice of the search that lacks some parts.

        The best effect that passes the test is added if it lowers the error of parts that are held
        out of what is seen here, or, where no other does, with the best that passes beside it;
        then everything is tested again, until nothing passes. What then no longer lowers it beside
        all others is removed. Constants of what stays are then fitted between those of the shapes.
        """
        if held_out not in self._choices:
            self._choices[held_out] = self._choice(held_out)
        return self._choices[held_out]

    def _choice(self, held_out):
        search, base, (wide, failed) = self.search(held_out), (), self._with_next((), held_out)
        while wide != base:
            base, (wide, failed) = wide, self._with_next(wide, held_out)
        while True:
            added = {}
            # what time explains goes before what the temperature does
            for effect in sorted(base, key=lambda e: not e.after_temperature):
                others = tuple(e for e in base if e is not effect)
                trial = search.test(others, effect)
                # what those after it take up whole is none of its own
                if trial is None:
                    break
                change = self._error_change(others, trial, base, held_out)
                if change.upper >= 1:
                    failed[effect.kind] = change.ratio
                    break
                shapes = search.trial(others, effect.kind)
                tries = shapes.tries if shapes else 0.0
                trial = replace(trial, log_p=trial.log_p + tries, tries=tries)
                added[effect] = Added(effect, trial, change)
            else:
                finer = search.finer(base)
                added = tuple(
                    replace(a, effect=e, trial=replace(a.trial, effects=(e,)))
                    for a, e in zip(map(added.get, base), finer, strict=True)
                )
                return Choice(finer, added, failed)
            base = others

    def _with_next(self, base, held_out):
        """Return effects with the next that lowers errors, and the ratios of those that do not."""
        search, failed = self.search(held_out), {}
        while best := search.best(base, failed):
            wide, ratio = self._extended_if_errors_fall(base, best, held_out)
            if wide:
                return wide, failed
            kinds = kinds_of(best.effects)
            failed[kinds if len(kinds) > 1 else kinds[0]] = ratio
        # errors of another effect can hide that one lowers them
        for first in (search.trial(base, kind) for kind in failed if type(kind) is not tuple):
            if more := search.best((*base, *first.effects), failed):
                both = replace(first, effects=(*first.effects, *more.effects))
                wide, _ = self._extended_if_errors_fall(base, both, held_out)
                if wide:
                    return wide, failed
        return base, failed

    def _extended_if_errors_fall(self, base, trial, held_out):
        """Return effects with those of a trial, None where errors do not fall, and the ratio."""
        wide = self.search(held_out).reshaped((*base, *trial.effects))
        change = self._error_change(base, trial, wide, held_out)
        lower = change.upper < 1 and not self.problem.rejection_reason(wide, held_out)
        return (wide if lower else None), change.ratio

    def _error_change(self, base, trial, wide, held_out):
        """Return the ErrorChange from effects to those that are extended by a trial.

        On the axis where it shows most; on all where that axis alone does not confirm it, and all
        do, each in its own size.
        """
        try:
            errors = [self.following(kinds_of(e), held_out) for e in (base, wide)]
        except np.linalg.LinAlgError:
            # of few parts: without one of them more what is left determines nothing
            return ErrorChange("", np.zeros((0, 1)), np.zeros((0, 1)), [np.inf, np.inf])
        residual_kind, rows = self.problem.shows(self.search(held_out), base, trial)
        errors = [e[rows] for e in errors]
        known = np.isfinite(errors[0][:, 0]) & np.isfinite(errors[1][:, 0])
        part_of_row, errors = self.problem.part_of_row[rows][known], [e[known] for e in errors]
        before, after = (e[:, [trial.axis]] for e in errors)
        scale = np.broadcast_to(self.problem.error_scale, len(self.problem.part_of_row))
        scale = scale[rows][known, None]
        interval = ratio_interval(part_of_row, before / scale, after / scale)
        if interval[1] >= 1 and errors[0].shape[1] > 1:
            size = np.sqrt((errors[0] ** 2).mean(axis=0))
            sized = (e / np.where(size > 0, size, 1.0) for e in errors)
            of_all = ratio_interval(part_of_row, *sized)
            if of_all[1] < 1:
                return ErrorChange(residual_kind, *errors, of_all)
        return ErrorChange(residual_kind, before, after, interval)

    def nested(self, held_out):
        """Return the effects that the search without some parts adds.

        None where the whole search adds none: a model without effects has the errors without
        effects, whatever a part of the data would add.
        """
        return self.choice(held_out).base if self.choice().base else ()
