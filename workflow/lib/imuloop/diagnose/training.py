"""Training rows: those that a fit sees, and least squares of them under every hypothesis."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import softmax

# square of the share of a pattern that has to be left by what is known, for it to be seen
ABSORBED = 1e-6


@dataclass(frozen=True)
class Fit:
    """Least squares of one axis under every hypothesis about the noise."""

    theta: np.ndarray  # (h, k): parameters
    # (h, k, k): their covariance where the noise has the size of the hypothesis
    inverse: np.ndarray
    square: np.ndarray  # (h,): χ² of the residual; (h, m) of m records at once
    log_weight: np.ndarray  # (h,) or (h, m): logarithm of restricted likelihood times prior
    dof: int  # degrees of freedom
    least: np.ndarray  # (h,): least size of the noise's variance

    @property
    def scale(self):
        """Variance of the noise, relative to that of each hypothesis, shape (h,) or (h, m)."""
        return np.maximum(self.least, self.square.T / self.dof).T

    @property
    def spent(self):
        """What the residuals take from the logarithm of the weight, shape (h,) or (h, m)."""
        return (self.dof * np.log(self.scale) + self.square / self.scale) / 2

    @property
    def covariance(self):
        """Covariance of the parameters, shape (h, k, k)."""
        return self.inverse * self.scale[:, None, None]

    @property
    def weight(self):
        """Share of each hypothesis, summing to 1."""
        return softmax(self.log_weight, axis=-1)

    def averaged(self, weight):
        """Return the parameters, and their covariance, averaged over the noise by weights, (h,)."""
        values = weight @ self.theta
        off = self.theta - values
        spread = self.covariance + off[:, :, None] * off[:, None]
        return values, np.einsum("h,hpq->pq", weight, spread)


@dataclass
class Training:
    """What a fit sees: the rows outside some parts, or those of some blocks."""

    evidence: object  # all rows
    # rows of each block that are held out; None for a block that is not seen at all
    held: tuple
    values: tuple  # columns of the residuals of each axis
    _place: dict = field(default_factory=dict)
    _sides: dict = field(default_factory=dict)
    _ahead: dict = field(default_factory=dict)
    _gram: np.ndarray | None = None
    _whole: np.ndarray = field(default_factory=lambda: np.zeros(0))
    _fits: dict = field(default_factory=dict)

    @cached_property
    def _seen(self):
        """The blocks that are seen, each with what its held rows know of each other."""
        return {
            i: np.linalg.inv(self.evidence.blocks[i].noise.precision[:, held][:, :, held])
            for i, held in enumerate(self.held)
            if held is not None
        }

    @cached_property
    def _nuisances(self):
        """Of each block that is seen a root of the nuisances' covariance, (h, p, p): ``R Rᵀ``."""
        found = {}
        for i, covariance in self._seen.items():
            block, side, held = self.evidence.blocks[i], self.evidence.sides[i], self.held[i]
            own = np.swapaxes(side, 1, 2) @ block.nuisance
            if len(held):
                ahead = side[:, held]
                own = own - np.swapaxes(ahead, 1, 2) @ covariance @ ahead
            square = np.einsum("hpp->hp", own)
            if not np.all(square > 0):
                raise np.linalg.LinAlgError("a parameter that nothing seen depends on")
            size = np.sqrt(square)
            root = np.linalg.inv(np.linalg.cholesky(own / size[:, :, None] / size[:, None]))
            found[i] = np.swapaxes(root, 1, 2) / size[:, :, None]
        return found

    @cached_property
    def rows(self):
        """Number of rows less nuisances."""
        blocks = self.evidence.blocks
        return sum(
            len(blocks[i].values) - len(self.held[i]) - blocks[i].nuisance.shape[1]
            for i in self._seen
        )

    @cached_property
    def log_det(self):
        """``log det`` of the covariance and of the nuisances' information, shape (h,)."""
        total = 0.0
        for i, covariance in self._seen.items():
            root = self._nuisances[i]
            total = total + self.evidence.blocks[i].noise.log_det
            total = total - np.linalg.slogdet(covariance)[1] - 2 * np.linalg.slogdet(root)[1]
        return total

    def gram(self, columns):
        """Return products of columns, nuisances taken out, summed over the blocks, (h, k, k).

        Seen rows alone have the precision ``P_ss - P_sh P_hh⁻¹ P_hs``, so the products of the
        columns Z are ``Zᵀ P Z - (P Z)_hᵀ P_hh⁻¹ (P Z)_h``. Nuisances B are taken out likewise:
        less ``(Bᵀ P Z)ᵀ (Bᵀ P B)⁻¹ (Bᵀ P Z)``.
        """
        new = [c for c in dict.fromkeys(columns) if c not in self._place]
        if new:
            self._enter(new)
        place = np.array([self._place[c] for c in columns], dtype=int)
        return self._gram[:, place[:, None], place]

    def _enter(self, new):
        """Add the products of columns that nobody asked for before."""
        # they may not be determined: then no column has a place
        first, points, nuisances = len(self._place), len(self.evidence.prior), self._nuisances
        self._place |= {c: first + k for k, c in enumerate(new)}
        known, total = list(self._place), len(self._place)
        grown, added, whole = np.zeros((points, total, total)), 0.0, 0.0
        if first:
            grown[:, :first, :first] = self._gram
        for i, covariance in self._seen.items():
            held, columns = self.held[i], self.evidence.columns[i]
            z = np.column_stack([columns[c] for c in known])
            # (h, new, known)
            more = np.stack([self.evidence.weighted[i][c] for c in new], axis=1)
            cross, side = more @ z, more @ self.evidence.blocks[i].nuisance
            if len(held):
                ahead = more[:, :, held]
                before = ahead @ covariance
                side = side - before @ self.evidence.sides[i][:, held]
                if first:
                    ahead = np.concatenate([self._ahead[i], ahead], axis=1)
                self._ahead[i] = ahead
                cross = cross - before @ np.swapaxes(ahead, 1, 2)
            side = side @ nuisances[i]
            if first:
                side = np.concatenate([self._sides[i], side], axis=1)
            self._sides[i] = side
            # of the first hypothesis alone
            whole = whole + np.einsum("kk->k", cross[0, :, first:])
            added = added + cross - side[:, first:] @ np.swapaxes(side, 1, 2)
        grown[:, first:], grown[:, :, first:] = added, np.swapaxes(added, 1, 2)
        self._gram, self._whole = grown, np.append(self._whole, whole)

    def release(self):
        """Let go of all products, 40 MB for each part of the data; they are made again if asked."""
        self._gram, self._whole = None, np.zeros(0)
        for kept in (self._place, self._sides, self._ahead, self._fits):
            kept.clear()

    def precision(self, i, point):
        """Return the precision of the rows that are seen of a block, its nuisances taken out."""
        block, held = self.evidence.blocks[i], self.held[i]
        whole = block.noise.precision[point]
        seen = np.delete(np.arange(len(whole)), held)
        cross = whole[np.ix_(held, seen)]
        found = whole[np.ix_(seen, seen)] - cross.T @ self._seen[i][point] @ cross
        side = found @ block.nuisance[seen] @ self._nuisances[i][point]
        return found - side @ side.T

    def fit(self, columns, axis):
        """Return the Fit of an axis to columns; None where they are not independent."""
        key = tuple(columns), axis
        if key not in self._fits:
            (self._fits[key],) = self.fits((), (key[0],), axis)
        return self._fits[key]

    def fits(self, base, more, axis):
        """Return the Fits of an axis to base columns with each of several sets of further ones.

        None where the columns are not independent, or as many as rows.
        """
        value, found = self.values[axis], [None] * len(more)
        self.gram((value, *base, *(c for columns in more for c in columns)))
        for width in {len(columns) for columns in more}:
            at = [k for k, columns in enumerate(more) if len(columns) == width]
            sets = np.array([(*base, *more[k]) for k in at], dtype=int).reshape(len(at), -1)
            for k, fit in zip(at, self._fit(value, sets), strict=True):
                found[k] = fit
        return found

    def _fit(self, value, sets):
        """Return the fits to sets of as many columns, shape (s, k)."""
        count, k = sets.shape
        dof, least = self.rows - k, self.evidence.least
        if dof < 1:
            return [None] * count
        place = np.vectorize(self._place.get, otypes=[int])(sets) if k else sets
        at = self._place[value]
        square = np.repeat(self._gram[:, at, at][:, None], count, axis=1)
        product = self._gram[:, at, :][:, place]
        own = self._gram[:, place[:, :, None], place[:, None]]
        theta, inverse, log_det = product, own, np.repeat(self.log_det[:, None], count, axis=1)
        independent = np.ones(count, dtype=bool)
        if k:
            size = np.sqrt(np.maximum(np.einsum("hskk->hsk", own), 0.0))
            independent = np.all(size[0] ** 2 > ABSORBED * self._whole[place], axis=1)
            size = np.where(size > 0, size, 1.0)
            own = own / size[..., :, None] / size[..., None, :]
            independent &= np.linalg.eigvalsh(own[0])[:, 0] > ABSORBED
            # what is not independent is not inverted
            own[:, ~independent] = np.eye(k)
            inverse, product = np.linalg.inv(own), product / size
            theta = (inverse @ product[..., None])[..., 0]
            square, total = square - (theta * product).sum(axis=2), square
            square = np.maximum(square, 1e-12 * total)
            log_det = log_det + np.linalg.slogdet(own)[1] + 2 * np.log(size).sum(axis=2)
            theta = theta / size
            inverse = inverse / size[..., :, None] / size[..., None, :]
        scale = np.maximum(least[:, None], square / dof)
        log_weight = self.evidence.prior[:, None] - log_det / 2
        log_weight = log_weight - (dof * np.log(scale) + square / scale) / 2
        return [
            Fit(theta[:, s], inverse[:, s], square[:, s], log_weight[:, s], dof, least)
            if independent[s]
            else None
            for s in range(count)
        ]

    def point(self, fit):
        """Return the hypothesis at which parameters are estimated: the likeliest of the still."""
        return int(np.argmax(np.where(self.evidence.still, fit.log_weight, -np.inf)))

    def solved(self, columns, axis):
        """Return nuisances of each block that is seen, (p,), and coefficients of columns, (k,)."""
        fit = self.fit(columns, axis)
        if fit is None and columns:
            return self.solved((), axis)[0], np.zeros(len(columns))
        if fit is None:
            raise np.linalg.LinAlgError("fewer rows are seen than parameters")
        point = self.point(fit)
        even = point if self.evidence.even is None else self.evidence.even
        theta, at = fit.theta[point], [self._place[c] for c in (self.values[axis], *columns)]
        found = {}
        for i, side in self._sides.items():
            own = side[even][at]
            found[i] = self._nuisances[i][even] @ (own[0] - theta @ own[1:])
        return found, theta

    def parameters(self, effects, axis):
        """Return nuisances, (p,) by block, and parameters, (q,) SI by effect, of an axis.

        Zero for the parameters that the axis does not have.
        """
        nuisances, theta = self.solved(self.evidence.columns_of(effects, axis), axis)
        found = {}
        for pattern in self.evidence.patterns(effects):
            used = pattern.parameters[axis]
            found[pattern.effect] = np.zeros(pattern.design.shape[2])
            found[pattern.effect][used] = theta[: len(used)] / pattern.scale[axis]
            theta = theta[len(used) :]
        return nuisances, found

    def left(self, columns, axis):
        """Return what columns and nuisances, fitted to what is seen, leave of all rows, by block.

        None for a block that is not seen.
        """
        nuisances, theta = self.solved(columns, axis)
        found = [None] * len(self.held)
        for i, nuisance in nuisances.items():
            own = self.evidence.columns[i]
            left = own[self.values[axis]] - self.evidence.blocks[i].nuisance @ nuisance
            found[i] = left - sum((t * own[c] for t, c in zip(theta, columns, strict=True)), 0.0)
        return found

    def estimate(self, columns, axis):
        """Return coefficients of columns, (k,), and their covariance; None, None without a fit.

        At the likeliest still hypothesis. The noise that is there is not known better than the
        restricted likelihood tells: with the information A, ``A⁻¹ Zᵀ P̃ Σ P̃ Z A⁻¹``.
        """
        fit = self.fit(columns, axis)
        if fit is None:
            return None, None
        if not fit.scale.any():
            # a silent axis shows nothing, and that for certain
            return np.zeros(len(columns)), np.zeros((len(columns), len(columns)))
        rows = [np.column_stack([own[c] for c in columns]) for own in self.evidence.columns]
        information, spread = self.moments(fit, rows)
        size = np.sqrt(np.diag(information))
        inverse = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
        return fit.theta[self.point(fit)], inverse @ spread @ inverse

    def moments(self, fit, rows):
        """Return ``A = Zᵀ P̃ Z`` and ``Zᵀ P̃ Σ P̃ Z`` of columns Z, given by block, (n, k).

        By the precision P̃ of what is seen at the likeliest still hypothesis of a fit, and the noise
        Σ, averaged over all.
        """
        point, information, spread = self.point(fit), 0.0, 0.0
        for i in self._seen:
            seen = np.delete(np.arange(len(rows[i])), self.held[i])
            weighted = self.precision(i, point) @ rows[i][seen]
            noise = self.evidence.blocks[i].noise.mean(fit.weight * fit.scale)
            information = information + rows[i][seen].T @ weighted
            spread = spread + weighted.T @ noise[np.ix_(seen, seen)] @ weighted
        return information, spread


def pooled(count, estimates):
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
