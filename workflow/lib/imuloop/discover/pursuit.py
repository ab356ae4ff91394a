"""Pursuit: which composed effects a residual holds, with the error over the whole space held."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from imuloop.core.precision import precision
from imuloop.diagnose.likeness import SHARE
from imuloop.diagnose.p_values import log_f_tail
from imuloop.diagnose.variance import likely_sizes, total

# effects after which a search stops
MOST = 4
# share of a column's square that the base model has to leave
LEFT = 1e-3
# by how much what is preferred may be worse, in -2 log likelihood: fewer columns; and a simpler
# form, by two standard deviations, as the order puts no price on a degree
ALIKE, SIMPLER = 2.0, 4.0
# to the likeliest reference temperature, and half a difference that gives the derivative, K
STEPS, HALF = 3, 0.5
# by how much the best has to be better than the best that is no imitator, in -2 log likelihood
MARGIN = 9.0


@dataclass(frozen=True)
class Rows:
    """Residuals of a record, and what their noise may be.

    Attributes
    ----------
    values : ndarray, shape (n,)
        Residuals with the sign of an effect: one of size one adds its column, SI.
    jacobian : ndarray, shape (n, p)
        Their derivative with respect to what every fit estimates.
    fixed : ndarray, shape (n, n)
        Covariance of the noise whose size is known.
    parts : tuple of Part
        Noise whose size the residuals tell: restricted maximum likelihood.
    piece : ndarray of int, shape (n,)
        The pose that each row begins at.
    widest : int
        The most parameters of a form, by all rows: a part that is held out takes no form away.
    """

    values: np.ndarray
    jacobian: np.ndarray
    fixed: np.ndarray
    parts: tuple
    piece: np.ndarray
    widest: int

    def seen(self, rows):
        """Return the same of some rows, which are an index."""
        at = np.ix_(rows, rows)
        parts = tuple(replace(p, covariance=p.covariance[at]) for p in self.parts)
        own = self.values[rows], self.jacobian[rows], self.fixed[at]
        return Rows(*own, parts, self.piece[rows], self.widest)


@dataclass(frozen=True)
class Whitened:
    """Rows in units of their noise, with what the base model and chosen effects take out of them.

    ``residual``, (n,), and of each candidate an orthonormal basis ``bases``, (n, q): q is its rank,
    zero where nothing of it is left. ``kept`` are the columns that the basis spans.
    """

    residual: np.ndarray
    known: np.ndarray  # (n, p): orthonormal, of what was taken out
    dof: int
    bases: tuple
    kept: tuple

    def scores(self):
        """Return what each candidate saves of the residual, -inf where nothing of it is left.

        Twins, which differ by a processor's rounding alone, have the same.
        """
        shown = np.array([b.shape[1] > 0 for b in self.bases])
        return np.round(np.where(shown, self.saved(self.residual[:, None])[:, 0], -np.inf), 6)

    def saved(self, residuals):
        """Return -2 log likelihood that each candidate saves, each parameter but one for log n.

        ``n log(χ²₀/χ²₁) - (q - 1) log n``, Schwarz (Ann. Stat. 6, 1978, 461), of each of m
        residuals, (K, m): zero where nothing of a candidate is left.
        """
        square, found = (residuals**2).sum(axis=0), np.zeros((len(self.bases), residuals.shape[1]))
        for k, basis in enumerate(self.bases):
            if q := basis.shape[1]:
                left = 1 - ((basis.T @ residuals) ** 2).sum(axis=0) / square
                gain = -self.dof * np.log(np.maximum(left, 1e-300))
                found[k] = gain - (q - 1) * np.log(self.dof)
        return found

    def drawn(self, piece, draws, rng):
        """Return residuals that chance gives, (n, draws) each, free of what was taken out.

        Normal draws; and the residual itself with the signs of whole poses changed.
        """
        n = len(self.residual)
        signs = rng.choice([-1.0, 1.0], size=(piece.max() + 1, draws))[piece]
        kinds = (rng.standard_normal((n, draws)), self.residual[:, None] * signs)
        return [each - self.known @ (self.known.T @ each) for each in kinds]

    def imitates(self, k, other):
        """Return whether one of two candidates takes `SHARE` of the narrower, or more.

        Or, of two of several columns each, of what the first takes of the residual.
        """
        one, two = self.bases[k], self.bases[other]
        both = one.T @ two
        if np.linalg.svd(both, compute_uv=False)[-1] ** 2 >= SHARE:
            return True
        taken = one.T @ self.residual
        several = min(both.shape) > 1
        return bool(several and np.sum((taken @ both) ** 2) >= SHARE * np.sum(taken**2))


def whitened(rows, space, chosen, about=None):
    """Return the Whitened rows beside chosen columns.

    The noise is the likeliest beside them, or beside the columns `about`.
    """
    columns = space.columns
    about = chosen if about is None else about
    design = [np.column_stack([rows.jacobian, columns[:, list(c)]]) for c in (chosen, about)]
    sizes = likely_sizes(rows.values, design[1], rows.fixed, rows.parts)
    _, root = precision(total(rows.fixed, rows.parts, sizes))
    scaled = design[0] / np.linalg.norm(design[0], axis=0)
    white = solve_triangular(root, np.column_stack([rows.values, scaled, columns]), lower=True)
    known = np.linalg.qr(white[:, 1 : 1 + scaled.shape[1]])[0]
    whole = np.linalg.norm(white, axis=0)
    white = white - known @ (known.T @ white)
    left, whole = white[:, 1 + scaled.shape[1] :], whole[1 + scaled.shape[1] :]
    size = np.linalg.norm(left, axis=0)
    shown = size**2 > LEFT * whole**2
    left = left / np.where(size > 0, size, 1.0)
    dof = len(white) - scaled.shape[1]
    bases, kept = [], []
    for own in space.candidates:
        own = [c for c in own if shown[c] and c not in chosen]
        q, independent = _basis(left[:, own])
        fits = 0 < q.shape[1] <= rows.widest
        bases.append(q if fits else q[:, :0])
        kept.append(tuple(own[k] for k in independent) if fits else ())
    return Whitened(white[:, 0], known, dof, tuple(bases), tuple(kept))


def _basis(columns):
    """Return an orthonormal basis, (n, q), of columns of norm one, and which of them it spans."""
    if columns.shape[1] < 2:
        return columns, list(range(columns.shape[1]))
    basis, kept = np.zeros((len(columns), 0)), []
    for k, column in enumerate(columns.T):
        rest = column - basis @ (basis.T @ column)
        rest = rest - basis @ (basis.T @ rest)
        if rest @ rest > LEFT:
            basis, kept = np.column_stack([basis, rest / np.linalg.norm(rest)]), [*kept, k]
    return basis, kept


def _simplest(white, space, scores):
    """Return the candidate of fewest columns, then of least complexity, as good as the best."""
    best, rank = int(np.argmax(scores)), np.array([b.shape[1] for b in white.bases])

    def alike(k, most, lead):
        near = np.flatnonzero((rank <= most) & (scores >= scores[k] - lead)).tolist()
        return [other for other in near if white.imitates(k, other)]

    fewest = min(alike(best, rank[best], ALIKE), key=lambda k: (rank[k], -scores[k], k))
    near = alike(fewest, rank[fewest], SIMPLER)
    near = [k for k in near if rank[k] == rank[fewest]]
    return min(near, key=lambda k: (space.complexity(k), -scores[k], k))


def log_p(white, residuals):
    """Return the logarithm of the smallest p-value of the candidates in each residual, (m,).

    And the candidate, (m,); residuals, (n, m), are free of what was taken out.
    """
    square = (residuals**2).sum(axis=0)
    least, best = np.zeros(len(square)), np.zeros(len(square), dtype=int)
    width = np.array([b.shape[1] for b in white.bases])
    for q in sorted(set(width.tolist()) - {0}):
        at = np.flatnonzero(width == q)
        stacked = np.hstack([white.bases[k] for k in at]).astype(np.float32)
        taken = (stacked.T @ residuals.astype(np.float32)) ** 2
        taken = taken.reshape(len(at), q, -1).sum(axis=1)
        first = taken.argmax(axis=0)
        share = np.minimum(taken[first, range(len(square))] / square, 1 - 1e-7)
        dof = white.dof - q
        own = log_f_tail(share / (1 - share) * dof / q, q, dof)
        best = np.where(own < least, at[first], best)
        least = np.minimum(own, least)
    return least, best


def chance(white, piece, draws, rng):
    """Return the larger of two probabilities that chance shows the space as much as the residual.

    By either kind of `Whitened.drawn`.
    """
    (shown,), _ = log_p(white, white.residual[:, None])
    kinds = white.drawn(piece, draws, rng)
    return float(max((1 + np.sum(log_p(white, k)[0] <= shown)) / (1 + draws) for k in kinds))


@dataclass(frozen=True)
class Pursued:
    """What a pursuit chose.

    Attributes
    ----------
    candidates : tuple of int
        Candidates, in the order in which they were chosen.
    columns : tuple of int
        Columns of all of them.
    chances : tuple of float
        Probability by chance of each, and of the one that was not chosen any more.
    margin : float
        By how much the first is better than the best that is no imitator; -2 log likelihood.
    imitators : tuple of int
        Candidates within `MARGIN` of the first, that take its place, best first: its columns with
        other time constants, too.
    warmer : float
        By how much the reference temperature is another than that of the space, K.
    """

    candidates: tuple = ()
    columns: tuple = ()
    chances: tuple = ()
    margin: float = 0.0
    imitators: tuple = ()
    warmer: float = 0.0

    @property
    def named(self):
        """Whether one candidate is enough, and none that is unlike it is nearly as good."""
        return len(self.candidates) == 1 and self.margin >= MARGIN


def pursue(rows, space, *, level, draws, seed, test=None):
    """Return what is Pursued in the residuals: one candidate after the other, all fitted again.

    The temperature that the first is taken from is fitted too, but for a `test` of columns as
    they are.

    Parameters
    ----------
    rows : Rows
        The residuals.
    space : Space
        What they may hold.
    level : float
        Probability by chance, over the whole space, below which a candidate is chosen.
    draws : int
        Draws of each kind.
    seed : int
        Of the draws.
    test : callable, optional
        Takes the candidates chosen, gives that probability of the best of the others, and it.
    """
    rng, chosen, columns, chances, warmer = np.random.default_rng(seed), [], (), [], 0.0
    while True:
        white = whitened(rows, space, columns)
        if len(chosen) == MOST or not any(b.shape[1] for b in white.bases):
            break
        if test:
            by_chance, best = test(chosen)
        else:
            by_chance, best = chance(white, rows.piece, draws, rng), int(np.argmax(white.scores()))
        chances.append(by_chance)
        if by_chance >= level:
            break
        if not chosen:
            # once more by the noise that is there beside it
            white = whitened(rows, space, (), about=white.kept[best])
            scores = white.scores()
            best, first = _simplest(white, space, scores), white
            if not test:
                warmer = likeliest_reference(rows, space, white.kept[best])
                space = space.about(warmer)
        chosen.append(best)
        columns = (*columns, *white.kept[best])
    if not chosen:
        return Pursued(chances=tuple(chances))
    order = [int(k) for k in np.argsort(-scores, kind="stable") if np.isfinite(scores[k])]
    alike = [k for k in order if space.kin(chosen[0], k) or first.imitates(chosen[0], k)]
    # nor is one that is unlike what holds an imitator, and more that makes it worse
    held = [(scores[k], set(space.candidates[k])) for k in alike]
    unlike = (k for k in order if k not in set(alike))
    margin = scores[chosen[0]] - max(
        (
            scores[k]
            for k in unlike
            if not any(score > scores[k] and own < set(space.candidates[k]) for score, own in held)
        ),
        default=-np.inf,
    )
    near = [k for k in alike if k != chosen[0] and scores[k] > scores[chosen[0]] - MARGIN]
    margin = float(min(margin, 1e6))
    return Pursued(tuple(chosen), columns, tuple(chances), margin, tuple(near), warmer)


def likeliest_reference(rows, space, columns):
    """Return by how much a higher reference temperature makes columns likelier, K.

    By steps of Gauss and Newton, beside the columns; zero where they have no temperature, or the
    rows do not tell.
    """
    at, kelvin = list(columns), 0.0
    if not space.warm.keys() & set(at):
        return kelvin
    design = np.column_stack([rows.jacobian, space.columns[:, at]])
    sizes = likely_sizes(rows.values, design, rows.fixed, rows.parts)
    _, root = precision(total(rows.fixed, rows.parts, sizes))

    def white(values):
        return solve_triangular(root, values, lower=True)

    for _ in range(STEPS):
        own, low, high = (white(space.about(kelvin + k).columns[:, at]) for k in (0.0, -HALF, HALF))
        known = np.column_stack([white(rows.jacobian), own])
        scale = np.linalg.norm(known, axis=0)
        theta = np.linalg.lstsq(known / scale, white(rows.values))[0] / scale
        change = (high - low) @ theta[-len(at) :]
        basis = np.linalg.qr(known / scale)[0]
        rest = change - basis @ (basis.T @ change)
        if rest @ rest <= LEFT * (change @ change):
            return 0.0
        kelvin += float(rest @ white(rows.values) / (rest @ rest))
    return kelvin


def fitted(rows, design):
    """Return parameters by generalised least squares, (k,), and their covariance.

    The noise is the likeliest beside them; the covariance grows with what is left.
    """
    sizes = likely_sizes(rows.values, design, rows.fixed, rows.parts)
    weight = precision(total(rows.fixed, rows.parts, sizes))[0]
    scale = np.linalg.norm(design, axis=0)
    scaled = design / scale
    inverse = np.linalg.inv(scaled.T @ weight @ scaled)
    theta = inverse @ (scaled.T @ (weight @ rows.values))
    left = rows.values - scaled @ theta
    size = max(1.0, left @ weight @ left / max(len(left) - len(theta), 1))
    return theta / scale, size * inverse / np.outer(scale, scale)
