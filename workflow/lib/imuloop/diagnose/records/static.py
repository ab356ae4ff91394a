"""The problem of static records: means over windows at rest, with slow noise of unknown size."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from imuloop.diagnose.records.scan import best_steps
from imuloop.diagnose.records.slow_noise import hypotheses, ratios
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.steps import Steps
from imuloop.estimate.evidence import Evidence, RowGroup
from imuloop.estimate.training_fit import ABSORBED, combined_axes
from imuloop.model.effect import FittedEffect


@dataclass(frozen=True)
class StaticProblem:
    """The static records of one sensor, as a problem for `imuloop.estimate.choice.Choices`.

    A row is the mean over one window, on the three axes of the sensor. Each record is a group of
    rows with its own level, since bias and attitude change from one power cycle to the next.
    """

    records: tuple  # StaticRecords; a session with several power cycles has several
    shapes: dict  # shapes to try, a tuple for each kind of effect
    settings: DiagnoseSettings
    tests: int  # number of tests that share the significance
    noise: tuple | None = None  # Hypotheses of each record; default: a grid of white and slow noise
    # for kinds of effects with too many shapes for a list: the function that finds the best one
    scans: ClassVar = {Steps: best_steps}
    # whether a scan is repeated when the base has grown; unit of the held-out errors
    scans_again, error_scale = False, 1.0

    @property
    def folds(self):
        """Number of folds."""
        return self.settings.blocks

    @cached_property
    def fold_of_windows(self):
        """Fold of each window, a list with one array, (n,), per record.

        A fold is one stretch of time in each record. It is at a different place in each record, so
        that the start of one record is predicted from the starts of the others.
        """
        n = len(self.records)
        return [
            (fold_in_time(r, self.folds) + i * self.folds // n) % self.folds
            for i, r in enumerate(self.records)
        ]

    @property
    def fold_of_row(self):
        """Fold of each row, (N,)."""
        return np.concatenate(self.fold_of_windows)

    @property
    def session(self):
        """Name of the session of each row, (N,)."""
        return np.concatenate([np.repeat(r.session, len(r.windows)) for r in self.records])

    @property
    def row_folds(self):
        """Folds of each row, (N, 2), as in `RowGroup`: there is no second one."""
        return _pairs(self.fold_of_row)

    @cached_property
    def evidence(self):
        """Evidence of all rows."""
        span = max(np.ptp(r.windows) for r in self.records)
        length = min(np.median(r.length) for r in self.records)
        grid, prior = ratios(span, length)
        noise = self.noise or [hypotheses(r.windows, grid) for r in self.records]
        groups = [
            RowGroup(r.values - r.values.mean(axis=0), np.ones((len(r.values), 1)), h, _pairs(fold))
            for r, h, fold in zip(self.records, noise, self.fold_of_windows, strict=True)
        ]
        # Parameters are estimated without random walk: its weights would use the fastest changes
        # only, where a lag that the model lacks matters most.
        # The level is estimated with white noise, the first hypothesis, so that it is the mean.
        return Evidence(
            groups, prior, self.designs, estimation_mask=grid[:, 1] == 0, nuisance_index=0
        )

    @property
    def values(self):
        """All rows minus the mean of their record, (N, 3), SI."""
        return np.concatenate([g.values for g in self.evidence.row_groups])

    def design(self, effect):
        """Return the derivative of all rows with respect to an effect's parameters, (N, 3, p)."""
        return np.concatenate([r.derivative(effect) for r in self.records])

    def designs(self, effects):
        """Return the `design` of each of several effects, a list."""
        return [self.design(effect) for effect in effects]

    def residuals(self, search, base):
        """Return the residuals of all rows, (N, 3), SI, by a fit to the training rows."""
        training_fit = search.training_fit(base)
        return np.column_stack([training_fit.residuals(base, axis) for axis in range(3)])

    def release(self):
        """Free the memory of a search; it is recomputed if needed."""
        self.evidence.release()

    def training_fit(self, base, held_out):
        """Return the TrainingFit without some folds; the rows are linear in all effects."""
        return self.evidence.training_fit(held_out)

    def refit(self, base):
        """Do nothing: the rows are linear in all effects, so no new linearisation is needed."""

    def most_changed_rows(self, search, base, trial):
        """Return the kind of residual that a trial changes most, and its rows: there is one."""
        return "bias", slice(None)

    def is_like_slow_noise(self, effect):
        """Return False: the grid of hypotheses has the slow noise that an effect may resemble."""
        return False

    def rows_by_kind(self):
        """Return a list with the rows of each kind of residual, (N,) of bool."""
        return [np.ones(len(self.fold_of_row), dtype=bool)]

    def components(self, kind):
        """Return the number of rows of one residual."""
        return 1

    def why_no_trial(self, search, kind):
        """Return the reason, text, why a kind of effect has no trial."""
        return "what it adds in these data is taken up by the bias"


def _pairs(fold):
    """Return `fold` as first column and no fold, -1, as second column, (n, 2)."""
    return np.column_stack([fold, np.full(len(fold), -1)])


def fold_in_time(record, count):
    """Return the fold of each window of a record, (n,), for `count` folds of equal time at rest."""
    middle = np.cumsum(record.length) - record.length / 2
    return np.minimum((middle / record.length.sum() * count).astype(int), count - 1)


def fitted_effects(search, base):
    """Return a FittedEffect for each effect in the base; None if an axis cannot estimate them."""
    training_fit = search.training_fit(base)
    patterns = training_fit.evidence.patterns(base)
    ends, estimates = np.cumsum([0, *(len(e.parameters) for e in base)]), []
    for axis in range(training_fit.evidence.axes):
        if not training_fit.evidence.columns_of(base, axis):
            continue
        theta, covariance = training_fit.estimate(base, axis)
        if theta is None:
            return None
        starts = zip(ends, patterns, strict=False)
        index = np.concatenate([first + np.array(p.parameters[axis], int) for first, p in starts])
        scale = np.concatenate([p.scale[axis] for p in patterns])
        estimates.append((index, theta / scale, covariance / np.outer(scale, scale)))
    values, covariance = combined_axes(ends[-1], estimates)
    std = np.sqrt(np.diag(covariance))
    return tuple(
        FittedEffect(
            e, *(dict(zip(e.parameters, x[i:j].tolist(), strict=True)) for x in (values, std))
        )
        for e, (i, j) in zip(base, pairwise(ends), strict=True)
    )


def information(search, base, effects):
    """Return the information of static records about the q parameters θ of some effects.

    The result is A, (q, q), and b, (q,), SI: the logarithm of the likelihood of θ is
    ``-θᵀ A θ/2 + bᵀ θ``. Parameters that the records do not show have zeros. The other effects in
    the base are nuisance parameters.

    On each axis ``A = Dᵀ P̃ D/κ``, where D is the pattern of the effects and P̃ the precision after
    the levels are projected out. κ makes the errors as large as those of `fitted_effects`: it is
    the largest ratio of ``dᵀ P̃ Σ P̃ d`` to ``dᵀ P̃ d`` of all columns d of D, with the noise
    covariance Σ averaged over the hypotheses.
    """
    others = tuple(e for e in base if e not in effects)
    training_fit, count = search.training_fit(base), sum(len(e.parameters) for e in effects)
    evidence = training_fit.evidence
    design = np.concatenate([p.design for p in evidence.patterns((*effects, *others))], axis=2)
    size = np.linalg.norm(design.reshape(-1, design.shape[2]), axis=0)
    size[size == 0] = 1.0
    precision, moment = np.zeros((len(size),) * 2), np.zeros(len(size))
    values = np.concatenate([g.values for g in evidence.row_groups])
    for axis in range(evidence.axes):
        fit = training_fit.fit(base, axis)
        rows = np.column_stack([design[:, axis] / size, values[:, axis]])
        plain, spread = training_fit.moments(fit, rows)
        square, spread = np.diag(plain)[:-1], np.diag(spread)[:-1]
        seen = square > ABSORBED * square.max()
        if seen.any():
            plain = plain / np.max(spread[seen] / square[seen])
            precision, moment = precision + plain[:-1, :-1], moment + plain[:-1, -1]
    # the other effects are eliminated
    inverse = np.linalg.pinv(precision[count:, count:], rcond=ABSORBED, hermitian=True)
    share = precision[:count, count:] @ inverse
    A = precision[:count, :count] - share @ precision[count:, :count]
    b = moment[:count] - share @ moment[count:]
    return A * np.outer(size[:count], size[:count]), b * size[:count]
