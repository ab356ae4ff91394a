"""A few rows of made-up numbers with candidates whose patterns are given."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.estimate.evidence import Evidence, Hypotheses, RowGroup
from imuloop.estimate.search import Search
from imuloop.model.effect import Effect

N, FOLDS = 60, 10
T = np.linspace(0, 1, N)


@dataclass(frozen=True)
class Column:
    """A candidate of which only its parameters' names count."""

    number: int = 0
    name = "column"
    parameters = {"p": "1"}  # noqa: RUF012
    limit, price, after_temperature, is_formula = np.inf, 0.0, False, False
    moved, kind = Effect.moved, Effect.kind


@dataclass(frozen=True)
class Other(Column):
    name = "other"


@dataclass(frozen=True, eq=False)
class Rows:
    """A problem of rows that are the only one of their pose each, `fold_of_row` their folds."""

    evidence: Evidence
    variants: dict
    settings: DiagnoseSettings
    fold_of_row: np.ndarray
    tests, folds = 1, FOLDS
    scans: ClassVar = {}

    @property
    def row_folds(self):
        return self.fold_of_row[:, None]

    def training_fit(self, base, held_out):
        return self.evidence.training_fit(held_out)


def rows(values, nuisance, columns, covariances=(), threshold=0.05):
    """Return rows with their own problem.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Residuals.
    nuisance : ndarray, shape (n, p)
        Columns that every fit has.
    columns : dict of Effect to ndarray, shape (n,) or (n, q)
        The candidates.
    covariances : sequence of ndarray, shape (n, n)
        Hypotheses of the noise; white noise of variance one if empty.
    threshold : float
        Largest p-value that passes.
    """
    n = len(values)
    noise = Hypotheses.of(covariances or [np.eye(n)])
    fold_of_row = np.arange(n) % FOLDS
    group = RowGroup(values[:, None], nuisance, noise, fold_of_row[:, None])
    prior, variants = np.zeros(len(noise.log_det)), {}
    plain = np.arange(len(prior)) == 0
    for effect in columns:
        variants[type(effect)] = (*variants.get(type(effect), ()), effect)

    def designs(effects):
        return [columns[effect].reshape(n, 1, -1) for effect in effects]

    evidence = Evidence([group], prior, designs, least_scale=1.0, as_estimated_mask=plain)
    return Rows(evidence, variants, DiagnoseSettings(significance=threshold), fold_of_row)


def search(*arguments, **more):
    return Search(rows(*arguments, **more), frozenset())
