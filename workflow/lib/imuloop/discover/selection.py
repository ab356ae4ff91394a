"""Which candidates of a space residuals hold, with the error over the whole space held."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from imuloop.calibrate.noise_components import likely_sizes, total
from imuloop.diagnose.likeness import SHARE
from imuloop.diagnose.p_values import log_f_tail

# probability, over the whole space, that chance gives a composed effect
LEVEL = 0.01
# candidates after which a search stops
MOST = 4
# share of a column's square that the base model has to leave
LEAST_SHARE = 1e-3
# rows for each parameter of a candidate
ROWS = 4
# by how much what is preferred may be worse, in -2 log likelihood: fewer columns; and a simpler
# form, by two standard deviations, as the order puts no price on a degree
ALIKE, SIMPLER = 2.0, 4.0
# by how much the best has to be better than the best that is no imitator, in -2 log likelihood
MARGIN = 9.0
# to the likeliest reference temperature, and half a difference that gives the derivative, K
STEPS, HALF = 3, 0.5


@dataclass(frozen=True)
class Rows:
    """Residuals of a record, and what their noise may be."""

    values: np.ndarray  # (n,): an effect of size one adds its column to them, SI
    jacobian: np.ndarray  # (n, p): derivative with respect to what every fit estimates
    fixed: np.ndarray  # (n, n): covariance of the noise whose size is known
    parts: tuple  # Part each: noise whose size the residuals tell
    pose: np.ndarray  # (n,): the pose that each row begins at
    count: int  # of all rows of the record, of which these may be some

    def subset(self, rows):
        """Return some rows, given by an index."""
        at = np.ix_(rows, rows)
        parts = tuple(replace(p, covariance=p.covariance[at]) for p in self.parts)
        own = self.values[rows], self.jacobian[rows], self.fixed[at]
        return Rows(*own, parts, self.pose[rows], self.count)

    def design(self, columns):
        """Return the derivative with respect to the base model and to the sizes of columns."""
        return np.column_stack([self.jacobian, columns])

    def whitener(self, columns):
        """Return a function that whitens rows by the noise that is likeliest beside columns."""
        sizes = likely_sizes(self.values, self.design(columns), self.fixed, self.parts)
        root = cholesky(total(self.fixed, self.parts, sizes)).T
        return partial(solve_triangular, root, lower=True)

    def fit(self, columns):
        """Return parameters by generalised least squares, those of columns last, and covariance."""
        white = self.whitener(columns)
        values, (basis, triangle) = white(self.values), np.linalg.qr(white(self.design(columns)))
        theta = solve_triangular(triangle, basis.T @ values)
        root = solve_triangular(triangle, np.eye(len(theta)))
        chi2 = np.sum((values - basis @ (basis.T @ values)) ** 2)
        # the covariance grows with what is left
        inflation = max(1.0, chi2 / max(len(values) - len(theta), 1))
        return theta, inflation * root @ root.T


@dataclass(frozen=True)
class Selection:
    """The candidates that a search selects."""

    chance: float = 1.0  # probability of the first by chance, or of the best if none is selected
    candidates: tuple = ()  # in the order in which they were selected
    columns: tuple = ()  # of all of them
    margin: float = 0.0  # by which the first leads all that is no imitator; -2 log likelihood
    imitators: tuple = ()  # within MARGIN of the first: like it, or of other time constants
    warmer: float = 0.0  # how much higher the reference temperature is than that of the space, K
    # by how much the first lowers the square of the residual, in what is left per degree of freedom
    gain: float = 0.0

    @property
    def single(self):
        """Whether one candidate is enough, and none that is unlike it is nearly as good."""
        return len(self.candidates) == 1 and self.margin >= MARGIN

    @property
    def clear(self):
        """Whether of a pattern that it takes `SHARE` of the rest would be as clear as `MARGIN`."""
        return (1 - SHARE) * self.gain >= MARGIN

    def seen_by(self, space):
        """Return the effect, and what it adds, (N, q), in a space of some rows or others."""
        space = space.warmer(self.warmer)
        return space.effect(self.columns), space.columns[:, list(self.columns)]


def select(rows, space, *, draws, seed, level=LEVEL, test=None):
    """Return the Selection of Rows in a Space: one candidate after the other, all fitted again.

    Selected is what chance shows less often than `level`, over the whole space. Chance is drawn
    `draws` times in each of two ways, by a seed, and the reference temperature is fitted. Or `test`
    takes the candidates selected, gives that probability of the best of the others, and it.
    """
    rng, selected, columns, first_chance = np.random.default_rng(seed), [], (), 1.0
    margin, imitators, warmer, gain = 0.0, (), 0.0, 0.0
    while len(selected) < MOST:
        white = whitened(rows, space.columns, space.candidates, columns)
        if test:
            by_chance, best = test(selected)
        else:
            by_chance, best = chance(white, rows.pose, draws, rng), int(np.argmax(white.scores()))
        first_chance = first_chance if selected else by_chance
        if by_chance >= level:
            break
        if not selected:
            # once more by the noise that is there beside it
            white = whitened(rows, space.columns, space.candidates, (), white.columns[best])
            best, margin, imitators = _simplest(white, space)
            gain = white.gain(best)
            warmer = 0.0 if test else likeliest_reference(rows, space, white.columns[best])
            space = space.warmer(warmer)
        selected.append(best)
        columns += white.columns[best]
    return Selection(first_chance, tuple(selected), columns, margin, imitators, warmer, gain)


@dataclass(frozen=True)
class Whitened:
    """Residuals and candidates in units of the noise, without what a fit takes out of both."""

    residual: np.ndarray  # (n,)
    removed: np.ndarray  # (n, p): orthonormal basis of what was taken out
    dof: int
    bases: tuple  # (n, q) each: orthonormal, of a candidate; q is zero where nothing of it is left
    columns: tuple  # of the space, those that each basis spans

    def scores(self):
        """Return the -2 log likelihood that each candidate saves, each parameter but one for log n.

        ``n log(χ²₀/χ²₁) - (q - 1) log n``, Schwarz (Ann. Stat. 6, 1978, 461); -inf where nothing of
        it is left. Twins, which differ by a processor's rounding alone, have the same.
        """
        square, found = self.residual @ self.residual, np.full(len(self.bases), -np.inf)
        for k, basis in enumerate(self.bases):
            if q := basis.shape[1]:
                rest = max(1 - np.sum((basis.T @ self.residual) ** 2) / square, 1e-300)
                found[k] = -self.dof * np.log(rest) - (q - 1) * np.log(self.dof)
        return np.round(found, 6)

    def gain(self, k):
        """Return by how much a candidate lowers χ², over what it leaves per degree of freedom."""
        taken = np.sum((self.bases[k].T @ self.residual) ** 2)
        return float(self.dof * taken / max(self.residual @ self.residual - taken, 1e-300))

    def imitates(self, k, other):
        """Return whether one of two candidates takes `SHARE` of the narrower, or more.

        Or, of two of several columns each, of what the first takes of the residual.
        """
        both, taken = self.bases[k].T @ self.bases[other], self.bases[k].T @ self.residual
        if min(both.shape) > 1 and np.sum((taken @ both) ** 2) >= SHARE * np.sum(taken**2):
            return True
        return bool(np.linalg.svd(both, compute_uv=False)[-1] ** 2 >= SHARE)


def whitened(rows, columns, candidates, fitted, noise_beside=None):
    """Return Whitened rows beside fitted columns, by the noise likeliest beside these or others."""
    beside = fitted if noise_beside is None else noise_beside
    white = rows.whitener(columns[:, list(beside)])
    design = rows.design(columns[:, list(fitted)])
    removed = np.linalg.qr(white(design))[0]
    whole = white(columns)
    residual, rest = (v - removed @ (removed.T @ v) for v in (white(rows.values), whole))
    size = np.linalg.norm(rest, axis=0)
    shown = size**2 > LEAST_SHARE * (whole**2).sum(axis=0)
    rest = rest / np.where(size > 0, size, 1.0)
    most = max((rows.count - rows.jacobian.shape[1]) // ROWS, 1)
    bases, kept = [], []
    for candidate in candidates:
        basis, spanned = _basis(rest, [c for c in candidate if shown[c] and c not in fitted])
        fits = len(spanned) <= most
        bases.append(basis if fits else basis[:, :0])
        kept.append(spanned if fits else ())
    return Whitened(residual, removed, len(residual) - design.shape[1], tuple(bases), tuple(kept))


def _basis(columns, chosen):
    """Return an orthonormal basis, (n, q), of chosen columns of norm one, and those it spans."""
    basis, spanned = columns[:, chosen[:1]], tuple(chosen[:1])
    for c in chosen[1:]:
        rest = columns[:, c] - basis @ (basis.T @ columns[:, c])
        rest = rest - basis @ (basis.T @ rest)
        if rest @ rest > LEAST_SHARE:
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
            spanned += (c,)
    return basis, spanned


def log_p(white, residuals):
    """Return the logarithm of the smallest p-value of all candidates in m residuals, (n, m)."""
    square, least = (residuals**2).sum(axis=0), np.zeros(residuals.shape[1])
    single = residuals.astype(np.float32)
    for q in sorted({b.shape[1] for b in white.bases} - {0}):
        bases = [b for b in white.bases if b.shape[1] == q]
        taken = (np.hstack(bases).astype(np.float32).T @ single) ** 2
        most = taken.reshape(len(bases), q, -1).sum(axis=1).max(axis=0)
        share, dof = np.minimum(most / square, 1 - 1e-7), white.dof - q
        least = np.minimum(least, log_f_tail(share / (1 - share) * dof / q, q, dof))
    return least


def chance(white, pose, draws, rng):
    """Return the probability that chance shows the space as much as the residual.

    The larger of two: by normal draws, and by the residual with the signs of whole poses changed.
    """
    signs = rng.choice([-1.0, 1.0], size=(pose.max() + 1, draws))[pose]
    found, (least,) = [], log_p(white, white.residual[:, None])
    for drawn in (rng.standard_normal((len(pose), draws)), white.residual[:, None] * signs):
        drawn = drawn - white.removed @ (white.removed.T @ drawn)
        found.append((1 + np.sum(log_p(white, drawn) <= least)) / (1 + draws))
    return float(max(found))


def _simplest(white, space):
    """Return the candidate of fewest columns, then of least complexity, as good as the best.

    With its margin and imitators, as of `Selection`.
    """
    scores, width = white.scores(), np.array([b.shape[1] for b in white.bases])

    def near(k, lead):
        """Return imitators that have no more columns and are not worse by more than a lead."""
        others = np.flatnonzero((width <= width[k]) & (scores >= scores[k] - lead)).tolist()
        return [other for other in others if white.imitates(k, other)]

    best = near(int(np.argmax(scores)), ALIKE)
    fewest = min(best, key=lambda k: (width[k], -scores[k], k))
    equal = [k for k in near(fewest, SIMPLER) if width[k] == width[fewest]]
    of = {k: space.effect(space.candidates[k]) for k in equal}
    first = min(equal, key=lambda k: (of[k].complexity, -scores[k], k))
    order = [k for k in np.argsort(-scores, kind="stable").tolist() if np.isfinite(scores[k])]
    kin, columns = space.kin(first), [set(own) for own in space.candidates]
    alike = [k for k in order if k in kin or white.imitates(first, k)]

    def padded(k):
        """Return whether a candidate holds an imitator, and more that makes it worse."""
        return any(scores[a] > scores[k] and columns[a] < columns[k] for a in alike)

    rival = next((scores[k] for k in order if k not in alike and not padded(k)), -np.inf)
    imitators = (k for k in alike if k != first and scores[k] > scores[first] - MARGIN)
    return first, float(min(scores[first] - rival, 1e6)), tuple(imitators)


def likeliest_reference(rows, space, columns):
    """Return by how much a higher reference temperature makes columns likelier, K.

    By steps of Gauss and Newton; zero where columns have no temperature, or rows do not tell.
    """
    at, kelvin = list(columns), 0.0
    if not space.lower_powers.keys() & set(at):
        return kelvin
    white = rows.whitener(space.columns[:, at])
    values = white(rows.values)
    for _ in range(STEPS):
        own, low, high = (space.warmer(kelvin + k).columns[:, at] for k in (0.0, -HALF, HALF))
        basis, triangle = np.linalg.qr(white(rows.design(own)))
        theta = solve_triangular(triangle, basis.T @ values)
        change = white(high - low) @ theta[-len(at) :]
        rest = change - basis @ (basis.T @ change)
        if rest @ rest <= LEAST_SHARE * (change @ change):
            return 0.0
        kelvin += float(rest @ values / (rest @ rest))
    return kelvin
