"""Evidence: products of residuals and patterns under every hypothesis about the noise."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from imuloop.core.precision import precision
from imuloop.estimate.residuals import held_out_covariance
from imuloop.estimate.training_fit import TrainingFit


@dataclass(frozen=True)
class Hypotheses:
    """Hypotheses about the noise of some rows."""

    precision: np.ndarray  # (h, n, n): inverse of the covariance under each hypothesis
    log_det: np.ndarray  # (h,): logarithm of the covariance's determinant

    @classmethod
    def of(cls, each):
        """Return those whose `precision`, inverse and root, are given one at a time."""
        each = ((own, 2 * np.log(np.diag(root)).sum()) for own, root in each)
        inverses, log_det = zip(*each, strict=True)
        return cls(np.array(inverses), np.array(log_det))

    def mean(self, weights):
        """Return the covariance, averaged with weights, shape (h,), not of what counts nothing."""
        counted = np.flatnonzero(weights > 1e-9 * weights.max())
        return sum(weights[h] * precision(self.precision[h])[0] for h in counted)


@dataclass(frozen=True)
class RowGroup:
    """Rows whose noise is independent of that of all other rows."""

    values: np.ndarray  # (n, a): residuals of a axes, which share the noise but for its size
    # (n, p): derivative with respect to what every fit estimates: a level, or the base model
    nuisance: np.ndarray
    noise: Hypotheses  # their noise
    # (n, 2): the part that a row is held out with, and the other that it touches; -1 for none
    row_parts: np.ndarray


@dataclass(frozen=True, eq=False)
class Pattern:
    """The derivative of the rows by one shape of an effect: ``design``, (N, a, q), SI.

    Of each axis: the numbers of its columns in the evidence, which parameters these belong to, and
    the norms that they were divided by.
    """

    effect: object
    design: np.ndarray
    columns: tuple[tuple[int, ...], ...]
    parameters: tuple[list[int], ...]
    scale: tuple[np.ndarray, ...]

    @property
    def on_axes(self):
        """Columns, parameters and scale, axis by axis."""
        return zip(self.columns, self.parameters, self.scale, strict=True)


@dataclass(eq=False)
class Evidence:
    """All rows, group by group, with the patterns that may explain them."""

    row_groups: list[RowGroup]
    prior: np.ndarray  # (h,): logarithm of each hypothesis' probability before the data
    # gives the derivative of all rows with respect to an effect's parameters, (N, a, q)
    design: Callable
    # least share of a hypothesis' variance that noise can have: 1 where its size is known
    least: float = 0.0
    # (h,): hypotheses at which parameters are estimated, all by default; and those of the noise as
    # it was seen, no slower, the same by default
    estimation_mask: np.ndarray | None = None
    as_estimated_mask: np.ndarray | None = None
    # hypothesis at which nuisances are estimated; that of the parameters by default
    nuisance_index: int | None = None

    def __post_init__(self):
        """Enter the residuals of each axis."""
        if self.estimation_mask is None:
            self.estimation_mask = np.ones(len(self.prior), dtype=bool)
        if self.as_estimated_mask is None:
            self.as_estimated_mask = self.estimation_mask
        self.axes = self.row_groups[0].values.shape[1]
        # columns, (N,) each, and of each group their products with the precision, (h, n)
        self.columns, self.weighted = [], [[] for _ in self.row_groups]
        self._known, self._patterns, self._training_fits, self._variances = {}, {}, {}, {}
        self._ends = np.cumsum([len(g.values) for g in self.row_groups])[:-1]
        self.sides = [g.noise.precision @ g.nuisance for g in self.row_groups]
        values = np.concatenate([g.values for g in self.row_groups])
        self.residual_columns = self.add_columns(values.T)

    def add_columns(self, vectors):
        """Return the numbers of columns, shape (k, N); one that is known is entered once."""
        new, numbers = [], []
        for vector in vectors:
            key = vector.tobytes()
            if key not in self._known:
                self._known[key] = len(self._known)
                new.append(vector)
            numbers.append(self._known[key])
        if new:
            self.columns += new
            rows = self.split(np.array(new).T)
            for group, weighted, own in zip(self.row_groups, self.weighted, rows, strict=True):
                weighted += list(np.moveaxis(group.noise.precision @ own, 2, 0))
        return tuple(numbers)

    def weighted_columns(self, i, numbers):
        """Return ``P Z`` of columns Z of a group, by their numbers, (h, k, n)."""
        return np.stack([self.weighted[i][c] for c in numbers], axis=1)

    def matrix(self, numbers):
        """Return columns by their numbers, (N, k)."""
        columns = [self.columns[c] for c in numbers]
        return np.reshape(columns, (len(numbers), len(self.columns[0]))).T

    def patterns(self, effects):
        """Return the patterns of effects, their columns entered."""
        for effect in effects:
            if effect not in self._patterns:
                self.add_pattern(effect, self.design(effect))
        return tuple(self._patterns[effect] for effect in effects)

    def add_pattern(self, key, design):
        """Enter a pattern of any kind, (N, a, q), under a key that is, or stands for, an effect."""
        found = []
        for own in design.swapaxes(0, 1):
            used = np.flatnonzero(np.any(own != 0, axis=0))
            scale = np.linalg.norm(own[:, used], axis=0)
            found.append((self.add_columns((own[:, used] / scale).T), used.tolist(), scale))
        self._patterns[key] = Pattern(key, design, *zip(*found, strict=True))

    def columns_of(self, effects, axis):
        """Return the columns of effects on an axis."""
        return tuple(c for p in self.patterns(effects) for c in p.columns[axis])

    def with_noise(self, noise):
        """Return the same evidence under other Hypotheses about the noise of each group."""
        groups = [replace(g, noise=n) for g, n in zip(self.row_groups, noise, strict=True)]
        return Evidence(groups, np.zeros(len(noise[0].log_det)), self.design, self.least)

    def held_out_variance(self, hypothesis):
        """Return the variance of held-out errors by one hypothesis, without any pattern, (N,)."""
        if hypothesis not in self._variances:
            found = []
            for group in self.row_groups:
                weights = group.noise.precision[hypothesis]
                how = precision(weights)[0], group.nuisance, group.row_parts, weights
                found.append(np.diag(held_out_covariance(*how)))
            self._variances[hypothesis] = np.concatenate(found)
        return self._variances[hypothesis]

    def with_parts(self, row_parts):
        """Return the same evidence with other parts, (N, 2), as in `RowGroup`."""
        each = zip(self.row_groups, self.split(row_parts), strict=True)
        return replace(self, row_groups=[replace(g, row_parts=own) for g, own in each])

    def training_fit(self, held_out=frozenset()):
        """Return the TrainingFit of the rows that touch no part of `held_out`."""
        if held_out not in self._training_fits:
            touch = (np.isin(g.row_parts, list(held_out)).any(axis=1) for g in self.row_groups)
            held_rows = tuple(np.flatnonzero(rows) for rows in touch)
            self._training_fits[held_out] = TrainingFit(self, held_rows, self.residual_columns)
        return self._training_fits[held_out]

    def release(self):
        """Free the memory of all fits; they are recomputed if needed."""
        self._training_fits.clear()

    @property
    def row_parts(self):
        """The parts of all rows, (N, 2), as in `RowGroup`."""
        return np.concatenate([g.row_parts for g in self.row_groups])

    def split(self, rows):
        """Return an array of all rows, shape (N, …), group by group."""
        return np.split(rows, self._ends)
