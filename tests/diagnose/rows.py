"""A few rows of made-up numbers with candidates whose patterns are given."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imuloop.core.effect import Effect
from imuloop.diagnose.evidence import Block, Evidence, Hypotheses
from imuloop.diagnose.search import Search
from imuloop.diagnose.settings import DiagnoseSettings

N, PARTS = 60, 10
T = np.linspace(0, 1, N)


@dataclass(frozen=True)
class Column:
    """A candidate of which only its parameters' names count."""

    number: int = 0
    name = "column"
    parameters = {"p": "1"}  # noqa: RUF012
    limit = np.inf
    together = Effect.together


@dataclass(frozen=True)
class Other(Column):
    """Another class of candidates."""

    name = "other"


@dataclass(frozen=True)
class Third(Column):
    """One more."""

    name = "third"


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows as a search sees them, each the only one of its pose.

    Attributes
    ----------
    evidence : Evidence
        The rows.
    shapes : dict of type to tuple of Effect
        The candidates.
    settings : DiagnoseSettings
        Settings.
    fold : ndarray of int, shape (n,)
        The part that each row is held out with.
    """

    evidence: Evidence
    shapes: dict
    settings: DiagnoseSettings
    fold: np.ndarray
    tests = 1
    scans: ClassVar = {}

    @property
    def parts(self):
        """Number of parts that are held out in turn."""
        return int(self.fold.max()) + 1

    @property
    def ends(self):
        """The parts that each row touches."""
        return self.fold[:, None]

    def sight(self, base, out):
        """Return what is seen without some parts."""
        return self.evidence.sight(out)

    def left(self, search, base):
        """Return what effects leave of all rows."""
        return search.sight(base).left(search.columns(base, 0), 0)[0][:, None]

    def slow(self, effect):
        """Return False: what the noise may be is given."""
        return False

    def groups(self):
        """Return the rows of each kind of residual: they are of one."""
        return [np.ones(len(self.fold), dtype=bool)]

    def shows(self, search, base, trial):
        """Return kind and rows in which a trial shows most."""
        return "kind", slice(None)

    def lost(self, base):
        """Return why a fit is none: it always is one."""


def rows(values, nuisance, columns, covariances=(), threshold=0.05):
    """Return rows with a problem of their own.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Residuals.
    nuisance : ndarray, shape (n, p)
        What every fit has.
    columns : dict of Effect to ndarray, shape (n,) or (n, q)
        The candidates.
    covariances : sequence of ndarray, shape (n, n)
        What the noise may be; white of variance one without.
    threshold : float
        Largest p-value that passes.
    """
    n = len(values)
    noise = Hypotheses.of(covariances or [np.eye(n)])
    fold = np.arange(n) % PARTS
    block = Block(values[:, None], nuisance, noise, fold[:, None])
    prior = np.zeros(len(noise.log_det))
    plain = np.arange(len(prior)) == 0

    def design(effect):
        return columns[effect].reshape(n, 1, -1)

    evidence, shapes = Evidence([block], prior, design, least=1.0, plain=plain), {}
    for effect in columns:
        shapes.setdefault(type(effect), []).append(effect)
    shapes = {cls: tuple(own) for cls, own in shapes.items()}
    return Rows(evidence, shapes, DiagnoseSettings(significance=threshold), fold)


def search(*arguments, **more):
    """Return a search that sees all of `rows`."""
    return Search(rows(*arguments, **more), frozenset())
