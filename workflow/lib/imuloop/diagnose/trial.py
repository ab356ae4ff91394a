"""Trials: what each candidate effect would take off the residual, all parameters refitted."""

from collections import Counter
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import betaincinv, ncfdtr

from imuloop.core.effect import Effect
from imuloop.core.root import root
from imuloop.diagnose.static_noise import log_f_tail

# a column of which the base model takes all but this share is not seen in the residual
ABSORBED = 1e-3


@dataclass(frozen=True)
class Linear:
    """Residuals of a recording about a solution, linear in base parameters and candidates.

    Attributes
    ----------
    values : ndarray, shape (N,)
        Residuals at the solution, kind after kind.
    jacobian : ndarray, shape (N, p)
        Derivative with respect to the solution's parameters.
    shapes : tuple of Effect
        Candidates in each of their shapes.
    columns : tuple of ndarray, shape (N, q)
        Derivative with respect to the parameters of each shape.
    kinds : dict of str to ndarray, shape (n, 2)
        Each kind of residual: the poses where each starts and ends. N is the sum of ``n k`` over
        the kinds, with k components each.
    components : dict of str to int
        k of each kind.
    """

    values: np.ndarray
    jacobian: np.ndarray
    shapes: tuple[Effect, ...]
    columns: tuple[np.ndarray, ...]
    kinds: dict[str, np.ndarray]
    components: dict[str, int]

    def rows(self, chosen):
        """Return the rows, shape (N,), of the residuals that `chosen` takes by their poses."""
        return np.concatenate(
            [np.repeat(chosen(poses), self.components[kind]) for kind, poses in self.kinds.items()]
        )

    def rows_of(self, kind):
        """Return the rows, shape (N,), of one kind of residual."""
        return self.rows(lambda poses: np.full(len(poses), poses is self.kinds[kind]))

    def split(self, values):
        """Return values of all rows as one array, shape (n, k), for each kind."""
        sizes = [len(poses) * self.components[kind] for kind, poses in self.kinds.items()]
        pieces = np.split(values, np.cumsum(sizes)[:-1])
        return {
            kind: piece.reshape(-1, self.components[kind])
            for kind, piece in zip(self.kinds, pieces, strict=True)
        }


@dataclass(frozen=True)
class White:
    """A `Linear` on the rows of a fit, whitened by their covariance, split from the parameters.

    Attributes
    ----------
    root : ndarray, shape (n, n)
        Lower triangular root of the covariance.
    q, r : ndarray, shape (n, p) and (p, p)
        Orthogonal and triangular factor of the derivative.
    residual : ndarray, shape (n,)
        Residuals.
    columns : tuple of ndarray, shape (n, k)
        Derivative with respect to each shape's parameters.
    """

    root: np.ndarray
    q: np.ndarray
    r: np.ndarray
    residual: np.ndarray
    columns: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, linear, seen, covariance):
        """Return the whitened rows `seen`, whose covariance is given."""
        root = cholesky(covariance, lower=True)
        stack = np.column_stack([linear.values, linear.jacobian, *linear.columns])[seen]
        white = solve_triangular(root, stack, lower=True)
        p = linear.jacobian.shape[1]
        q, r = np.linalg.qr(white[:, 1 : p + 1])
        ends = np.cumsum([p + 1] + [c.shape[1] for c in linear.columns])
        columns = tuple(white[:, i:j] for i, j in pairwise(ends))
        return cls(root, q, r, white[:, 0], columns)

    def whiten(self, values):
        """Return values of the rows, shape (n, …), whitened."""
        return solve_triangular(self.root, values, lower=True)

    def left(self, values):
        """Return what the parameters leave of whitened values, shape (n, …)."""
        return values - self.q @ (self.q.T @ values)

    def only(self, column):
        """Return the same with one shape alone."""
        return replace(self, columns=(self.columns[column],))

    @cached_property
    def rest(self):
        """Residuals that the parameters leave, shape (n,)."""
        return self.left(self.residual)

    @cached_property
    def spaces(self):
        """The Space of each shape."""
        found, widths = [None] * len(self.columns), np.array([c.shape[1] for c in self.columns])
        for width in np.unique(widths):
            # shapes of as many parameters at once
            at = np.flatnonzero(widths == width)
            raw = np.stack([self.columns[k] for k in at], axis=1)
            size = np.linalg.norm(raw, axis=0)
            left = self.left(raw.reshape(len(raw), -1)).reshape(raw.shape)
            q, r = np.linalg.qr((left / np.where(size > 0, size, 1.0)).swapaxes(0, 1))
            part = (q.swapaxes(1, 2) @ self.rest[:, None])[:, :, 0]
            for i, k in enumerate(at):
                found[k] = Space(q[i], r[i], size[i], part[i])
        return found

    @cached_property
    def seen(self):
        """Whether the parameters leave more than `ABSORBED` of each shape, whatever its size."""
        found = np.zeros(len(self.columns), dtype=bool)
        for shape in {space.r.shape for space in self.spaces}:
            at = [k for k, space in enumerate(self.spaces) if space.r.shape == shape]
            r, size = (np.stack([getattr(self.spaces[k], n) for k in at]) for n in ("r", "size"))
            least = np.linalg.svd(r, compute_uv=False)[:, -1]
            # fewer rows than columns show no shape whole
            found[at] = size.all(axis=1) & (least >= ABSORBED) & (shape[0] == shape[1])
        return found


@dataclass(frozen=True)
class Space:
    """What the parameters leave of a shape's columns, and the residual's part in it.

    Attributes
    ----------
    q, r : ndarray, shape (n, k) and (k, k)
        Orthogonal and triangular factor of the columns over their `size`.
    size : ndarray, shape (k,)
        Norm of each column before the parameters take their share.
    part : ndarray, shape (k,)
        Product of q with the residual: χ² falls by its square.
    """

    q: np.ndarray
    r: np.ndarray
    size: np.ndarray
    part: np.ndarray

    @property
    def drop(self):
        """By how much χ² falls."""
        return float(self.part @ self.part)


@dataclass(frozen=True)
class Trial:
    """One effect, in its best shape, tested against the model without it.

    Attributes
    ----------
    effect : Effect
        The effect in that shape.
    log_p : float
        Logarithm of the p-value of the F test, times the number of shapes tried.
    drop : float
        By how much χ² falls.
    values, std : ndarray, shape (q,)
        The effect's parameters and their standard errors.
    information : ndarray, shape (q, q)
        Inverse of their covariance.
    step : ndarray, shape (p,)
        Change of the other parameters.
    pattern : ndarray, shape (n, q)
        Whitened columns that the other parameters leave.
    column : int
        Which shape of the linear model it is.
    dof : int
        Residuals less all parameters.
    """

    effect: Effect
    log_p: float
    drop: float
    values: np.ndarray
    std: np.ndarray
    information: np.ndarray
    step: np.ndarray
    pattern: np.ndarray
    column: int
    dof: int

    @property
    def p_value(self):
        """Probability of such a fall of χ² without the effect, at most 1."""
        return float(min(1.0, np.exp(self.log_p)))

    @property
    def effects(self):
        """The effect alone, as a Pair has two."""
        return (self.effect,)

    @property
    def columns(self):
        """Its shape of the linear model alone."""
        return (self.column,)

    @property
    def impossible(self):
        """Whether a parameter is larger than physics allows, by more than its standard error."""
        return bool(np.any(np.abs(self.values) - self.std > self.effect.limit))


def log_p_value(drop, chi2_after, q, dof, least=1.0):
    """Return the logarithm of the p-value of ``F = (drop / q) / max(1, χ²/ν)``.

    The noise model sets the scale; where the residual exceeds it even with the effect, the
    residual does. Without a noise model to go by, `least` is 0.
    """
    return log_f_tail(drop / q / np.maximum(least, chi2_after / dof), q, dof)[()]


def excess(linear, seen, covariance):
    """Return the variance that all residuals of a kind have beyond the noise model's, (n,).

    What is missing in a model need not follow the noise: the residual of a long rest is no smaller
    than that of a short one. The variance s that ``rᵀ (Σ + s I)⁻¹ r`` needs to be its degrees of
    freedom, for each kind of residual for itself; 0 where it is at the floor.

    References
    ----------
    DerSimonian & Laird, Controlled Clinical Trials 7 (1986) 177: variance between studies.
    """
    found = np.zeros(len(covariance))
    share = 1 - linear.jacobian.shape[1] / len(covariance)
    for kind in linear.kinds:
        at = linear.rows_of(kind)[seen]
        if not at.any():
            continue
        found[at] = surplus(covariance[np.ix_(at, at)], linear.values[seen][at], at.sum() * share)
    return found


def surplus(covariance, values, dof):
    """Return the s at which ``χ² = rᵀ (Σ + s I)⁻¹ r`` is `dof`, 0 where it never exceeds it.

    Newton's steps in 1/χ², which is nearly straight in s, from the left.
    """
    s = 0.0
    while True:
        solved = np.linalg.solve(covariance + s * np.eye(len(values)), values)
        chi2 = values @ solved
        if chi2 <= dof * (1 + 1e-12):
            return s
        s += (chi2 / dof - 1) * chi2 / (solved @ solved)


def try_shapes(white, shapes, doubts=()):
    """Return the best trial of each class among the shapes, or why there is none.

    Every parameter of the model is refitted together with the effect's: the step of generalised
    least squares from the solution, exact as far as the residual is linear in them.

    Parameters
    ----------
    white : White
        Residuals weighted by the noise model.
    shapes : sequence of Effect
        The shapes of its columns.
    doubts : sequence of White
        The same weighted otherwise; an effect has to pass with these weights too, of the size that
        the residual has. With their `excess`, no few residuals of small noise can carry it alone;
        with slow noise at its limits, no walk can pass for what drifts.

    Returns
    -------
    dict of type to Trial
        One entry for each class that the data can show.
    dict of type to str
        Why the others cannot be shown.
    """
    total, n = white.rest @ white.rest, len(white.rest)
    count = Counter(map(type, shapes))
    widths = np.array([len(space.size) for space in white.spaces], dtype=int)
    dof = n - white.q.shape[1] - widths
    tried, reasons = [], {}
    for column, shape in enumerate(shapes):
        if dof[column] < 1:
            reasons[type(shape)] = (
                f"{n} residuals do not determine {widths[column]} more parameters"
            )
        elif not white.seen[column]:
            reasons[type(shape)] = "what it adds in these data is taken up by the base model"
        else:
            tried.append(column)
    log_ps = np.max(
        [_log_p(w, tried, widths, dof, float(w is white)) for w in (white, *doubts)], axis=0
    )
    best = {}
    for column, log_p in zip(tried, log_ps.tolist(), strict=True):
        cls, drop = type(shapes[column]), white.spaces[column].drop
        log_p += np.log(count[cls])
        if cls not in best or (log_p, -drop) < best[cls][:2]:
            best[cls] = log_p, -drop, column
    trials = {
        cls: _trial(white, shapes[column], total, log_p, column, int(dof[column]))
        for cls, (log_p, _, column) in best.items()
    }
    return trials, {cls: why for cls, why in reasons.items() if cls not in best}


def _trial(white, shape, total, log_p, column, dof):
    """Return the Trial of a shape."""
    space = white.spaces[column]
    inverse = np.linalg.inv(space.r)
    values = -inverse @ space.part / space.size
    scale = max(1.0, (total - space.drop) / dof)
    wide = space.r * space.size
    std = np.sqrt(scale * (inverse**2).sum(axis=1)) / space.size
    step = -solve_triangular(white.r, white.q.T @ (white.residual + white.columns[column] @ values))
    information, pattern = wide.T @ wide / scale, space.q @ wide
    return Trial(shape, log_p, space.drop, values, std, information, step, pattern, column, dof)


def _log_p(white, columns, widths, dof, least):
    """Return the logarithms of the p-values of some shapes; arguments as of `log_p_value`."""
    drop = np.array([white.spaces[column].drop for column in columns])
    left = white.rest @ white.rest - drop
    return log_p_value(drop, left, widths[columns], dof[columns], least)


def detection_limit(trial, shapes, settings, tests):
    """Return the smallest size of each parameter that these data would have shown.

    The noncentrality λ at which an F test of q parameters finds the effect with the wanted power
    gives a size of ``sqrt(λ / (C⁻¹)_kk)`` for a parameter that alone is not zero.

    Parameters
    ----------
    trial : Trial
        The candidate's trial.
    shapes : int
        Number of shapes that were tried.
    settings : DiagnoseSettings
        Significance and power.
    tests : int
        Number of tests that the significance is shared by.
    """
    significance = settings.significance / tests / shapes
    noncentrality = noncentrality_found(len(trial.values), trial.dof, significance, settings.power)
    limits = np.sqrt(noncentrality / np.diag(trial.information))
    return dict(zip(trial.effect.parameters, limits.tolist(), strict=True))


@cache
def noncentrality_found(q, dof, significance, power):
    """Return the noncentrality at which an F test finds an effect with the wanted power."""
    x = betaincinv(dof / 2, q / 2, significance)
    threshold = dof * (1 - x) / (q * x)

    def shortfall(noncentrality):
        return ncfdtr(q, dof, noncentrality, threshold) - (1 - power)

    # far beyond the root the distribution is not computed reliably
    above = 1.0
    while shortfall(above) > 0:
        above *= 2
    return root(shortfall, 0.0, above)[0]
