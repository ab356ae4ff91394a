"""Static records: means at rest, whose slow noise is not known beforehand."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from imuloop.core.effect import FittedEffect
from imuloop.diagnose.records.scan import best_steps
from imuloop.diagnose.records.slow_noise import hypotheses, ratios
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.steps import Steps
from imuloop.estimate.evidence import Evidence, RowGroup
from imuloop.estimate.training_fit import ABSORBED, combined_axes


@dataclass(frozen=True)
class StaticProblem:
    """The static records of one sensor: each a group of rows with its own level.

    The bias changes from one power cycle to the next, and so does the attitude. Rows are the means
    over windows; their axes are those of the sensor.
    """

    records: tuple  # StaticRecords; parts of a session have its name
    shapes: dict  # tuple of the shapes of each effect to try, by type, where they can be listed
    settings: DiagnoseSettings
    tests: int  # number of tests of the family
    noise: tuple | None = None  # Hypotheses of each record; a grid of white and slow noise without
    # what looks for patterns whose shapes cannot be listed, by effect
    scans: ClassVar = {Steps: best_steps}
    # as of PoseProblem
    scans_again, error_scale = False, 1.0

    @property
    def folds(self):
        """Number of parts that are held out in turn."""
        return self.settings.blocks

    @cached_property
    def fold_of_windows(self):
        """In which part each window is held out, one array a record.

        A part is a stretch of time of every record, but not the same one: what happens at the start
        of each is predicted from the starts of the others.
        """
        n = len(self.records)
        return [
            (fold_in_time(r, self.folds) + i * self.folds // n) % self.folds
            for i, r in enumerate(self.records)
        ]

    @property
    def fold_of_row(self):
        """The part that each mean is held out with, shape (N,)."""
        return np.concatenate(self.fold_of_windows)

    @property
    def session(self):
        """The session of each mean, shape (N,)."""
        return np.concatenate([np.repeat(r.session, len(r.windows)) for r in self.records])

    @property
    def row_folds(self):
        """The same as `fold_of_row`, and the other part that it touches: none, (N, 2)."""
        return _without_neighbour(self.fold_of_row)

    @cached_property
    def evidence(self):
        """The rows."""
        span = max(np.ptp(r.windows) for r in self.records)
        length = min(np.median(r.length) for r in self.records)
        grid, prior = ratios(span, length)
        noise = self.noise or [hypotheses(r.windows, grid) for r in self.records]
        groups = [
            RowGroup(
                r.values - r.values.mean(axis=0),
                np.ones((len(r.values), 1)),
                h,
                _without_neighbour(part),
            )
            for r, h, part in zip(self.records, noise, self.fold_of_windows, strict=True)
        ]
        # what a model lacks is rarely noise: the weights of a walk would take the parameters from
        # the fastest changes alone, where a lag that is not in the model counts most
        # the first point is white noise: the level is the mean, as who knows no effect takes it
        return Evidence(
            groups, prior, self.design, estimation_mask=grid[:, 1] == 0, nuisance_index=0
        )

    @property
    def values(self):
        """All means about those of their record, (N, 3), SI."""
        return np.concatenate([g.values for g in self.evidence.row_groups])

    def design(self, effect):
        """Return the derivative of all rows with respect to an effect's parameters, (N, 3, p)."""
        return np.concatenate([r.derivative(effect) for r in self.records])

    def residuals(self, search, base):
        """Return what effects, fitted to what is seen, leave of all means, shape (N, 3)."""
        training_fit = search.training_fit(base)
        return np.column_stack([training_fit.residuals(base, axis) for axis in range(3)])

    def release(self):
        """Free the memory of a search; it is recomputed if needed."""
        self.evidence.release()

    def training_fit(self, base, held_out):
        """Return the TrainingFit: means at rest are straight in every effect."""
        return self.evidence.training_fit(held_out)

    def refit(self, base):
        """Do nothing: means at rest are straight in every effect."""

    def most_changed_rows(self, search, base, trial):
        """Return kind and rows in which a trial shows most."""
        return "bias", slice(None)

    def is_like_slow_noise(self, effect):
        """Return False: the hypotheses are a grid, which holds the noise that looks like it."""
        return False

    def rows_by_kind(self):
        """Return the rows of each kind of residual."""
        return [np.ones(len(self.fold_of_row), dtype=bool)]

    def components(self, kind):
        """Return how many rows make one residual."""
        return 1

    def why_no_trial(self, search, kind):
        """Return why a kind of effect has no trial."""
        return "what it adds in these data is taken up by the bias"


def _without_neighbour(part):
    """Return the part of each row, and that it touches no other, (n, 2)."""
    return np.column_stack([part, np.full(len(part), -1)])


def fold_in_time(record, count):
    """Return in which of `count` equal times at rest each window of a record lies, shape (n,)."""
    middle = np.cumsum(record.length) - record.length / 2
    return np.minimum((middle / record.length.sum() * count).astype(int), count - 1)


def fitted_effects(search, base):
    """Return a FittedEffect of each effect; None where an axis does not determine them."""
    training_fit = search.training_fit(base)
    patterns = training_fit.evidence.patterns(base)
    ends, estimates = np.cumsum([0, *(len(e.parameters) for e in base)]), []
    for axis in range(training_fit.evidence.axes):
        if not training_fit.evidence.columns_of(base, axis):
            continue
        found, covariance = training_fit.estimate(base, axis)
        if found is None:
            return None
        each = zip(ends, patterns, strict=False)
        at = np.concatenate([first + np.array(p.parameters[axis], int) for first, p in each])
        scale = np.concatenate([p.scale[axis] for p in patterns])
        estimates.append((at, found / scale, covariance / np.outer(scale, scale)))
    values, covariance = combined_axes(ends[-1], estimates)
    std = np.sqrt(np.diag(covariance))
    return tuple(
        FittedEffect(
            e, *(dict(zip(e.parameters, x[i:j].tolist(), strict=True)) for x in (values, std))
        )
        for e, (i, j) in zip(base, pairwise(ends), strict=True)
    )


def information(search, base, effects):
    """Return what static records say of the parameters θ of effects, whichever they are.

    A, (q, q), and b, (q,), SI, zero for what these records do not show: as far as it is known
    there, the logarithm of the likelihood is ``-θᵀ A θ/2 + bᵀ θ``. With the precision P̃ that leaves
    out the levels, ``A₀ = Dᵀ P̃ D`` and the noise Σ, averaged over the hypotheses, ``A = A₀/κ``, κ
    on each axis the most by which the variance of a pattern, ``dᵀ P̃ Σ P̃ d``, is above ``dᵀ P̃ d``:
    so that errors are those of `fitted_effects`. What else was found, `base`, is estimated beside.
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
        own, spread = np.diag(plain)[:-1], np.diag(spread)[:-1]
        seen = own > ABSORBED * own.max()
        if seen.any():
            plain = plain / np.max(spread[seen] / own[seen])
            precision, moment = precision + plain[:-1, :-1], moment + plain[:-1, -1]
    beside = np.linalg.pinv(precision[count:, count:], rcond=ABSORBED, hermitian=True)
    beside = precision[:count, count:] @ beside
    own = precision[:count, :count] - beside @ precision[count:, :count]
    left = moment[:count] - beside @ moment[count:]
    return own * np.outer(size[:count], size[:count]), left * size[:count]
