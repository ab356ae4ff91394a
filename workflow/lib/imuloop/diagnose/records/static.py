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
from imuloop.estimate.axis_fit import combined_axes
from imuloop.estimate.evidence import Evidence, RowGroup
from imuloop.estimate.training_fit import ABSORBED
from imuloop.model.effect import FittedEffect


@dataclass(frozen=True)
class StaticProblem:
    """The static records of one sensor, as a problem for `imuloop.estimate.choice.Choices`.

    One of the N rows is the mean over one window, on the three axes of the sensor. Each record is a
    group of rows with its own level, since bias and attitude change from one power cycle to the
    next. Cross-validation holds out one fold, some of the rows, at a time.
    """

    records: tuple  # StaticRecords; a session with several power cycles has several
    variants: dict  # variants to try, a tuple for each kind of effect
    settings: DiagnoseSettings
    tests: int  # number of tests that share the significance
    noise: tuple | None = None  # Hypotheses of each record; default: a grid of white and slow noise
    # for kinds of effects with too many variants for a list: the function that finds the best one
    scans: ClassVar = {Steps: best_steps}
    # whether a scan is repeated when the base has grown; unit of the held-out errors
    scans_again, error_scale = False, 1.0

    @property
    def folds(self):
        """Number of folds."""
        return self.settings.blocks

    @cached_property
    def fold_of_row(self):
        """Fold of each row, (N,).

        A fold is one stretch of time in each record; all folds of a record have equal time at rest.
        It is at a different place in each record, so that the start of one record is predicted from
        the starts of the others.
        """
        folds = []
        for i, record in enumerate(self.records):
            # middle of each window as a share of the time at rest
            share = (np.cumsum(record.length) - record.length / 2) / record.length.sum()
            fold = np.minimum((share * self.folds).astype(int), self.folds - 1)
            folds.append((fold + i * self.folds // len(self.records)) % self.folds)
        return np.concatenate(folds)

    @cached_property
    def evidence(self):
        """Evidence of all rows: their values, and the covariances that their noise may have.

        These hypotheses are a grid of ratios of flicker and of random walk to white noise.
        """
        span = max(np.ptp(r.windows) for r in self.records)
        length = min(np.median(r.length) for r in self.records)
        grid, prior = ratios(span, length)
        noise = self.noise or [hypotheses(r.windows, grid) for r in self.records]
        # no row depends on a second fold
        folds = np.column_stack([self.fold_of_row, np.full(len(self.fold_of_row), -1)])
        ends = np.cumsum([len(r.values) for r in self.records])[:-1]
        # the nuisance parameter of a record is its level
        groups = [
            RowGroup(
                values=r.values - r.values.mean(axis=0),
                nuisance=np.ones((len(r.values), 1)),
                noise=hypotheses_of_record,
                row_folds=row_folds,
            )
            for r, hypotheses_of_record, row_folds in zip(
                self.records, noise, np.split(folds, ends), strict=True
            )
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

    def subtract(self, effects):
        """Return the `values` after FittedEffects are subtracted, (N, 3), SI."""
        designs = self.designs([fitted.effect for fitted in effects])
        outputs = (d @ fitted.vector for d, fitted in zip(designs, effects, strict=True))
        return self.values - sum(outputs, np.zeros(()))

    def designs(self, effects):
        """Return for each effect the derivative of all rows by its p parameters, (N, 3, p), SI."""
        return [
            np.concatenate([e.in_session(r.channels, r.session, r.windows) for r in self.records])
            for e in effects
        ]

    def residuals(self, search, effects):
        """Return the residuals of all rows, (N, 3), SI, by a fit of effects to the training rows.

        The training rows are those that `search`, a Search, does not hold out.
        """
        training_fit = search.training_fit(effects)
        return np.column_stack([training_fit.residuals(effects, axis) for axis in range(3)])

    def training_fit(self, base, held_out):
        """Return the TrainingFit, the least-squares fit to the rows without the folds `held_out`.

        It does not depend on the effects in `base`, since the rows are linear in all effects.
        """
        return self.evidence.training_fit(held_out)

    def refit(self, effects):
        """Do nothing: the rows are linear in all effects, so no new linearisation is needed."""

    def most_changed_rows(self, search, base, trial):
        """Return the only kind of residual, and its rows, all: no trial changes another one."""
        return "bias", slice(None)

    def is_like_slow_noise(self, effect):
        """Return False: the grid of hypotheses has the slow noise that an effect may resemble."""
        return False

    def of_kind(self, kind):
        """Return the rows of one kind of residual, (N,) of bool: all, since there is one kind."""
        return np.ones(len(self.fold_of_row), dtype=bool)

    def rows_by_kind(self):
        """Return a list with the rows of each kind of residual, (N,) of bool."""
        return [self.of_kind("bias")]

    def components(self, kind):
        """Return the number of rows that make up one residual, 1."""
        return 1

    def why_no_trial(self, search, kind):
        """Return the reason, text, why a kind of effect could not be tested."""
        return "what it adds in these data is taken up by the bias"


def fitted_effects(search, effects):
    """Return a FittedEffect for each of some effects, fitted together to the records, a tuple.

    The result is None if an axis cannot estimate them. `search` is the Search of the records.
    """
    training_fit = search.training_fit(effects)
    # the derivatives of the rows, scaled to columns of length one
    patterns = training_fit.evidence.patterns(effects)
    # index of the first parameter of each effect, and their number
    ends, estimates = np.cumsum([0, *(len(e.parameters) for e in effects)]), []
    for axis in range(training_fit.evidence.axes):
        if not training_fit.evidence.columns_of(effects, axis):
            continue
        coefficients, covariance = training_fit.estimate(effects, axis)
        if coefficients is None:
            return None
        starts = zip(ends, patterns, strict=False)
        index = np.concatenate([start + np.array(p.parameters[axis], int) for start, p in starts])
        scale = np.concatenate([p.scale[axis] for p in patterns])
        estimates.append((index, coefficients / scale, covariance / np.outer(scale, scale)))
    values, covariance = combined_axes(ends[-1], estimates)
    std, fitted = np.sqrt(np.diag(covariance)), []
    for effect, (i, j) in zip(effects, pairwise(ends), strict=True):
        by_name, std_by_name = (
            dict(zip(effect.parameters, x[i:j].tolist(), strict=True)) for x in (values, std)
        )
        fitted.append(FittedEffect(effect, by_name, std_by_name))
    return tuple(fitted)


def information(search, base, effects):
    """Return the information of static records about the q parameters θ of some effects.

    On each axis ``A = Dᵀ P̃ D/κ``, where D is the derivative of the rows with respect to θ, and P̃
    the precision of the noise after the levels of the records are projected out. κ makes the errors
    as large as those of a fit of the effects to the records: it is the largest ratio of
    ``dᵀ P̃ Σ P̃ d`` to ``dᵀ P̃ d`` of all columns d of D, with the noise covariance Σ averaged over
    the noise hypotheses, the covariances that the noise may have.

    Parameters
    ----------
    search : Search
        The search in the records.
    base : tuple of Effect
        Effects that the records have. Those that are not in `effects` are nuisance parameters.
    effects : tuple of Effect
        The effects with the parameters θ.

    Returns
    -------
    ndarray, shape (q, q), and ndarray, shape (q,)
        Fisher information A and moment b, SI: the logarithm of the likelihood of θ is
        ``-θᵀ A θ/2 + bᵀ θ``. Parameters that the records do not show have zeros.
    """
    nuisances = tuple(e for e in base if e not in effects)
    training_fit, q = search.training_fit(base), sum(len(e.parameters) for e in effects)
    evidence = training_fit.evidence
    design = np.concatenate([p.design for p in evidence.patterns((*effects, *nuisances))], axis=2)
    # columns of length one: parameters have different units
    size = np.linalg.norm(design.reshape(-1, design.shape[2]), axis=0)
    size[size == 0] = 1.0
    precision, moment = np.zeros((len(size),) * 2), np.zeros(len(size))
    values = search.problem.values
    for axis in range(evidence.axes):
        fit = training_fit.fit(base, axis)
        columns = np.column_stack([design[:, axis] / size, values[:, axis]])
        products, variance = training_fit.moments(fit, columns)
        # the last column is that of the values
        square, variance = np.diag(products)[:-1], np.diag(variance)[:-1]
        shown = square > ABSORBED * square.max()
        if shown.any():
            products = products / np.max(variance[shown] / square[shown])
            precision, moment = precision + products[:-1, :-1], moment + products[:-1, -1]
    # the nuisance parameters are eliminated
    inverse = np.linalg.pinv(precision[q:, q:], rcond=ABSORBED, hermitian=True)
    share = precision[:q, q:] @ inverse
    A = precision[:q, :q] - share @ precision[q:, :q]
    b = moment[:q] - share @ moment[q:]
    return A * np.outer(size[:q], size[:q]), b * size[:q]
