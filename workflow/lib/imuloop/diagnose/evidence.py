"""Evidence: products of residuals and patterns under every hypothesis about the noise."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.special import betainc, betaln

# square of the share of a pattern that has to be left by what is known, for it to be seen
ABSORBED = 1e-6


@dataclass(frozen=True)
class Hypotheses:
    """What the noise of some rows may be.

    Attributes
    ----------
    precision : ndarray, shape (h, n, n)
        Inverse of the covariance under each hypothesis.
    log_det : ndarray, shape (h,)
        Logarithm of the covariance's determinant.
    """

    precision: np.ndarray
    log_det: np.ndarray

    @classmethod
    def of(cls, covariances, count):
        """Return those of `count` covariances, shape (n, n), taken one at a time."""
        precision, log_det = None, np.empty(count)
        for h, covariance in enumerate(covariances):
            if precision is None:
                precision = np.empty((count, *covariance.shape))
            root = np.linalg.inv(np.linalg.cholesky(covariance))
            precision[h] = root.T @ root
            log_det[h] = -2 * np.log(np.diag(root)).sum()
        return cls(precision, log_det)

    def mean(self, weights):
        """Return the covariance, averaged with weights, shape (h,), not of what counts nothing."""
        counted = np.flatnonzero(weights > 1e-9 * weights.max())
        return sum(weights[h] * np.linalg.inv(self.precision[h]) for h in counted)


@dataclass(frozen=True)
class Block:
    """Rows whose noise is independent of that of all other rows, with nuisances of their own.

    Attributes
    ----------
    values : ndarray, shape (n, a)
        Residuals of a axes, which share the noise but for its size.
    nuisance : ndarray, shape (n, p)
        Derivative with respect to what every fit estimates: a level, or the base model.
    noise : Hypotheses
        Their noise.
    folds : ndarray of int, shape (n, 2)
        The part that a row is held out with, and the other that it touches; -1 for none.
    """

    values: np.ndarray
    nuisance: np.ndarray
    noise: Hypotheses
    folds: np.ndarray


@dataclass(frozen=True, eq=False)
class Pattern:
    """What one shape of an effect adds to the rows.

    Attributes
    ----------
    effect : Effect
        The shape.
    design : ndarray, shape (N, a, q)
        Derivative of all rows with respect to the parameters.
    columns, parameters : tuple of tuple of int
        Of each axis the columns of the parameters that it has, and which these are.
    scale : tuple of ndarray
        Norms that the columns were divided by.
    """

    effect: object
    design: np.ndarray
    columns: tuple[tuple[int, ...], ...]
    parameters: tuple[tuple[int, ...], ...]
    scale: tuple[np.ndarray, ...]

    @property
    def name(self):
        """Name of the effect."""
        return self.effect.name


class Evidence:
    """Rows of all blocks with the patterns that may explain them.

    Parameters
    ----------
    blocks : sequence of Block
        Rows.
    prior : ndarray, shape (h,)
        Logarithm of each hypothesis' probability before the data.
    design : callable
        Gives the derivative of all rows with respect to an effect's parameters, (N, a, q).
    least : float or ndarray, shape (h,)
        Least share of a hypothesis' variance that noise can have: 1 where its size is known.
    still : ndarray of bool, shape (h,)
        Hypotheses at which parameters are estimated; all by default.
    plain : ndarray of bool, shape (h,)
        Those of the noise as it was seen, no slower; those of `still` by default.
    even : int, optional
        Hypothesis at which nuisances are estimated beside given parameters; that of the parameters
        by default.
    """

    def __init__(self, blocks, prior, design, least=0.0, still=None, plain=None, even=None):
        self.blocks, self.prior, self.design = tuple(blocks), prior, design
        self.least = np.broadcast_to(least, prior.shape)
        self.still = np.ones(len(prior), dtype=bool) if still is None else still
        self.even = even
        self.plain = self.still if plain is None else plain
        self.axes = self.blocks[0].values.shape[1]
        # of each block: columns, and their products with the precision, (h, n)
        self.columns, self.weighted = [[] for _ in self.blocks], [[] for _ in self.blocks]
        self._known, self._patterns, self._sights, self._made = {}, {}, {}, {}
        # first the nuisances, which differ from block to block
        self.sides = [b.noise.precision @ b.nuisance for b in self.blocks]
        self.values = self.enter(np.concatenate([b.values for b in self.blocks]).T)
        self._ends = np.cumsum([len(b.values) for b in self.blocks])[:-1]

    def enter(self, vectors):
        """Return the numbers of columns, shape (k, N); one that is known is entered once."""
        new, numbers = [], []
        for vector in vectors:
            key = vector.tobytes()
            if key not in self._known:
                self._known[key] = len(self._known)
                new.append(vector)
            numbers.append(self._known[key])
        if new:
            ends = np.cumsum([len(b.values) for b in self.blocks])[:-1]
            for i, part in enumerate(np.split(np.array(new), ends, axis=1)):
                self.columns[i] += list(part)
                weighted = self.blocks[i].noise.precision @ part.T
                self.weighted[i] += list(np.moveaxis(weighted, 2, 0))
        return tuple(numbers)

    def patterns(self, effects):
        """Return the patterns of effects, their columns entered."""
        new = [e for e in dict.fromkeys(effects) if e not in self._patterns]
        designs = [self._made[e] if e in self._made else self.design(e) for e in new]
        vectors, places = [], []
        for design in designs:
            for axis in range(self.axes):
                used = np.flatnonzero(np.any(design[:, axis] != 0, axis=0))
                scale = np.linalg.norm(design[:, axis, used], axis=0)
                places.append((tuple(used.tolist()), scale, len(vectors)))
                vectors += list((design[:, axis, used] / scale).T)
        numbers = self.enter(vectors)
        for k, (effect, design) in enumerate(zip(new, designs, strict=True)):
            own = places[k * self.axes : (k + 1) * self.axes]
            self._patterns[effect] = Pattern(
                effect,
                design,
                tuple(numbers[at : at + len(used)] for used, _, at in own),
                tuple(used for used, _, _ in own),
                tuple(scale for _, scale, _ in own),
            )
        return tuple(self._patterns[effect] for effect in effects)

    def know(self, key, design):
        """Enter a pattern of any kind, (N, a, q), under a key that stands for an effect."""
        self._made[key] = design

    def sight(self, out=frozenset(), only=None, values=None):
        """Return the Sight that lacks what touches some parts, or sees some blocks alone.

        Parameters
        ----------
        out : frozenset of int
            Parts.
        only : frozenset of int, optional
            Blocks to see; all by default.
        values : tuple of int, optional
            Columns of the residuals, where they are others without these parts.
        """
        key = out, only
        if key not in self._sights:
            held = tuple(
                np.flatnonzero(np.isin(b.folds, list(out)).any(axis=1))
                if only is None or i in only
                else None
                for i, b in enumerate(self.blocks)
            )
            self._sights[key] = Sight(self, held, values or self.values)
        return self._sights[key]

    def split(self, rows):
        """Return an array of all rows, shape (N, …), block by block."""
        return np.split(rows, self._ends)


@dataclass
class Sight:
    """What a fit sees: the rows outside some parts, or those of some blocks.

    Attributes
    ----------
    evidence : Evidence
        All rows.
    held : tuple of ndarray of int
        The rows of each block that are not seen; None for a block that is not seen at all.
    values : tuple of int
        Columns of the residuals of each axis.
    """

    evidence: Evidence
    held: tuple
    values: tuple
    _place: dict = field(default_factory=dict)
    _sides: dict = field(default_factory=dict)
    _ahead: dict = field(default_factory=dict)
    _gram: np.ndarray | None = None
    _whole: np.ndarray | None = None
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

        Parameters
        ----------
        columns : sequence of int
            Columns of the evidence.
        """
        new = [c for c in dict.fromkeys(columns) if c not in self._place]
        if new:
            self._enter(new)
        place = np.array([self._place[c] for c in columns], dtype=int)
        return self._gram[:, place[:, None], place]

    def whole(self, columns):
        """Return the square of columns, shape (h, k), before nuisances are taken out."""
        self.gram(columns)
        return self._whole[:, [self._place[c] for c in columns]]

    def _enter(self, new):
        """Add the products of columns that nobody asked for before."""
        first, points = len(self._place), len(self.evidence.prior)
        self._place |= {c: first + k for k, c in enumerate(new)}
        known, total = list(self._place), len(self._place)
        if self._gram is None or self._gram.shape[1] < total:
            old, old_whole, size = self._gram, self._whole, total + total // 3
            self._gram, self._whole = np.zeros((points, size, size)), np.zeros((points, size))
            if first:
                self._gram[:, :first, :first] = old[:, :first, :first]
                self._whole[:, :first] = old_whole[:, :first]
        added, whole = 0.0, 0.0
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
            side = side @ self._nuisances[i]
            if first:
                side = np.concatenate([self._sides[i], side], axis=1)
            self._sides[i] = side
            whole = whole + np.einsum("hkk->hk", cross[:, :, first:])
            added = added + cross - side[:, first:] @ np.swapaxes(side, 1, 2)
        self._gram[:, first:total, :total] = added
        self._gram[:, :total, first:total] = np.swapaxes(added, 1, 2)
        self._whole[:, first:total] = whole

    def release(self):
        """Let go of all products; what is asked for again is made again.

        Those of a hundred columns under every hypothesis are 40 MB for each part of the data.
        """
        self._gram = self._whole = None
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
            base = self.fits((), (key[0],), axis)
            self._fits[key] = base[0]
        return self._fits[key]

    def fits(self, base, more, axis):
        """Return the Fits of an axis to base columns with each of several sets of further ones.

        Parameters
        ----------
        base : tuple of int
            Columns of every fit.
        more : sequence of tuple of int
            Columns beside them, fit by fit.
        axis : int
            Axis.

        Returns
        -------
        list of Fit or None
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
            whole = self._whole[0][place]
            independent = np.all(size[0] ** 2 > ABSORBED * whole, axis=1)
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
        """Return nuisances of each block and coefficients of columns, fitted to what is seen.

        Returns
        -------
        dict of int to ndarray, shape (p,)
            Of the blocks that are seen.
        ndarray, shape (k,)
            In the columns' units.
        """
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

    def left(self, columns, axis):
        """Return what columns and nuisances, fitted to what is seen, leave of all rows.

        Returns
        -------
        list of ndarray, shape (n,)
            One a block; None for a block that is not seen.
        """
        nuisances, theta = self.solved(columns, axis)
        found = [None] * len(self.held)
        for i, nuisance in nuisances.items():
            own = self.evidence.columns[i]
            left = own[self.values[axis]] - self.evidence.blocks[i].nuisance @ nuisance
            found[i] = left - sum((t * own[c] for t, c in zip(theta, columns, strict=True)), 0.0)
        return found

    def estimate(self, columns, axis):
        """Return coefficients of columns and nuisances, and their covariance.

        At the likeliest still hypothesis. The noise that is there is not known better than the
        restricted likelihood tells: with the information A and the precision P̃ of what is seen,
        ``A⁻¹ Zᵀ P̃ Σ P̃ Z A⁻¹`` is averaged over the noise Σ.

        Returns
        -------
        ndarray, shape (k,), ndarray, shape (k, k)
            Coefficients in the columns' units; None, None where they are not independent.
        """
        fit = self.fit(columns, axis)
        if fit is None:
            return None, None
        point, information, spread = self.point(fit), 0.0, 0.0
        for i in self._seen:
            precision = self.precision(i, point)
            seen = np.delete(np.arange(len(self.evidence.columns[i][0])), self.held[i])
            z = np.column_stack([self.evidence.columns[i][c][seen] for c in columns])
            weighted = precision @ z
            noise = self.evidence.blocks[i].noise.mean(fit.weight * fit.scale)
            information = information + z.T @ weighted
            spread = spread + weighted.T @ noise[np.ix_(seen, seen)] @ weighted
        size = np.sqrt(np.diag(information))
        inverse = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
        return fit.theta[point], inverse @ spread @ inverse


@dataclass(frozen=True)
class Fit:
    """Least squares of one axis under every hypothesis.

    Attributes
    ----------
    theta : ndarray, shape (h, k)
        Parameters.
    inverse : ndarray, shape (h, k, k)
        Their covariance where the noise has the size of the hypothesis.
    square : ndarray, shape (h,)
        χ² of the residual.
    log_weight : ndarray, shape (h,)
        Logarithm of restricted likelihood times prior.
    dof : int
        Degrees of freedom.
    least : ndarray, shape (h,)
        Least size of the noise's variance.
    """

    theta: np.ndarray
    inverse: np.ndarray
    square: np.ndarray
    log_weight: np.ndarray
    dof: int
    least: np.ndarray

    @property
    def scale(self):
        """Variance of the noise, relative to that of each hypothesis, shape (h,)."""
        return np.maximum(self.least, self.square / self.dof)

    @property
    def covariance(self):
        """Covariance of the parameters, shape (h, k, k)."""
        return self.inverse * self.scale[:, None, None]

    @property
    def weight(self):
        """Share of each hypothesis, summing to 1."""
        return np.exp(self.log_weight - log_sums(self.log_weight))

    def averaged(self, weight):
        """Return the parameters, and their covariance, averaged over the noise by weights, (h,)."""
        values = weight @ self.theta
        off = self.theta - values
        spread = self.covariance + off[:, :, None] * off[:, None]
        return values, np.einsum("h,hpq->pq", weight, spread)


def log_sums(values):
    """Return ``log Σ exp`` of values over the last axis."""
    top = values.max(axis=-1)
    return top + np.log(np.exp(values - top[..., None]).sum(axis=-1))


def log_f_tail(statistic, q, dof):
    """Return the logarithm of the upper tail of F with q and `dof` degrees of freedom.

    ``I_x(dof/2, q/2)`` at ``x = dof/(dof + q F)``; below the smallest double its leading term
    ``x^a (1-x)^(b-1) / (a B(a, b))``.
    """
    a, b = dof / 2, q / 2
    x = dof / (dof + q * np.asarray(statistic, dtype=float))
    tail = betainc(a, b, x)
    if np.all(tail > 1e-280):
        return np.log(tail)
    safe = np.minimum(x, 1 - 1e-16)
    leading = a * np.log(safe) + (b - 1) * np.log1p(-safe) - np.log(a) - betaln(a, b)
    with np.errstate(divide="ignore"):
        return np.where(tail > 1e-280, np.log(tail), leading)


def averaged_log_p(without, fit, q, points=slice(None)):
    """Return the logarithm of the p-value of q parameters that one fit has beyond another.

    Under each hypothesis the F test is exact. What the noise is, the fit with the parameters
    tells: the p-values are averaged with its restricted likelihood as weight. So a pattern as
    smooth as slow noise that the data cannot exclude gains nothing from being smooth. Where data
    beside these tell how large the noise is, the fit without the parameters has half of the
    weight: with few residuals a pattern of many parameters takes up what is noise.

    Parameters
    ----------
    without, fit : Fit
        Of the same data; of m records at once with squares and weights of shape (h, m).
    q : int
        Number of parameters.
    points : index, optional
        The hypotheses to count; all by default.

    Returns
    -------
    float or ndarray, shape (m,)
    """
    least = fit.least if fit.square.ndim == 1 else fit.least[:, None]
    scale = np.maximum(least, fit.square / fit.dof)
    drop = np.maximum(without.square - fit.square, 0.0)
    tail = log_f_tail(drop / q / scale, q, fit.dof)[points]
    weight = _shares(fit.log_weight[points])
    if fit.least.any():
        weight = np.logaddexp(weight, _shares(without.log_weight[points])) - np.log(2)
    return log_sums((weight + tail).T)


def _shares(log_weight):
    """Return logarithms of weights, (h, …), that sum to 1 over the hypotheses."""
    return log_weight - log_sums(log_weight.T)


def log_p_values(pairs, points=slice(None)):
    """Return `averaged_log_p` of several pairs of fits, (without, with), as a list."""
    found = [0.0] * len(pairs)
    sizes = [fit.theta.shape[1] - without.theta.shape[1] for without, fit in pairs]
    for key in {(q, fit.dof) for q, (_, fit) in zip(sizes, pairs, strict=True)}:
        at = [k for k, q in enumerate(sizes) if (q, pairs[k][1].dof) == key]
        beside = [
            replace(
                fits[0],
                square=np.stack([f.square for f in fits], axis=1),
                log_weight=np.stack([f.log_weight for f in fits], axis=1),
            )
            for fits in zip(*(pairs[k] for k in at), strict=True)
        ]
        for k, value in zip(at, averaged_log_p(*beside, key[0], points).tolist(), strict=True):
            found[k] = value
    return found


def fisher(log_p):
    """Return the logarithm of Fisher's combined p-value of k independent ones.

    ``-2 Σ log p`` is χ² with 2k degrees of freedom, whose tail is ``exp(-L) Σ_{i<k} Lⁱ/i!`` at
    ``L = -Σ log p``.
    """
    total = -sum(log_p)
    term = series = total * 0 + 1.0
    for i in range(1, len(log_p)):
        term = term * total / i
        series = series + term
    return np.log(series) - total
