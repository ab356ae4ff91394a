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
    # of each column that was asked for: what is taken out of it in each group, (h, u), and its
    # square by the first hypothesis, the nuisances not taken out
    _taken: dict = field(default_factory=dict)
    _whole: dict = field(default_factory=dict)
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

    def products(self, first, second):
        """Return products of columns with others, (h, a, b), summed over the groups.

        What is held out and the nuisances are taken out. Of columns Y and Z, with U as in `_roots`:
        ``Yᵀ P Z - (Uᵀ P Y)ᵀ (Uᵀ P U)⁻¹ (Uᵀ P Z)``.
        """
        self._enter((*first, *second))
        total, rows = 0.0, self.evidence.split(self.evidence.matrix(second))
        for i, z in enumerate(rows):
            taken = self.taken_out(i, first) @ np.swapaxes(self.taken_out(i, second), 1, 2)
            total = total + self.evidence.weighted_columns(i, first) @ z - taken
        return total

    def gram(self, columns):
        """Return the products of columns with each other, (h, k, k)."""
        return self.products(columns, columns)

    def _blocks(self, sets):
        """Return the products within each of several sets of columns, (s, q) to (h, s, q, q)."""
        flat, total = tuple(sets.ravel().tolist()), 0.0
        self._enter(flat)
        for i, z in enumerate(self.evidence.split(self.evidence.matrix(flat))):
            weighted, taken = self.evidence.weighted_columns(i, flat), self.taken_out(i, flat)
            weighted, taken = (x.reshape(len(x), *sets.shape, -1) for x in (weighted, taken))
            total = total + weighted @ z.T.reshape(*sets.shape, -1).swapaxes(1, 2)
            total = total - taken @ np.swapaxes(taken, 2, 3)
        return total

    def taken_out(self, i, columns):
        """Return what is taken out of columns in a group, (h, k, u)."""
        return np.stack([self._taken[c][i] for c in columns], axis=1)

    def _enter(self, columns):
        """Find what is taken out of those columns that nobody asked for before."""
        new = [c for c in dict.fromkeys(columns) if c not in self._taken]
        if not new:
            return
        taken, whole, full = [], 0.0, 0.0
        for i, z in enumerate(self.evidence.split(self.evidence.matrix(new))):
            weighted, held_rows = self.evidence.weighted_columns(i, new), self.held_rows[i]
            own = self.taken(i, slice(None), weighted)
            square = np.einsum("kn,nk->k", weighted[0], z)
            full, whole = full + square, whole + square
            whole = whole - (own[0, :, : len(held_rows)] ** 2).sum(axis=1)
            taken.append(own)
        # of a column that is zero in the training rows only rounding is left
        whole = np.where(whole > ROUNDING * full, whole, np.inf)
        self._taken |= {c: [own[:, k] for own in taken] for k, c in enumerate(new)}
        self._whole |= dict(zip(new, whole.tolist(), strict=True))

    def release(self):
        """Free the memory of fits and products; they are recomputed if needed."""
        for known in (self._fits, self._taken, self._whole):
            known.clear()

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
        columns_of, alike = self.evidence.columns_of, {}
        found = [[None] * len(more) for _ in self.residual_columns]
        for axis in range(len(self.residual_columns)):
            known = columns_of(base, axis)
            for k, effects in enumerate(more):
                own = columns_of(effects, axis)
                alike.setdefault((known, len(own)), {}).setdefault(own, []).append((axis, k))
        for (known, count), sets in alike.items():
            # axes that have the same columns share what these take
            own = np.reshape(list(sets), (len(sets), count)).astype(int)
            for each, places in zip(self._fit(known, own), sets.values(), strict=True):
                for axis, k in places:
                    found[axis][k] = each and each[axis]
        return found

    def _fit(self, known, sets):
        """Return the Fits by axis to columns with each of several sets, (s, q), of further ones.

        None for those that are not independent.
        """
        axes, (count, q) = len(self.residual_columns), sets.shape
        k, first = len(known) + q, axes + len(known)
        dof, least = self.free_rows - k, self.evidence.least
        if dof < 1:
            return [None] * count
        beside, flat = (*self.residual_columns, *known), tuple(sets.ravel().tolist())
        products = self.products(beside, (*beside, *flat))
        of_sets = products[:, :, first:].reshape(len(products), first, count, q)
        of_sets = of_sets.transpose(0, 2, 3, 1)
        own = np.empty((len(products), count, k, k))
        own[:, :, : k - q, : k - q] = products[:, None, axes:, axes:first]
        own[:, :, k - q :, : k - q] = of_sets[..., axes:]
        own[:, :, : k - q, k - q :] = np.swapaxes(of_sets[..., axes:], 2, 3)
        if q:
            own[:, :, k - q :, k - q :] = self._blocks(sets)
        # (h, s, k, axes), and (h, 1, axes)
        product = np.broadcast_to(products[:, None, axes:, :axes], (*own.shape[:2], k - q, axes))
        product = np.concatenate([product, of_sets[..., :axes]], axis=2)
        total = np.einsum("haa->ha", products[:, :axes, :axes])[:, None]
        whole = np.array([[self._whole[c] for c in (*known, *each)] for each in sets.tolist()])
        size = np.sqrt(np.maximum(np.einsum("hskk->hsk", own), 0.0))
        independent = np.all(size[0] ** 2 > ABSORBED * whole.reshape(count, k), axis=1)
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
            each = ((x[:, s, ..., a] for x in (theta, square, log_weight)) for a in range(axes))
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
        found = []
        for i, (root, held_rows) in enumerate(zip(self._roots, self.held_rows, strict=True)):
            own = self.taken_out(i, (self.residual_columns[axis], *columns))[of_nuisances]
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
