"""Evidence: all rows of a problem, their noise hypotheses, and the columns of all patterns.

A row is one scalar residual. A noise hypothesis is one covariance that the noise of the rows may
have. A pattern is the derivative of all rows with respect to the parameters of an effect; each of
its columns belongs to one parameter and one axis. Nuisance parameters, as the level of each record,
are in every fit. A fold has the rows that cross-validation holds out together, and a number.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from imuloop.core.precision import precision
from imuloop.estimate.held_out import held_out_covariance
from imuloop.estimate.training_fit import TrainingFit


@dataclass(frozen=True)
class Hypotheses:
    """Hypotheses about the noise of n rows: h covariances that the noise may have."""

    precision: np.ndarray  # (h, n, n): inverse of each covariance
    log_det: np.ndarray  # (h,): logarithm of the determinant of each covariance

    @classmethod
    def of(cls, covariances):
        """Return the Hypotheses for h `covariances` of n rows, an iterable of arrays (n, n)."""
        inverses, log_det = [], []
        for covariance in covariances:
            inverse, root = precision(covariance)
            inverses.append(inverse)
            log_det.append(2 * np.log(np.diag(root)).sum())
        return cls(np.array(inverses), np.array(log_det))

    def weighted_sum(self, weights):
        """Return the sum of the h covariances, (n, n), each multiplied by its weight.

        `weights`, (h,), has the weights. If they are the probability of each covariance times its
        estimated factor, the sum is the expected covariance of the noise. Only the inverses are
        stored, so each covariance is recomputed. Covariances with less than 1e-9 of the largest
        weight are skipped.
        """
        indices = np.flatnonzero(weights > 1e-9 * weights.max())
        return sum(weights[h] * precision(self.precision[h])[0] for h in indices)


@dataclass(frozen=True)
class RowGroup:
    """n rows (scalar residuals) whose noise is correlated.

    The noise of different groups is independent.
    """

    # (n, a): residuals on a axes. The covariances of the axes differ by a factor only
    values: np.ndarray
    nuisance: np.ndarray  # (n, p): derivative with respect to the nuisance parameters
    noise: Hypotheses  # covariances that the noise of these rows may have
    # (n, 2): the fold that a row is held out with, and a second fold that it depends on, as a move
    # depends on the pose at its end; -1 is no fold
    row_folds: np.ndarray


@dataclass(frozen=True, eq=False)
class Pattern:
    """The derivative of all N rows, on a axes, with respect to the q parameters of an effect.

    On one axis a parameter gives one column, (N,), unless no row of this axis depends on it.
    `columns`, `parameters` and `scale` have one entry per axis, which describes the columns there.
    The effect has values of its constants, such as a time constant.
    """

    effect: object  # the Effect or SensorEffect, with its constants
    design: np.ndarray  # (N, a, q): the derivative, SI
    columns: tuple[tuple[int, ...], ...]  # numbers of the columns in the Evidence
    parameters: tuple[list[int], ...]  # index of the parameter that each column belongs to
    scale: tuple[np.ndarray, ...]  # norm that each column was divided by


@dataclass(eq=False)
class Evidence:
    """All N rows, group by group, and the columns of the patterns that may explain them.

    A row is one scalar residual. A column, (N,), is the derivative of the rows on one axis with
    respect to one parameter of an effect, scaled to length one. The columns of one effect are its
    pattern. Each column, and the residuals of each axis, are stored under a number. The covariance
    of the noise is one of h hypotheses.
    """

    row_groups: list[RowGroup]
    log_prior: np.ndarray  # (h,): logarithm of the prior probability of each hypothesis
    # takes effects; returns for each the derivative of all rows with respect to its q parameters,
    # (N, a, q)
    designs: Callable
    # smallest factor on the variance of a hypothesis: 1 if the size of the noise is known
    least_scale: float = 0.0
    # (h,) of bool: the hypotheses that estimates of parameters may use; default: all
    estimation_mask: np.ndarray | None = None
    # (h,) of bool: the hypotheses without more slow noise than was estimated; default: the
    # hypotheses of `estimation_mask`
    as_estimated_mask: np.ndarray | None = None
    # index of the hypothesis by which the nuisance parameters are estimated; default: the one by
    # which the parameters of effects are
    nuisance_index: int | None = None

    def __post_init__(self):
        """Set masks of hypotheses without a value to their defaults; store the rows as columns."""
        if self.estimation_mask is None:
            self.estimation_mask = np.ones(len(self.log_prior), dtype=bool)
        if self.as_estimated_mask is None:
            self.as_estimated_mask = self.estimation_mask
        self.axes = self.row_groups[0].values.shape[1]
        # columns, (N,) each; for each group, the product of its precision and each column, (h, n)
        self.columns, self._weighted = [], [[] for _ in self.row_groups]
        self._numbers, self._patterns, self._training_fits, self._variances = {}, {}, {}, {}
        # index of the first row of each group but the first
        self._ends = np.cumsum([len(g.values) for g in self.row_groups])[:-1]
        # for each group, the product of its precision and the nuisance derivative, (h, n, p)
        self.weighted_nuisance = [g.noise.precision @ g.nuisance for g in self.row_groups]
        self.row_folds = np.concatenate([g.row_folds for g in self.row_groups])
        values = np.concatenate([g.values for g in self.row_groups])
        self.residual_columns = self.add_columns(values.T)

    def add_columns(self, vectors):
        """Store k columns, the array `vectors`, (k, N), and return their numbers, a tuple of int.

        A column is the derivative of the N rows (scalar residuals) with respect to one parameter,
        or the residuals themselves. A column that is stored already keeps its number. Products of
        the columns with the precision, the inverse covariance, of each group of rows are stored,
        too.
        """
        new, numbers = [], []
        for vector in vectors:
            # equal columns are stored once: a parameter may act in the same way on all axes
            key = vector.tobytes()
            if key not in self._numbers:
                self._numbers[key] = len(self._numbers)
                new.append(vector)
            numbers.append(self._numbers[key])
        if new:
            self.columns += new
            by_group = zip(
                self.row_groups, self._weighted, self.split(np.array(new).T), strict=True
            )
            # `weighted` is the list of products of a group, one of shape (h, n) for each column,
            # and `rows` are the rows of the group in the new columns, (n, number of new columns)
            for group, weighted, rows in by_group:
                weighted += list(np.moveaxis(group.noise.precision @ rows, 2, 0).copy())
        return tuple(numbers)

    def weighted_columns(self, i, numbers):
        """Return k stored columns multiplied by the precision of one group of rows, (h, k, n).

        A column is the derivative of all rows (scalar residuals) with respect to one parameter. `i`
        is the index of the group. Its n rows have a precision, the inverse covariance, for each of
        h noise hypotheses. `numbers` are the numbers of the k columns.
        """
        # for many small arrays this takes half the time of `np.stack`
        return np.array([self._weighted[i][c] for c in numbers]).swapaxes(0, 1)

    def matrix(self, numbers):
        """Return k stored columns as one matrix, (N, k), with the N rows (scalar residuals).

        A column is the derivative of all rows with respect to one parameter, on one axis. `numbers`
        has the numbers under which the k columns are stored.
        """
        columns = [self.columns[c] for c in numbers]
        return np.reshape(columns, (len(numbers), len(self.columns[0]))).T

    def patterns(self, effects):
        """Return the Pattern of each of some effects, a tuple, in the order of `effects`.

        A pattern is the derivative of all rows with respect to the parameters of the effect. Its
        columns are stored in the Evidence.
        """
        new = [effect for effect in dict.fromkeys(effects) if effect not in self._patterns]
        for effect, design in zip(new, self.designs(new) if new else (), strict=True):
            by_axis = []
            for matrix in design.swapaxes(0, 1):
                # parameters that the rows of the axis depend on
                used = np.flatnonzero(np.any(matrix != 0, axis=0))
                scale = np.linalg.norm(matrix[:, used], axis=0)
                columns = self.add_columns((matrix[:, used] / scale).T)
                by_axis.append((columns, used.tolist(), scale))
            columns, parameters, scale = zip(*by_axis, strict=True)
            self._patterns[effect] = Pattern(
                effect, design, columns=columns, parameters=parameters, scale=scale
            )
        return tuple(self._patterns[effect] for effect in effects)

    def columns_of(self, effects, axis):
        """Return the numbers of all columns that some `effects` have on one axis, a tuple of int.

        A column is the derivative of all rows (scalar residuals) on the axis with respect to one
        parameter of an effect. A parameter has a column if the rows depend on it. `axis` is the
        index of the axis.
        """
        return tuple(c for p in self.patterns(effects) for c in p.columns[axis])

    def parameters_of(self, effects, axis):
        """Return which parameter each column of some effects on one axis belongs to, and its norm.

        `axis` is the index of the axis, on which the `effects` have k columns. A column is the
        derivative of all rows with respect to one parameter, scaled to length one.

        Returns
        -------
        ndarray, shape (k,) of int
            For each column the index of its parameter in the list of all parameters of `effects`.
        ndarray, shape (k,)
            The norm that each column was divided by. The coefficient of a column is the parameter
            times this norm.
        """
        starts = np.cumsum([0, *(len(e.parameters) for e in effects)])
        patterns = self.patterns(effects)
        index = [i + k for i, p in zip(starts, patterns, strict=False) for k in p.parameters[axis]]
        return np.array(index, int), np.concatenate([[], *(p.scale[axis] for p in patterns)])

    def with_noise(self, noise):
        """Return the Evidence of the same rows with other noise hypotheses.

        `noise` has a Hypotheses for each group of rows, the covariances that its noise may have.
        All hypotheses are equally probable before the residuals are seen.
        """
        groups = [replace(g, noise=n) for g, n in zip(self.row_groups, noise, strict=True)]
        log_prior = np.zeros(len(noise[0].log_det))
        return Evidence(groups, log_prior, designs=self.designs, least_scale=self.least_scale)

    def with_folds(self, row_folds):
        """Return the Evidence of the same N rows with other folds of cross-validation.

        `row_folds`, (N, 2), has the fold that each row is held out with, and a second fold that it
        depends on; -1 is no fold.
        """
        pairs = zip(self.row_groups, self.split(row_folds), strict=True)
        return replace(self, row_groups=[replace(g, row_folds=folds) for g, folds in pairs])

    def held_out_variance(self, hypothesis):
        """Return the variance of the held-out error of each row, (N,), in data with noise alone.

        Each fold is predicted by a fit to the rows outside it. The fit has the nuisance parameters,
        as the level of each record, and no effects. `hypothesis` is the index of a noise
        hypothesis. The covariance by this hypothesis is used twice: for the noise in the data and,
        as its inverse, for the weights of the fits.
        """
        if hypothesis not in self._variances:
            variances = []
            for group in self.row_groups:
                weights = group.noise.precision[hypothesis]
                covariance = held_out_covariance(
                    precision(weights)[0], group.nuisance, group.row_folds, weights
                )
                variances.append(np.diag(covariance))
            self._variances[hypothesis] = np.concatenate(variances)
        return self._variances[hypothesis]

    def training_fit(self, held_out=frozenset()):
        """Return the TrainingFit, least squares of the rows that remain if some folds are held out.

        `held_out` is a frozenset of the numbers of these folds; by default all rows are fitted. A
        row is left out if it belongs to one of the folds, or depends on one. Each TrainingFit is
        stored.
        """
        if held_out not in self._training_fits:
            masks = (np.isin(g.row_folds, list(held_out)).any(axis=1) for g in self.row_groups)
            held_rows = tuple(np.flatnonzero(mask) for mask in masks)
            self._training_fits[held_out] = TrainingFit(self, held_rows)
        return self._training_fits[held_out]

    def release(self):
        """Delete all stored TrainingFits to free memory; they are recomputed if needed."""
        self._training_fits.clear()

    def split(self, rows):
        """Return a list with the rows of each group, (n, …), from the array `rows`, (N, …).

        A row is one scalar residual; the N rows are in the order of the groups, and a group has n
        rows.
        """
        return np.split(rows, self._ends)
