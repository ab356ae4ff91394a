"""Least squares on static records: levels, effects, and noise that the same data tell."""

from dataclasses import dataclass, field

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
    fitted, means : tuple of ndarray, shape (n, 3, p)
        Derivative with respect to the parameters in each record, at the windows of the fit and at
        all means.
    columns : tuple of tuple of int
        For each axis the model's columns of the parameters that it has.
    parameters : tuple of tuple of int
        Which parameters those are.
    """

    effect: object
    fitted: tuple[np.ndarray, ...]
    means: tuple[np.ndarray, ...]
    columns: tuple[tuple[int, ...], ...]
    parameters: tuple[tuple[int, ...], ...]

    @property
    def name(self):
        """Name of the effect."""
        return self.effect.name


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
        # the level, the three axes, then what patterns enter
        self.columns = [
            np.column_stack([np.ones(len(f.values)), f.values - f.values.mean(axis=0)])
            for f in self.fitted
        ]
        self.weighted = [n.precision @ c for n, c in zip(self.noise, self.columns, strict=True)]
        self._known, self._patterns = {}, {}

    def patterns(self, effects):
        """Return the patterns of effects, their columns entered into the model."""
        new = []
        for effect in dict.fromkeys(e for e in effects if e not in self._patterns):
            fitted = tuple(derivative(effect, r) for r in self.fitted)
            means = tuple(derivative(effect, r) for r in self.records)
            stacked = np.concatenate(fitted)
            columns, parameters = [], []
            for axis in range(3):
                used = np.flatnonzero(np.any(stacked[:, axis] != 0, axis=0))
                parameters.append(tuple(int(p) for p in used))
                columns.append(tuple(self._enter(stacked[:, axis, p], new) for p in used))
            self._patterns[effect] = Pattern(
                effect, fitted, means, tuple(columns), tuple(parameters)
            )
        if new:
            ends = np.cumsum([len(f.windows) for f in self.fitted])[:-1]
            parts = np.split(np.column_stack(new), ends)
            for i, part in enumerate(parts):
                self.columns[i] = np.column_stack([self.columns[i], part])
                self.weighted[i] = np.concatenate(
                    [self.weighted[i], self.noise[i].precision @ part], axis=2
                )
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
    _parts: dict = field(default_factory=dict)
    _gram: tuple = None
    _fits: dict = field(default_factory=dict)

    def gram(self):
        """Return products of all columns, levels taken out, and what goes with them.

        Seen windows alone have the precision ``P_ss - P_sh P_hh⁻¹ P_hs``, so the products of the
        columns Z are ``Zᵀ P Z - (P Z)_hᵀ P_hh⁻¹ (P Z)_h``. The level is taken out likewise.

        Returns
        -------
        ndarray, shape (g, c, c)
            Sum over the records.
        ndarray, shape (g,)
            ``log det`` of the covariance and of the levels' information.
        int
            Windows less levels.
        """
        count = self.model.columns[0].shape[1]
        if self._gram is None or self._gram[0].shape[1] < count:
            parts = [self._part(i) for i, h in enumerate(self.held) if h is not None]
            self._gram = tuple(sum(p) for p in zip(*parts, strict=True))
        return self._gram

    def _part(self, i):
        z, weighted = self.model.columns[i], self.model.weighted[i]
        noise, held = self.model.noise[i], self.held[i]
        block = noise.precision[:, held][:, :, held]
        # only what came since the last time
        before = self._parts.get(i, np.zeros((len(weighted), 0, 0)))
        known, count = before.shape[1], z.shape[1]
        new = slice(known, count)
        cross = z.T @ weighted[:, :, new]
        if len(held):
            ahead = np.swapaxes(weighted[:, held], 1, 2)
            cross = cross - ahead @ np.linalg.solve(block, weighted[:, held, new])
        gram = np.empty((len(weighted), count, count))
        gram[:, :known, :known] = before
        gram[:, :, new], gram[:, new] = cross, np.swapaxes(cross, 1, 2)
        self._parts[i] = gram
        level = gram[:, 0, 0]
        log_det = noise.log_det + np.log(level) + np.linalg.slogdet(block)[1]
        left = gram - gram[:, :, :1] * gram[:, :1] / level[:, None, None]
        return left, log_det, len(z) - len(held) - 1

    def fit(self, columns, axis):
        """Return the Fit of an axis to columns of the model; None where they are not independent.

        Parameters
        ----------
        columns : tuple of int
            Columns.
        axis : int
            Axis.
        """
        key = columns, axis
        if key not in self._fits:
            self._fits[key] = self._fit(list(columns), axis)
        return self._fits[key]

    def _fit(self, columns, axis):
        gram, log_det, windows = self.gram()
        dof = windows - len(columns)
        if dof < 2:
            return None
        square = gram[:, 1 + axis, 1 + axis]
        if not columns:
            nothing = np.zeros((len(gram), 0))
            log_weight = self.model.prior - (dof * np.log(square) + log_det) / 2
            return Fit(nothing, nothing[:, :, None], square, log_weight, dof)
        own = gram[:, columns][:, :, columns]
        size = np.sqrt(np.maximum(np.einsum("gpp->gp", own), 0.0))
        # the columns have norm 1 before the levels are taken out, and noise of N = 1
        if not np.all(size[0] ** 2 > ABSORBED * self.model.fitted[0].length.min()):
            return None
        own = own / size[:, :, None] / size[:, None, :]
        if np.linalg.eigvalsh(own[0])[0] < ABSORBED:
            return None
        inverse = np.linalg.inv(own)
        product = gram[:, columns, 1 + axis] / size
        theta = np.einsum("gpq,gq->gp", inverse, product)
        square = square - np.einsum("gp,gp->g", theta, product)
        square = np.maximum(square, 1e-12 * gram[:, 1 + axis, 1 + axis])
        log_det = log_det + np.linalg.slogdet(own)[1] + 2 * np.log(size).sum(axis=1)
        log_weight = self.model.prior - (dof * np.log(square) + log_det) / 2
        covariance = inverse / size[:, :, None] / size[:, None, :]
        return Fit(
            theta / size, covariance * (square / dof)[:, None, None], square, log_weight, dof
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


def folds(records, blocks):
    """Return in which fold each window of each record is held out, one array a record.

    One block of time of every record, but not the same one: what happens at the start of each is
    predicted from the starts of the others.
    """
    shift = [i * blocks // len(records) for i in range(len(records))]
    return [(block_of(r, blocks) + s) % blocks for r, s in zip(records, shift, strict=True)]


def without_fold(model, fold, blocks):
    """Return the sight that lacks one block of time in every record."""
    return Sight(model, tuple(np.flatnonzero(f == fold) for f in folds(model.fitted, blocks)))
