"""The fit to training rows: least squares under every hypothesis about the noise."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dtrtri
from scipy.special import softmax

# square of the share of a pattern that has to be left by what is known, for it to be seen
ABSORBED = 1e-6
# share of a column's square that rounding may leave
ROUNDING = 1e-12
# bytes of products beyond which those of a part of the data are not kept
KEPT = 1 << 21


@dataclass(frozen=True)
class Fit:
    """Least squares of one axis under every hypothesis about the noise."""

    theta: np.ndarray  # (h, k): parameters
    # (h, k, k): products of their columns of length one, and these lengths, (h, k)
    products: np.ndarray
    size: np.ndarray
    square: np.ndarray  # (h,): χ² of the residual; (h, m) of m records at once
    log_weight: np.ndarray  # (h,) or (h, m): logarithm of restricted likelihood times prior
    dof: int  # degrees of freedom
    least: float  # least size of the noise's variance, relative to that of a hypothesis

    @property
    def scale(self):
        """Variance of the noise, relative to that of each hypothesis, shape (h,) or (h, m)."""
        return np.maximum(self.least, self.square / self.dof)

    @property
    def spent(self):
        """What the residuals take from the logarithm of the weight, shape (h,) or (h, m)."""
        return (self.dof * np.log(self.scale) + self.square / self.scale) / 2

    @cached_property
    def inverse(self):
        """Their covariance where the noise has the size of the hypothesis, (h, k, k)."""
        return np.linalg.inv(self.products) / self.size[:, :, None] / self.size[:, None]

    @property
    def covariance(self):
        """Covariance of the parameters, shape (h, k, k)."""
        return self.inverse * self.scale[:, None, None]

    @property
    def weight(self):
        """Share of each hypothesis, summing to 1."""
        return softmax(self.log_weight, axis=-1)

    def averaged(self, weight):
        """Return the parameters, (k,), and their covariance, (k, k), averaged over the noise.

        Takes the weights of the hypotheses, (h,), whose spread is in the covariance.
        """
        values = weight @ self.theta
        off = self.theta - values
        spread = self.covariance + off[:, :, None] * off[:, None]
        return values, np.einsum("h,hpq->pq", weight, spread)


@dataclass
class TrainingFit:
    """Least squares of the rows that are not held out, the products of its columns kept."""

    evidence: object  # all rows
    held_rows: tuple  # rows of each group that are held out, or touch a part that is
    residual_columns: tuple  # number of the column that holds the residuals, by axis
    _place: dict = field(default_factory=dict)
    _sides: dict = field(default_factory=dict)
    _gram: np.ndarray | None = None
    _whole: np.ndarray = field(default_factory=lambda: np.zeros(0))
    _fits: dict = field(default_factory=dict)
    _steps: dict = field(default_factory=dict)

    @cached_property
    def _roots(self):
        """Of each group a root R of the covariance of what is taken out of it, ``(Uᵀ P U)⁻¹``.

        U has the unit vectors of the rows that are held out, each as if it had a parameter of its
        own, then the nuisances; R, (h, u, u), is upper triangular: the first are not of the last.
        """
        found = []
        parts = zip(self.evidence.row_groups, self.evidence.sides, self.held_rows, strict=True)
        for group, side, held_rows in parts:
            if not np.all(np.any(np.delete(group.nuisance, held_rows, axis=0), axis=0)):
                raise np.linalg.LinAlgError("a parameter that nothing seen depends on")
            own = group.noise.precision[:, held_rows[:, None], held_rows]
            beside = side[:, held_rows]
            corner = np.concatenate([np.swapaxes(beside, 1, 2), group.nuisance.T @ side], axis=2)
            own = np.concatenate([np.concatenate([own, beside], axis=2), corner], axis=1)
            size = np.sqrt(np.einsum("huu->hu", own))
            own = np.linalg.cholesky(own / size[:, :, None] / size[:, None])
            # (L⁻¹)ᵀ
            root = np.array([dtrtri(each.T)[0] for each in own])
            found.append(root / size[:, :, None])
        return found

    @cached_property
    def free_rows(self):
        """Number of training rows less nuisances."""
        groups = zip(self.evidence.row_groups, self.held_rows, strict=True)
        return sum(len(g.values) - len(held_rows) - g.nuisance.shape[1] for g, held_rows in groups)

    @cached_property
    def log_det(self):
        """``log det`` of the covariance and of the nuisances' information, shape (h,)."""
        groups = zip(self.evidence.row_groups, self._roots, strict=True)
        each = ((g, np.einsum("huu->hu", root)) for g, root in groups)
        return sum(g.noise.log_det - 2 * np.log(own).sum(axis=1) for g, own in each)

    def gram(self, columns):
        """Return products of columns, nuisances taken out, summed over the groups, (h, k, k).

        Of columns Z, with U as in `_roots`: ``Zᵀ P Z - (Uᵀ P Z)ᵀ (Uᵀ P U)⁻¹ (Uᵀ P Z)``.
        """
        self._enter(columns)
        place = np.array([self._place[c] for c in columns], dtype=int)
        return self._gram[:, place[:, None], place]

    def _enter(self, columns):
        """Add the products of those columns that nobody asked for before."""
        new = [c for c in dict.fromkeys(columns) if c not in self._place]
        if not new:
            return
        # they may not be determined: then no column has a place
        first, count, roots = len(self._place), len(self.evidence.prior), self._roots
        self._place |= {c: first + k for k, c in enumerate(new)}
        known, total = list(self._place), len(self._place)
        grown, added, whole, full = np.zeros((count, total, total)), 0.0, 0.0, 0.0
        if first:
            grown[:, :first, :first] = self._gram
        rows = self.evidence.split(self.evidence.matrix(known))
        groups = zip(self.evidence.row_groups, self.held_rows, rows, strict=True)
        for i, (group, held_rows, z) in enumerate(groups):
            # (h, new, known)
            more = np.stack([self.evidence.weighted[i][c] for c in new], axis=1)
            cross = more @ z
            side = np.concatenate([more[:, :, held_rows], more @ group.nuisance], axis=2) @ roots[i]
            if first:
                side = np.concatenate([self._sides[i], side], axis=1)
            self._sides[i], own = side, side[:, first:]
            # of the first hypothesis alone, the nuisances not taken out
            full = full + np.diag(cross[0, :, first:])
            whole = whole + np.diag(cross[0, :, first:])
            whole = whole - (own[0, :, : len(held_rows)] ** 2).sum(axis=1)
            added = added + cross - own @ np.swapaxes(side, 1, 2)
        grown[:, first:], grown[:, :, first:] = added, np.swapaxes(added, 1, 2)
        # of a column that is zero in the training rows only rounding is left
        whole = np.where(whole > ROUNDING * full, whole, np.inf)
        self._gram, self._whole = grown, np.append(self._whole, whole)

    def release(self):
        """Free the memory of fits and large products; they are recomputed if needed."""
        self._fits.clear()
        if self._gram is not None and self._gram.nbytes > KEPT:
            self._gram, self._whole = None, np.zeros(0)
            self._place.clear()
            self._sides.clear()

    def apply_precision(self, i, hypothesis, columns):
        """Return ``P̃ X`` of columns X of a group, (n, k), zero in the rows that are held out.

        P̃ is the precision of the rows that are seen, the nuisances taken out.
        """
        whole = self.evidence.row_groups[i].noise.precision[hypothesis]
        held_rows = self.held_rows[i]
        found = whole @ columns
        taken = self._roots[i][hypothesis] @ self.taken(i, hypothesis, found.T).T
        found -= whole[:, held_rows] @ taken[: len(held_rows)]
        found -= self.evidence.sides[i][hypothesis] @ taken[len(held_rows) :]
        found[held_rows] = 0.0
        return found

    def taken(self, i, hypothesis, weighted):
        """Return t, (..., u), by which ``xᵀ P̃ y = xᵀ P y - t_x·t_y``, of the rows ``xᵀ P`` of x."""
        nuisance = self.evidence.row_groups[i].nuisance
        side = np.concatenate([weighted[..., self.held_rows[i]], weighted @ nuisance], axis=-1)
        return side @ self._roots[i][hypothesis]

    def of_steps(self, i, hypothesis):
        """Return what a group tells of the size of a step before each of its rows, (n,)."""
        if (i, hypothesis) not in self._steps:
            whole = self.evidence.row_groups[i].noise.precision[hypothesis]
            # sums over all rows from one on are products with its step
            after = whole[::-1].cumsum(axis=0)[::-1]
            lost = (self.taken(i, hypothesis, after) ** 2).sum(axis=1)
            self._steps[i, hypothesis] = np.triu(after).sum(axis=1) - lost
        return self._steps[i, hypothesis]

    def fit(self, effects, axis):
        """Return the Fit of an axis to effects; None where they are not independent."""
        key = tuple(effects)
        if key not in self._fits:
            self._fits[key] = [fit for (fit,) in self.fits(effects, [()])]
        return self._fits[key][axis]

    def fits(self, base, more):
        """Return by axis the Fits to base effects with each of several tuples of further ones.

        None where their columns are not independent, or as many as rows.
        """
        columns_of, by_count = self.evidence.columns_of, {}
        found = [[None] * len(more) for _ in self.residual_columns]
        for axis in range(len(self.residual_columns)):
            known = columns_of(base, axis)
            for k, effects in enumerate(more):
                columns = (*known, *columns_of(effects, axis))
                by_count.setdefault(len(columns), {}).setdefault(columns, []).append((axis, k))
        used = (c for sets in by_count.values() for own in sets for c in own)
        self._enter((*self.residual_columns, *used))
        for sets in by_count.values():
            # axes that have the same columns share what these take
            for each, own in zip(self._fit(list(sets)), sets.values(), strict=True):
                for axis, k in own:
                    found[axis][k] = each and each[axis]
        return found

    def _fit(self, sets):
        """Return of sets of as many columns the fits by axis, None where not independent."""
        sets = np.array(sets, dtype=int)
        count, k = sets.shape
        dof, least = self.free_rows - k, self.evidence.least
        if dof < 1:
            return [None] * count
        place = np.array([self._place[c] for c in sets.ravel().tolist()], int).reshape(count, k)
        at = np.array([self._place[value] for value in self.residual_columns])
        # (h, s, k, axes), and (h, 1, axes)
        product, total = self._gram[:, place[:, :, None], at], self._gram[:, None, at, at]
        own = self._gram[:, place[:, :, None], place[:, None]]
        size = np.sqrt(np.maximum(np.einsum("hskk->hsk", own), 0.0))
        independent = np.all(size[0] ** 2 > ABSORBED * self._whole[place], axis=1)
        size = np.where(size > 0, size, 1.0)
        own, product = own / size[..., :, None] / size[..., None, :], product / size[..., None]
        independent &= np.linalg.eigvalsh(own[0]).min(axis=1, initial=1.0) > ABSORBED
        # what is not independent is not inverted
        own[:, ~independent] = np.eye(k)
        theta = np.linalg.solve(own, product)
        square = np.maximum(total - (theta * product).sum(axis=2), 1e-12 * total)
        log_det = self.log_det[:, None] + np.linalg.slogdet(own)[1] + 2 * np.log(size).sum(axis=2)
        theta = theta / size[..., None]
        scale = np.maximum(least, square / dof)
        log_weight = (self.evidence.prior[:, None] - log_det / 2)[..., None]
        log_weight = log_weight - (dof * np.log(scale) + square / scale) / 2

        def by_axis(s):
            each = ((x[:, s, ..., a] for x in (theta, square, log_weight)) for a in range(len(at)))
            return [
                Fit(theta, own[:, s], size[:, s], square, log_weight, dof, least)
                for theta, square, log_weight in each
            ]

        return [by_axis(s) if independent[s] else None for s in range(count)]

    def hypothesis(self, fit):
        """Return the hypothesis at which parameters are estimated.

        The likeliest of those in `Evidence.estimation_mask`.
        """
        return int(np.argmax(np.where(self.evidence.estimation_mask, fit.log_weight, -np.inf)))

    def solved(self, effects, axis):
        """Return nuisances of each group, (p,), and coefficients of effects' columns, (k,)."""
        fit, columns = self.fit(effects, axis), self.evidence.columns_of(effects, axis)
        if fit is None and columns:
            return self.solved((), axis)[0], np.zeros(len(columns))
        if fit is None:
            raise np.linalg.LinAlgError("fewer rows are seen than parameters")
        hypothesis = self.hypothesis(fit)
        index = self.evidence.nuisance_index
        of_nuisances = hypothesis if index is None else index
        theta = fit.theta[hypothesis]
        at, found = [self._place[c] for c in (self.residual_columns[axis], *columns)], []
        each = zip(self._roots, self._sides.values(), self.held_rows, strict=True)
        for root, side, held_rows in each:
            own = side[of_nuisances][at]
            found.append((root[of_nuisances] @ (own[0] - theta @ own[1:]))[len(held_rows) :])
        return found, theta

    def parameters(self, effects, axis):
        """Return nuisances, (p,) of each group, and parameters, (q,) SI by effect, of an axis.

        Zero for the parameters that the axis does not have.
        """
        nuisances, theta = self.solved(effects, axis)
        found = {}
        for pattern in self.evidence.patterns(effects):
            used = pattern.parameters[axis]
            found[pattern.effect] = np.zeros(pattern.design.shape[2])
            found[pattern.effect][used] = theta[: len(used)] / pattern.scale[axis]
            theta = theta[len(used) :]
        return nuisances, found

    def residuals(self, effects, axis):
        """Return the residuals of all rows by a fit to the training rows, (N,)."""
        nuisances, theta = self.solved(effects, axis)
        groups = zip(self.evidence.row_groups, nuisances, strict=True)
        taken = np.concatenate([g.nuisance @ nuisance for g, nuisance in groups])
        taken = taken + self.evidence.matrix(self.evidence.columns_of(effects, axis)) @ theta
        return self.evidence.columns[self.residual_columns[axis]] - taken

    def estimate(self, effects, axis):
        """Return coefficients of effects' columns, (k,), and covariance; None, None without a fit.

        At `hypothesis`. The noise that is there is not known better than the
        restricted likelihood tells: with the information A, ``A⁻¹ Zᵀ P̃ Σ P̃ Z A⁻¹``.
        """
        fit, columns = self.fit(effects, axis), self.evidence.columns_of(effects, axis)
        if fit is None:
            return None, None
        if not fit.scale.any():
            # a silent axis shows nothing, and that for certain
            return np.zeros(len(columns)), np.zeros((len(columns), len(columns)))
        information, spread = self.moments(fit, self.evidence.matrix(columns))
        size = np.sqrt(np.diag(information))
        inverse = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
        return fit.theta[self.hypothesis(fit)], inverse @ spread @ inverse

    def moments(self, fit, rows):
        """Return ``A = Zᵀ P̃ Z`` and ``Zᵀ P̃ Σ P̃ Z`` of columns Z, (N, k).

        By the precision P̃ of what is seen at the `hypothesis` of a fit, and the noise Σ, averaged
        over all.
        """
        hypothesis, information, spread = self.hypothesis(fit), 0.0, 0.0
        for i, own in enumerate(self.evidence.split(rows)):
            weighted = self.apply_precision(i, hypothesis, own)
            noise = self.evidence.row_groups[i].noise.mean(fit.weight * fit.scale)
            information = information + own.T @ weighted
            spread = spread + weighted.T @ noise @ weighted
        return information, spread


def combined_axes(count, estimates):
    """Return `count` parameters, (p,), and their covariance, (p, p), from the estimates of axes.

    Of each axis numbers of the parameters, values and covariance; what no axis has is zero. One
    that several axes have is weighed by their covariances, the others of these axes with it:
    ``C = (Σ C_a⁻¹)⁻¹``, ``θ = C Σ C_a⁻¹ θ_a``.
    """
    values, covariance = np.zeros(count), np.zeros((count, count))
    for at, found, spread in estimates:
        values[at], covariance[np.ix_(at, at)] = found, spread
    known = np.concatenate([np.zeros(0, int), *(at for at, _, _ in estimates)])
    # an axis that never changes knows its own for certain, and nothing of the others
    estimates = [e for e in estimates if np.all(np.diag(e[2]) > 0)]
    if len(np.unique(known)) == len(known) or not estimates:
        return values, covariance
    precision, moment = np.zeros((count, count)), np.zeros(count)
    for at, found, spread in estimates:
        size = np.sqrt(np.diag(spread))
        own = np.linalg.inv(spread / np.outer(size, size)) / np.outer(size, size)
        precision[np.ix_(at, at)] += own
        moment[at] += own @ found
    seen = np.flatnonzero(np.diag(precision))
    size = np.sqrt(np.diag(precision)[seen])
    own = np.linalg.inv(precision[np.ix_(seen, seen)] / np.outer(size, size))
    covariance[np.ix_(seen, seen)] = own / np.outer(size, size)
    values[seen] = covariance[np.ix_(seen, seen)] @ moment[seen]
    return values, covariance
