"""Least squares on static records: levels, effects, and noise that the same data tell."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from imuloop.diagnose.static_noise import Fit, GridNoise, ratios

# more means than this are merged for the fit; held-out errors are those of all means
FITTED = 200
# columns before those of patterns
FIRST = 4
# a column of which levels and other columns leave less than this share is not seen
ABSORBED = 1e-6


@dataclass(frozen=True, eq=False)
class Pattern:
    """What one shape of an effect adds to the means.

    Attributes
    ----------
    effect : Effect
        The shape.
    records : tuple of StaticRecord
        The records.
    fitted : tuple of ndarray, shape (n, 3, p)
        Derivative with respect to the parameters in each record, at the windows of the fit.
    columns : tuple of tuple of int
        For each axis the model's columns of the parameters that it has.
    parameters : tuple of tuple of int
        Which parameters those are.
    """

    effect: object
    records: tuple
    fitted: tuple[np.ndarray, ...]
    columns: tuple[tuple[int, ...], ...]
    parameters: tuple[tuple[int, ...], ...]

    @property
    def name(self):
        """Name of the effect."""
        return self.effect.name

    @cached_property
    def means(self):
        """The derivative at all means of each record; most patterns are never asked for it."""
        return tuple(derivative(self.effect, r) for r in self.records)


def derivative(effect, record):
    """Return the derivative of an effect in a record, shape (n, 3, p)."""
    if hasattr(effect, "in_session"):
        return effect.in_session(record.session, record.windows)
    return effect.design(record.channels)


class StaticModel:
    """Means of all records of a sensor with what may explain them.

    Parameters
    ----------
    records : sequence of StaticRecord
        Each has a level of its own: the bias changes from one power-on to the next, and so does
        the attitude. Parts of a session have its name.
    noise : sequence of GridNoise, optional
        That of the same windows, where the other sensor's model has it already.
    """

    def __init__(self, records, noise=None):
        self.records = tuple(records)
        self.fitted = tuple(r.merged(FITTED) for r in records)
        span = max(np.ptp(r.windows) for r in self.fitted)
        length = min(np.median(r.length) for r in self.fitted)
        self.grid, self.prior = ratios(span, length)
        self.noise = noise or tuple(GridNoise.of(r.windows, self.grid) for r in self.fitted)
        # of each record: the level, the three axes, then what patterns enter, and products of all
        # these with the precision, (g, n)
        self.columns, self.weighted = [[] for _ in self.fitted], [[] for _ in self.fitted]
        for i, f in enumerate(self.fitted):
            self._append(i, [np.ones(len(f.values)), *(f.values - f.values.mean(axis=0)).T])
        self._known, self._patterns = {}, {}

    def _append(self, i, new):
        """Add columns to a record, with their products."""
        self.columns[i] += list(new)
        self.weighted[i] += list(np.moveaxis(self.noise[i].precision @ np.column_stack(new), 2, 0))

    def of(self, i, columns):
        """Return columns of a record, shape (n, k)."""
        stacked = [self.columns[i][c] for c in columns]
        return np.column_stack(stacked) if stacked else np.zeros((len(self.columns[i][0]), 0))

    def patterns(self, effects):
        """Return the patterns of effects, their columns entered into the model."""
        new = []
        for effect in dict.fromkeys(e for e in effects if e not in self._patterns):
            fitted = tuple(derivative(effect, r) for r in self.fitted)
            stacked = np.concatenate(fitted)
            columns, parameters = [], []
            for axis in range(3):
                used = np.flatnonzero(np.any(stacked[:, axis] != 0, axis=0))
                parameters.append(tuple(int(p) for p in used))
                columns.append(tuple(self._enter(stacked[:, axis, p], new) for p in used))
            self._patterns[effect] = Pattern(
                effect, self.records, fitted, tuple(columns), tuple(parameters)
            )
        if new:
            ends = np.cumsum([len(f.windows) for f in self.fitted])[:-1]
            for i, part in enumerate(np.split(np.array(new), ends, axis=1)):
                self._append(i, part)
        return tuple(self._patterns[effect] for effect in effects)

    def _enter(self, column, new):
        """Return the number of a column; one that is known is entered once."""
        key = column.tobytes()
        if key not in self._known:
            self._known[key] = FIRST + len(self._known)
            new.append(column / np.linalg.norm(column))
        return self._known[key]

    def point(self, fit):
        """Return the point of the grid of the likeliest noise without a walk."""
        return int(np.argmax(np.where(self.grid[:, 1] == 0, fit.log_weight, -np.inf)))

    def scale(self, pattern, axis):
        """Return the norms that the model's columns of a pattern are divided by, shape (p,)."""
        stacked = np.concatenate([f[:, axis] for f in pattern.fitted])
        return np.linalg.norm(stacked[:, list(pattern.parameters[axis])], axis=0)


@dataclass
class Sight:
    """The windows that a fit sees: all, those outside a block of time, or one session's.

    Attributes
    ----------
    model : StaticModel
        Model.
    held : tuple of ndarray of int
        The windows of the fit in each record that are not seen; None for a record that is not
        seen at all.
    """

    model: StaticModel
    held: tuple
    _place: dict = field(default_factory=dict)
    _levels: dict = field(default_factory=dict)
    _ahead: dict = field(default_factory=dict)
    _gram: np.ndarray | None = None
    _precisions: dict = field(default_factory=dict)
    _fits: dict = field(default_factory=dict)

    @cached_property
    def _seen(self):
        """The records that are seen, each with what its held windows know of each other."""
        return {
            i: np.linalg.inv(self.model.noise[i].precision[:, held][:, :, held])
            for i, held in enumerate(self.held)
            if held is not None
        }

    @cached_property
    def windows(self):
        """Number of windows less levels."""
        return sum(len(self.model.columns[i][0]) - len(self.held[i]) - 1 for i in self._seen)

    @cached_property
    def log_det(self):
        """``log det`` of the covariance and of the levels' information, shape (g,)."""
        self.gram(())
        return sum(
            self.model.noise[i].log_det + np.log(self._levels[i][:, 0]) - np.linalg.slogdet(c)[1]
            for i, c in self._seen.items()
        )

    def gram(self, columns):
        """Return products of columns, levels taken out, summed over the records, shape (g, k, k).

        Seen windows alone have the precision ``P_ss - P_sh P_hh⁻¹ P_hs``, so the products of the
        columns Z are ``Zᵀ P Z - (P Z)_hᵀ P_hh⁻¹ (P Z)_h``. The level is taken out likewise.

        Parameters
        ----------
        columns : sequence of int
            Columns of the model.
        """
        new = [c for c in dict.fromkeys((0, *columns)) if c not in self._place]
        if new:
            self._enter(new)
        place = np.array([self._place[c] for c in columns], dtype=int)
        return self._gram[:, place[:, None], place]

    def _enter(self, new):
        """Add the products of columns that nobody asked for before."""
        first = len(self._place)
        self._place |= {c: first + k for k, c in enumerate(new)}
        known, total = list(self._place), len(self._place)
        if self._gram is None or self._gram.shape[1] < total:
            points, old, size = len(self.model.grid), self._gram, total + total // 3
            self._gram = np.zeros((points, size, size))
            if old is not None:
                self._gram[:, :first, :first] = old[:, :first, :first]
        added = 0.0
        for i, covariance in self._seen.items():
            held, weighted = self.held[i], self.model.weighted[i]
            z = self.model.of(i, known)
            # (g, new, known)
            more = np.stack([weighted[c] for c in new], axis=1)
            cross = more @ z
            if len(held):
                ahead = more[:, :, held]
                if first:
                    ahead = np.concatenate([self._ahead[i], ahead], axis=1)
                self._ahead[i] = ahead
                cross -= ahead[:, first:] @ covariance @ np.swapaxes(ahead, 1, 2)
            level = cross[:, :, 0]
            if first:
                level = np.concatenate([self._levels[i], level], axis=1)
            self._levels[i] = level
            added += cross - level[:, first:, None] * level[:, None] / level[:, :1, None]
        self._gram[:, first:total, :total] = added
        self._gram[:, :total, first:total] = np.swapaxes(added, 1, 2)

    def release(self):
        """Let go of all products; what is asked for again is made again.

        Those of a hundred columns at every point of the grid are 40 MB for each part of the data.
        """
        self._gram = None
        for kept in (self._place, self._levels, self._ahead, self._precisions, self._fits):
            kept.clear()

    def precision(self, i, point):
        """Return the precision of the windows that are seen of a record, its level taken out.

        Parameters
        ----------
        i : int
            Record.
        point : int
            Point of the grid.
        """
        if (i, point) not in self._precisions:
            whole, held = self.model.noise[i].precision[point], self.held[i]
            seen = np.delete(np.arange(len(whole)), held)
            cross = whole[np.ix_(held, seen)]
            found = whole[np.ix_(seen, seen)] - cross.T @ self._seen[i][point] @ cross
            level = found.sum(axis=1)
            self._precisions[i, point] = found - np.outer(level, level) / level.sum()
        return self._precisions[i, point]

    def fit(self, columns, axis):
        """Return the Fit of an axis to columns of the model; None where they are not independent.

        Parameters
        ----------
        columns : tuple of int
            Columns.
        axis : int
            Axis.
        """
        if columns not in self._fits:
            self._fits[columns] = self._fit(list(columns))
        return self._fits[columns][axis]

    def _fit(self, columns):
        """Return the fits of the three axes."""
        dof, nothing = self.windows - len(columns), (None, None, None)
        if dof < 2:
            return nothing
        gram = self.gram([1, 2, 3, *columns])
        # axes before points of the grid
        square = np.einsum("gaa->ag", gram[:, :3, :3])
        product, own = gram[:, 3:, :3].transpose(2, 0, 1), gram[:, 3:, 3:]
        theta, inverse, log_det = product, own, self.log_det
        if columns:
            size = np.sqrt(np.maximum(np.einsum("gpp->gp", own), 0.0))
            # the columns have norm 1 before the levels are taken out, and noise of N = 1
            if not np.all(size[0] ** 2 > ABSORBED * self.model.fitted[0].length.min()):
                return nothing
            own = own / size[:, :, None] / size[:, None, :]
            if np.linalg.eigvalsh(own[0])[0] < ABSORBED:
                return nothing
            inverse = np.linalg.inv(own)
            product = product / size
            theta = (inverse @ product[..., None])[..., 0]
            whole, square = square, square - (theta * product).sum(axis=2)
            square = np.maximum(square, 1e-12 * whole)
            log_det = log_det + np.linalg.slogdet(own)[1] + 2 * np.log(size).sum(axis=1)
            theta = theta / size
            inverse = inverse / size[:, :, None] / size[:, None, :]
        log_weight = self.model.prior - (dof * np.log(square) + log_det) / 2
        return tuple(
            Fit(values, inverse, *each, dof)
            for values, *each in zip(theta, square, log_weight, strict=True)
        )


def everything(model):
    """Return the sight of all windows."""
    return Sight(model, tuple(np.zeros(0, dtype=int) for _ in model.fitted))


def one_session(model, session):
    """Return the sight of the windows of one session alone."""
    nothing = np.zeros(0, dtype=int)
    return Sight(model, tuple(nothing if r.session == session else None for r in model.fitted))


def block_of(record, blocks):
    """Return in which of equal blocks of time at rest each window of a record lies, shape (n,)."""
    middle = np.cumsum(record.length) - record.length / 2
    return np.minimum((middle / record.length.sum() * blocks).astype(int), blocks - 1)


def folds(model, blocks):
    """Return in which fold each window of the fit is held out, one array a record.

    One block of time of every record, but not the same one: what happens at the start of each is
    predicted from the starts of the others.
    """
    shift = [i * blocks // len(model.fitted) for i in range(len(model.fitted))]
    return [(block_of(r, blocks) + s) % blocks for r, s in zip(model.fitted, shift, strict=True)]


def fold_of(record, model, blocks):
    """Return in which fold other windows of a session are held out, shape (n,), -1 in none.

    A fold is what its windows of the fit cover: what they saw no other window may share.
    """
    found = np.full(len(record.windows), -1)
    for own, fold in zip(model.fitted, folds(model, blocks), strict=True):
        for k in np.unique(fold) if own.session == record.session else ():
            covered = own.windows[fold == k]
            start, end = covered[0, 0], covered[-1, 1]
            found[(record.windows[:, 0] >= start) & (record.windows[:, 1] <= end)] = k
    return found


def without(model, out, blocks):
    """Return the sight that lacks some folds: one block of time each in every record."""
    held = [np.flatnonzero(np.isin(f, list(out))) for f in folds(model, blocks)]
    return Sight(model, tuple(held))
