"""The fit to training rows: generalised least squares under every noise hypothesis.

The package's docstring defines row, column, fold, hypothesis and nuisance parameter.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dtrtri
from scipy.special import softmax

# a column counts as linearly independent of others if more than this share of its square remains
# after the projection onto them
ABSORBED = 1e-6
# share of a column's square that rounding alone may leave
ROUNDING = 1e-12


@dataclass(frozen=True)
class Fit:
    """Least squares of one axis with k columns, under each of h noise hypotheses.

    Several fits that have the same number of columns can be combined into one object: `square` and
    `log_weight` are (h, m) then, with one entry for each of the m fits.
    """

    theta: np.ndarray  # (h, k): coefficients of the columns
    # (h, k, k): normal matrix of the columns, each divided by its `size`
    products: np.ndarray
    size: np.ndarray  # (h, k): norms of the columns in the metric of the precision
    square: np.ndarray  # (h,): χ² of the residuals
    log_weight: np.ndarray  # (h,): logarithm of restricted likelihood times prior
    dof: int  # degrees of freedom
    least: float  # lower limit of `scale`

    @property
    def scale(self):
        """Estimated variance of the noise over the variance of the hypothesis, (h,) or (h, m)."""
        return np.maximum(self.least, self.square / self.dof)

    @property
    def loss(self):
        """Term ``(dof log scale + χ²/scale)/2`` of minus the log likelihood, (h,) or (h, m)."""
        return (self.dof * np.log(self.scale) + self.square / self.scale) / 2

    @cached_property
    def inverse(self):
        """Covariance of the coefficients, (h, k, k), if `scale` were one."""
        return np.linalg.inv(self.products) / self.size[:, :, None] / self.size[:, None]

    @property
    def covariance(self):
        """Covariance of the coefficients under each hypothesis, (h, k, k)."""
        return self.inverse * self.scale[:, None, None]

    @property
    def weight(self):
        """Posterior probability of each hypothesis, (h,); the sum is one."""
        return softmax(self.log_weight, axis=-1)

    def average(self, weight):
        """Return the coefficients, (k,), and their covariance, (k, k), averaged over hypotheses.

        `weight`, (h,), has the probability of each hypothesis. The covariance includes the scatter
        of the coefficients between hypotheses.
        """
        values = weight @ self.theta
        off = self.theta - values
        spread = self.covariance + off[:, :, None] * off[:, None]
        return values, np.einsum("h,hpq->pq", weight, spread)


@dataclass
class TrainingFit:
    """Least squares of the training rows, those that are not held out.

    All products of columns use the precision P̃ of the training rows after the nuisance parameters
    are projected out. For columns x and y of a group with precision P it is
    ``xᵀ P̃ y = xᵀ P y - t_x·t_y``, where t_x, (u,), is called the correction of x. Corrections and
    fits are stored, so that each is computed once.
    """

    evidence: object  # the Evidence with all rows
    held_rows: tuple  # for each group, indices of the rows that depend on a held-out fold
    residual_columns: tuple  # for each axis, number of the column that holds its residuals
    # by column number: its corrections, (h, u) for each group
    _corrections: dict = field(default_factory=dict)
    # by column number: its square by the first hypothesis, with the nuisance parameters in it
    _squares: dict = field(default_factory=dict)
    _fits: dict = field(default_factory=dict)
    _steps: dict = field(default_factory=dict)

    @cached_property
    def _roots(self):
        """For each group a root R, (h, u, u), of ``(Uᵀ P U)⁻¹``, so that ``R Rᵀ`` is this inverse.

        U, (n, u), has a unit vector for each held-out row, as if the row had its own parameter,
        and then the derivative by the nuisance parameters. P is the precision of all rows of the
        group. R is upper triangular.
        """
        roots = []
        groups = zip(self.evidence.row_groups, self.evidence.sides, self.held_rows, strict=True)
        for group, side, held_rows in groups:
            if not np.all(np.any(np.delete(group.nuisance, held_rows, axis=0), axis=0)):
                raise np.linalg.LinAlgError("a parameter that nothing seen depends on")
            normal = group.noise.precision[:, held_rows[:, None], held_rows]
            mixed = side[:, held_rows]
            corner = np.concatenate([np.swapaxes(mixed, 1, 2), group.nuisance.T @ side], axis=2)
            normal = np.concatenate([np.concatenate([normal, mixed], axis=2), corner], axis=1)
            size = np.sqrt(np.einsum("huu->hu", normal))
            lower = np.linalg.cholesky(normal / size[:, :, None] / size[:, None])
            # the transposed inverse of each lower triangle
            root = np.array([dtrtri(triangle.T)[0] for triangle in lower])
            roots.append(root / size[:, :, None])
        return roots

    @cached_property
    def free_rows(self):
        """Number of training rows minus number of nuisance parameters."""
        groups = zip(self.evidence.row_groups, self.held_rows, strict=True)
        return sum(len(g.values) - len(held_rows) - g.nuisance.shape[1] for g, held_rows in groups)

    @cached_property
    def log_det(self):
        """``log det Σ + log det Nᵀ Σ⁻¹ N``, (h,), of the training rows.

        Σ is their covariance under each hypothesis, N the derivative by the nuisance parameters.
        """
        groups = zip(self.evidence.row_groups, self._roots, strict=True)
        diagonals = ((g, np.einsum("huu->hu", root)) for g, root in groups)
        return sum(g.noise.log_det - 2 * np.log(diagonal).sum(axis=1) for g, diagonal in diagonals)

    def products(self, first, second):
        """Return the products ``Yᵀ P̃ Z`` of columns Y and Z, (h, a, b), summed over the groups.

        `first`, a numbers, are the columns Y and `second`, b numbers, the columns Z. With U as in
        `_roots` a product is ``Yᵀ P Z - (Uᵀ P Y)ᵀ (Uᵀ P U)⁻¹ (Uᵀ P Z)``.
        """
        self._add_columns((*first, *second))
        total, by_group = 0.0, self.evidence.split(self.evidence.matrix(second))
        for i, z in enumerate(by_group):
            removed = self.corrections(i, first) @ np.swapaxes(self.corrections(i, second), 1, 2)
            total = total + self.evidence.weighted_columns(i, first) @ z - removed
        return total

    def gram(self, columns):
        """Return the products ``Zᵀ P̃ Z`` of k columns with each other, (h, k, k)."""
        return self.products(columns, columns)

    def _blocks(self, sets):
        """Return the products within each set of columns, (h, s, q, q).

        `sets`, (s, q), has the numbers of q columns for each of s sets.
        """
        flat, total = tuple(sets.ravel().tolist()), 0.0
        self._add_columns(flat)
        for i, z in enumerate(self.evidence.split(self.evidence.matrix(flat))):
            weighted, t = self.evidence.weighted_columns(i, flat), self.corrections(i, flat)
            weighted, t = (x.reshape(len(x), *sets.shape, -1) for x in (weighted, t))
            total = total + weighted @ z.T.reshape(*sets.shape, -1).swapaxes(1, 2)
            total = total - t @ np.swapaxes(t, 2, 3)
        return total

    def corrections(self, i, columns):
        """Return the corrections of k columns in group i, (h, k, u)."""
        return np.stack([self._corrections[c][i] for c in columns], axis=1)

    def _add_columns(self, columns):
        """Compute and store the corrections and squares of columns that have none yet."""
        new = [c for c in dict.fromkeys(columns) if c not in self._corrections]
        if not new:
            return
        by_group, seen, full = [], 0.0, 0.0
        for i, z in enumerate(self.evidence.split(self.evidence.matrix(new))):
            weighted, held_rows = self.evidence.weighted_columns(i, new), self.held_rows[i]
            t = self.correction(i, slice(None), weighted)
            square = np.einsum("kn,nk->k", weighted[0], z)
            full, seen = full + square, seen + square
            seen = seen - (t[0, :, : len(held_rows)] ** 2).sum(axis=1)
            by_group.append(t)
        # a column that is zero in all training rows has a square of rounding errors only
        seen = np.where(seen > ROUNDING * full, seen, np.inf)
        self._corrections |= {c: [t[:, k] for t in by_group] for k, c in enumerate(new)}
        self._squares |= dict(zip(new, seen.tolist(), strict=True))

    def release(self):
        """Free the memory of fits and products; they are recomputed if needed."""
        for store in (self._fits, self._corrections, self._squares):
            store.clear()

    def apply_precision(self, i, hypothesis, columns):
        """Return ``P̃ X`` of columns X, (n, k), of group i; held-out rows are zero.

        `hypothesis` is the index of the noise hypothesis.
        """
        precision = self.evidence.row_groups[i].noise.precision[hypothesis]
        held_rows = self.held_rows[i]
        result = precision @ columns
        fitted = self._roots[i][hypothesis] @ self.correction(i, hypothesis, result.T).T
        result -= precision[:, held_rows] @ fitted[: len(held_rows)]
        result -= self.evidence.sides[i][hypothesis] @ fitted[len(held_rows) :]
        result[held_rows] = 0.0
        return result

    def correction(self, i, hypothesis, weighted):
        """Return the correction t, (..., u), of columns x in group i.

        `weighted`, (..., n), has the products ``xᵀ P``; `hypothesis` is one index, or a slice of
        all.
        """
        nuisance = self.evidence.row_groups[i].nuisance
        side = np.concatenate([weighted[..., self.held_rows[i]], weighted @ nuisance], axis=-1)
        return side @ self._roots[i][hypothesis]

    def step_information(self, i, hypothesis):
        """Return ``xᵀ P̃ x``, (n,), of a unit step x before each row of group i.

        It is the information of the group about the size of the step.
        """
        if (i, hypothesis) not in self._steps:
            precision = self.evidence.row_groups[i].noise.precision[hypothesis]
            # the sum over all rows from row k on is the product with a step before row k
            after = precision[::-1].cumsum(axis=0)[::-1]
            removed = (self.correction(i, hypothesis, after) ** 2).sum(axis=1)
            self._steps[i, hypothesis] = np.triu(after).sum(axis=1) - removed
        return self._steps[i, hypothesis]

    def fit(self, effects, axis):
        """Return the Fit of one axis to effects, or None if their columns are dependent."""
        key = tuple(effects)
        if key not in self._fits:
            self._fits[key] = [fit for (fit,) in self.fits(effects, [()])]
        return self._fits[key][axis]

    def fits(self, base, more):
        """Return the Fits to the base effects plus each tuple of effects in `more`.

        The result has a list for each axis, with one Fit for each tuple. It is None if the columns
        are linearly dependent, or if there are as many columns as rows.
        """
        columns_of, groups = self.evidence.columns_of, {}
        fits = [[None] * len(more) for _ in self.residual_columns]
        for axis in range(len(self.residual_columns)):
            shared = columns_of(base, axis)
            for k, effects in enumerate(more):
                added = columns_of(effects, axis)
                groups.setdefault((shared, len(added)), {}).setdefault(added, []).append((axis, k))
        for (shared, count), sets in groups.items():
            # axes that have the same columns share the products of these columns
            added = np.reshape(list(sets), (len(sets), count)).astype(int)
            for by_axis, indices in zip(self._fit(shared, added), sets.values(), strict=True):
                for axis, k in indices:
                    fits[axis][k] = by_axis and by_axis[axis]
        return fits

    def _fit(self, shared, sets):
        """Return the Fits to `shared` columns plus each set of further columns.

        `sets`, (s, q), has the numbers of q columns for each of s sets. The result has for each
        set a list of Fits, one for each axis, or None if the columns are linearly dependent.
        """
        axes, (count, q) = len(self.residual_columns), sets.shape
        k, first = len(shared) + q, axes + len(shared)
        dof, least = self.free_rows - k, self.evidence.least
        if dof < 1:
            return [None] * count
        common, flat = (*self.residual_columns, *shared), tuple(sets.ravel().tolist())
        products = self.products(common, (*common, *flat))
        of_sets = products[:, :, first:].reshape(len(products), first, count, q)
        of_sets = of_sets.transpose(0, 2, 3, 1)
        gram = np.empty((len(products), count, k, k))
        gram[:, :, : k - q, : k - q] = products[:, None, axes:, axes:first]
        gram[:, :, k - q :, : k - q] = of_sets[..., axes:]
        gram[:, :, : k - q, k - q :] = np.swapaxes(of_sets[..., axes:], 2, 3)
        if q:
            gram[:, :, k - q :, k - q :] = self._blocks(sets)
        # products of columns and residuals, (h, s, k, axes), and squares of residuals, (h, 1, axes)
        moment = np.broadcast_to(products[:, None, axes:, :axes], (*gram.shape[:2], k - q, axes))
        moment = np.concatenate([moment, of_sets[..., :axes]], axis=2)
        total = np.einsum("haa->ha", products[:, :axes, :axes])[:, None]
        squares = np.array([[self._squares[c] for c in (*shared, *own)] for own in sets.tolist()])
        size = np.sqrt(np.maximum(np.einsum("hskk->hsk", gram), 0.0))
        independent = np.all(size[0] ** 2 > ABSORBED * squares.reshape(count, k), axis=1)
        size = np.where(size > 0, size, 1.0)
        gram, moment = gram / size[..., :, None] / size[..., None, :], moment / size[..., None]
        independent &= np.linalg.eigvalsh(gram[0]).min(axis=1, initial=1.0) > ABSORBED
        # a singular matrix is replaced, so that the others can be solved with it
        gram[:, ~independent] = np.eye(k)
        theta = np.linalg.solve(gram, moment)
        square = np.maximum(total - (theta * moment).sum(axis=2), 1e-12 * total)
        log_det = self.log_det[:, None] + np.linalg.slogdet(gram)[1] + 2 * np.log(size).sum(axis=2)
        theta = theta / size[..., None]
        scale = np.maximum(least, square / dof)
        log_weight = (self.evidence.prior[:, None] - log_det / 2)[..., None]
        log_weight = log_weight - (dof * np.log(scale) + square / scale) / 2

        def by_axis(s):
            of_axes = ((x[:, s, ..., a] for x in (theta, square, log_weight)) for a in range(axes))
            return [
                Fit(theta, gram[:, s], size[:, s], square, log_weight, dof, least)
                for theta, square, log_weight in of_axes
            ]

        return [by_axis(s) if independent[s] else None for s in range(count)]

    def hypothesis(self, fit):
        """Return the index of the noise hypothesis for estimates of parameters.

        It is the likeliest hypothesis of a Fit that `Evidence.estimation_mask` allows.
        """
        return int(np.argmax(np.where(self.evidence.estimation_mask, fit.log_weight, -np.inf)))

    def solve(self, effects, axis):
        """Return the estimates of one axis: nuisance parameters and coefficients of columns.

        The nuisance parameters are a list of arrays, (p,), one for each group. The coefficients,
        (k,), belong to the columns of the effects; they are zero if the columns are dependent.
        """
        fit, columns = self.fit(effects, axis), self.evidence.columns_of(effects, axis)
        if fit is None and columns:
            return self.solve((), axis)[0], np.zeros(len(columns))
        if fit is None:
            raise np.linalg.LinAlgError("fewer rows are seen than parameters")
        hypothesis = self.hypothesis(fit)
        index = self.evidence.nuisance_index
        index = hypothesis if index is None else index
        theta = fit.theta[hypothesis]
        nuisances = []
        for i, (root, held_rows) in enumerate(zip(self._roots, self.held_rows, strict=True)):
            t = self.corrections(i, (self.residual_columns[axis], *columns))[index]
            nuisances.append((root[index] @ (t[0] - theta @ t[1:]))[len(held_rows) :])
        return nuisances, theta

    def parameters(self, effects, axis):
        """Return the estimates of one axis: nuisance parameters and parameters of the effects.

        The nuisance parameters are a list of arrays, (p,), one for each group. The parameters of
        the effects are a dict of arrays, (q,), SI, by effect; they are zero where the rows of the
        axis do not depend on them.
        """
        nuisances, theta = self.solve(effects, axis)
        parameters = {}
        for pattern in self.evidence.patterns(effects):
            used = pattern.parameters[axis]
            parameters[pattern.effect] = np.zeros(pattern.design.shape[2])
            parameters[pattern.effect][used] = theta[: len(used)] / pattern.scale[axis]
            theta = theta[len(used) :]
        return nuisances, parameters

    def residuals(self, effects, axis):
        """Return the residuals of all rows on one axis, (N,), from the fit to the training rows."""
        nuisances, theta = self.solve(effects, axis)
        groups = zip(self.evidence.row_groups, nuisances, strict=True)
        fitted = np.concatenate([g.nuisance @ nuisance for g, nuisance in groups])
        fitted = fitted + self.evidence.matrix(self.evidence.columns_of(effects, axis)) @ theta
        return self.evidence.columns[self.residual_columns[axis]] - fitted

    def estimate(self, effects, axis):
        """Return the coefficients of the effects' columns, (k,), and their covariance, (k, k).

        The coefficients are estimated with the precision P̃ of one hypothesis, see `hypothesis`.
        Their covariance is ``A⁻¹ Zᵀ P̃ Σ P̃ Z A⁻¹``, with the columns Z, ``A = Zᵀ P̃ Z`` and the
        noise covariance Σ averaged over the hypotheses. Both results are None without a fit.
        """
        fit, columns = self.fit(effects, axis), self.evidence.columns_of(effects, axis)
        if fit is None:
            return None, None
        if not fit.scale.any():
            # all residuals of the axis are zero, so the coefficients are exactly zero
            return np.zeros(len(columns)), np.zeros((len(columns), len(columns)))
        information, spread = self.moments(fit, self.evidence.matrix(columns))
        size = np.sqrt(np.diag(information))
        inverse = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
        return fit.theta[self.hypothesis(fit)], inverse @ spread @ inverse

    def moments(self, fit, rows):
        """Return the information ``Zᵀ P̃ Z`` and its variance ``Zᵀ P̃ Σ P̃ Z``, both (k, k).

        `rows` are the columns Z, (N, k). The precision P̃ of the training rows is that of one
        hypothesis, see `hypothesis`. The noise covariance Σ is averaged over all hypotheses.
        """
        hypothesis, information, spread = self.hypothesis(fit), 0.0, 0.0
        for i, z in enumerate(self.evidence.split(rows)):
            weighted = self.apply_precision(i, hypothesis, z)
            noise = self.evidence.row_groups[i].noise.mean(fit.weight * fit.scale)
            information = information + z.T @ weighted
            spread = spread + weighted.T @ noise @ weighted
        return information, spread


def combined_axes(count, estimates):
    """Return the values of p parameters, (p,), and their covariance, (p, p), from several axes.

    `count` is p. `estimates` has for each axis the indices of its parameters, their values θ_a and
    their covariance C_a. Parameters that several axes share are averaged with the weights C_a⁻¹:
    ``C = (Σ C_a⁻¹)⁻¹`` and ``θ = C Σ C_a⁻¹ θ_a``. Parameters of no axis are zero.
    """
    values, covariance = np.zeros(count), np.zeros((count, count))
    for index, theta, spread in estimates:
        values[index], covariance[np.ix_(index, index)] = theta, spread
    indices = np.concatenate([np.zeros(0, int), *(index for index, _, _ in estimates)])
    # an axis that never changes has estimates of variance zero, which cannot be averaged
    estimates = [e for e in estimates if np.all(np.diag(e[2]) > 0)]
    if len(np.unique(indices)) == len(indices) or not estimates:
        return values, covariance
    precision, moment = np.zeros((count, count)), np.zeros(count)
    for index, theta, spread in estimates:
        size = np.sqrt(np.diag(spread))
        inverse = np.linalg.inv(spread / np.outer(size, size)) / np.outer(size, size)
        precision[np.ix_(index, index)] += inverse
        moment[index] += inverse @ theta
    seen = np.flatnonzero(np.diag(precision))
    size = np.sqrt(np.diag(precision)[seen])
    inverse = np.linalg.inv(precision[np.ix_(seen, seen)] / np.outer(size, size))
    covariance[np.ix_(seen, seen)] = inverse / np.outer(size, size)
    values[seen] = covariance[np.ix_(seen, seen)] @ moment[seen]
    return values, covariance
