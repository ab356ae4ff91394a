"""Detection limits: what would have been found, and kept, with the wanted power."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ndtr, ndtri

from imuloop.core.fisher import fisher
from imuloop.diagnose.p_values import averaged_log_p
from imuloop.diagnose.residuals import held_out_operator
from imuloop.diagnose.search import moved
from imuloop.diagnose.verdict import MARGIN

# logarithm of the p-value in the middle of chance, for the axes that show nothing
CHANCE = np.log(0.5)
# records of noise that are drawn, and parts of each drawn again
RECORDS, DRAWS = 200, 200
# the largest size that is tried, in the least of them, and the steps between them
LARGEST, STEP = 16.0, 2.0
# what a time constant or a width, even up to 1.3 from a shape, is off by: root mean square
BETWEEN = 1.3**3**-0.5
# width, in logarithms, over which a record goes from lost to found: no count hangs on the last bit
SOFT = 0.02


def detection_limits(search, base, trial, power, kept=True):
    """Return the smallest size of each parameter of a trial that these data would have shown.

    A parameter of size s that alone is not zero, in every session where an effect has one each, is
    added to drawn records of noise, each hypothesis as often as the data let expect. Each has to
    pass the test, its p-value averaged over the hypotheses as it has them itself, and to lower the
    error of parts that are held out, for certain by whole parts drawn again; what the noise does to
    the parameters shall not raise that error by a quarter, as where one part alone tells them. What
    changes with time or temperature can look like slow noise: where data with it would let expect
    more, the hypotheses are those of such data. Time constants and widths that are added lie
    between those of the shapes.

    Parameters
    ----------
    search : Search
        The search of all data.
    base : tuple of Effect
        The effects beside it.
    trial : Trial
        The candidate's trial beside `base`.
    power : float
        Probability of finding the effect.
    kept : bool
        Whether held-out parts have to confirm it.

    Returns
    -------
    dict of str to float
        By parameter; parameters that no axis shows, or at no size, are left out.
    """
    sight = search.sight(base)
    between = moved(trial.effect, BETWEEN)
    pattern, added = sight.evidence.patterns((trial.effect, between))
    limits = {}
    names = list(trial.effect.parameters)
    needed = search.threshold(len(base)) - trial.tries
    for axis, own in enumerate(pattern.columns):
        columns = search.columns(base, axis)
        fit = sight.fit((*columns, *own), axis) if own else None
        if fit is None:
            continue
        records = _records(sight, fit, search.problem.settings.seed)
        drawn = _Drawn.of(search, sight, columns, own, added.columns[axis], axis, records)
        slow = any(map(search.problem.slow, trial.effects))
        seen = search, base, trial, between, axis, records, needed, kept
        shown = [names[p] for p in pattern.parameters[axis]]
        for together in dict.fromkeys(map(trial.effect.together, shown)):
            one = np.isin(shown, together) * added.scale[axis]
            scale = np.linalg.norm(one)
            one = one / scale
            share = partial(drawn.found, one, axes=trial.axes, needed=needed, kept=kept)
            size = _least(share, drawn.typical(one), power)
            if size and slow:
                size = _least(partial(_with_pattern, *seen, one), size, power)
            if size is not None:
                limits |= dict.fromkeys(together, size / scale)
    return {name: limits[name] for name in names if name in limits}


@dataclass(frozen=True)
class _Drawn:
    """Drawn records of noise, and what a pattern like that of the model adds to them.

    Attributes
    ----------
    fits : tuple of Fit
        To the data, without the pattern and with it.
    prior : tuple of ndarray, shape (h,)
        Of each fit, what its weights hold beside the residuals.
    gram : ndarray, shape (h, k, k)
        Products of the columns of the base model, of its pattern and, last, of the added one.
    product, square : ndarray, shape (h, k, m) and (h, m)
        Of the columns with the records, and of the records.
    errors : tuple of (ndarray, ndarray)
        Held-out errors of the records, (N, m), and of the added columns, (N, q), without the
        pattern in the model and with it.
    groups : list of list of ndarray of bool, shape (N,)
        Rows of each part, for each kind of residual.
    variance : ndarray, shape (N,)
        Of the noise.
    counts : ndarray, shape (d, parts)
        How often each part is drawn.
    """

    fits: tuple
    prior: tuple
    gram: np.ndarray
    product: np.ndarray
    square: np.ndarray
    errors: tuple
    groups: list
    variance: np.ndarray
    counts: np.ndarray

    @classmethod
    def of(cls, search, sight, columns, own, added, axis, records):
        """Return them for columns of a base model, a pattern and what is added, on an axis."""
        evidence, (values, variance) = sight.evidence, records
        fits = sight.fit(columns, axis), sight.fit((*columns, *own), axis)
        product, square = 0.0, 0.0
        for i, own_values in enumerate(values):
            z = np.column_stack([evidence.columns[i][c] for c in (*columns, *own, *added)])
            each = [sight.precision(i, h) @ own_values for h in range(len(evidence.prior))]
            product = product + np.array([z.T @ w for w in each])
            square = square + np.array([(own_values * w).sum(axis=0) for w in each])
        folds = np.concatenate([b.folds for b in evidence.blocks])
        known, pattern, more = (
            np.array([np.concatenate([e[c] for e in evidence.columns]) for c in each])
            .reshape(-1, len(folds))
            .T
            for each in (columns, own, added)
        )
        known = np.column_stack([block_diag(*(b.nuisance for b in evidence.blocks)), known])
        estimated = sight.point(fits[1])
        weights = block_diag(*(b.noise.precision[estimated] for b in evidence.blocks))
        parts = sorted(set(folds[:, 0].tolist()) - {-1})
        everything = np.column_stack([np.concatenate(values), more])
        errors = [
            held_out_operator(weights, design, folds) @ everything
            for design in (known, np.column_stack([known, pattern]))
        ]
        return cls(
            fits,
            tuple(f.log_weight + f.spent for f in fits),
            sight.gram((*columns, *own, *added)),
            product,
            square,
            tuple((e[:, :RECORDS], e[:, RECORDS:]) for e in errors),
            [[rows & (folds[:, 0] == part) for part in parts] for rows in search.problem.groups()],
            variance,
            np.random.default_rng(search.problem.settings.seed).multinomial(
                len(parts), np.full(len(parts), 1 / len(parts)), DRAWS
            ),
        )

    def typical(self, one):
        """Return the size along a direction of the columns, (q,), that the test alone needs."""
        q = self.fits[1].theta.shape[1] - self.fits[0].theta.shape[1]
        point = int(np.argmax(self.fits[1].log_weight))
        own = np.linalg.inv(self.fits[1].covariance[point][-q:, -q:])
        return np.sqrt(10.0 / (one @ own @ one))

    def found(self, one, size, axes, needed, kept=True):
        """Return the share of the records in which a size along a direction is found."""
        q, added = len(one), size * one
        base = self.gram.shape[1] - 2 * q
        gram = self.gram[:, :, -q:] @ added
        square = self.square + 2 * np.einsum("k,hkm->hm", added, self.product[:, -q:])
        square = square + (gram[:, -q:] @ added)[:, None]
        product = self.product + gram[:, :, None]
        left = [
            square - (np.linalg.solve(self.gram[:, :n, :n], product[:, :n]) * product[:, :n]).sum(1)
            for n in (base, base + q)
        ]
        fits = [replace(f, square=v) for f, v in zip(self.fits, left, strict=True)]
        each = zip(fits, self.prior, strict=True)
        fits = [replace(f, log_weight=p[:, None] - f.spent) for f, p in each]
        log_p = averaged_log_p(*fits, q)
        joint = fisher([log_p] + [np.full(len(log_p), CHANCE)] * (axes - 1))
        passed = ndtr((needed - joint) / SOFT)
        near = passed > 1e-6
        if not (kept and near.any()):
            return float(passed.mean())
        # in the kind of residual where it changes most
        (_, before), (_, after) = self.errors
        change = ((before - after) @ one) ** 2 / self.variance
        groups = max(self.groups, key=lambda parts: sum(change[p].sum() for p in parts))
        sums = []
        for records, columns in self.errors:
            squares = (records[:, near] + (columns @ added)[:, None]) ** 2
            sums.append(np.array([squares[rows].sum(axis=0) for rows in groups]))
        highest = np.quantile((self.counts @ sums[1]) / (self.counts @ sums[0]), 0.975, axis=0)
        lower = ndtr(-np.log(highest) / SOFT)
        # what the noise does to the parameters, in every kind of residual
        kinds = [rows for rows in (np.any(parts, axis=0) for parts in self.groups) if rows.any()]
        noise, more = ([(e[k][:, near] ** 2).sum(axis=0) for k in kinds] for e, _ in self.errors)
        close = ndtr(np.log(MARGIN**2 / np.max(np.divide(more, noise), axis=0)) / SOFT)
        return float((passed[near] * lower * close).sum() / len(passed))


def _with_pattern(search, base, trial, between, axis, records, needed, kept, one, size):
    """Return the share that is found where the noise is what data with the pattern let expect."""
    sight, effects = search.sight(base), (base, trial.effects, (between,))
    columns, own, more = (sight.evidence.columns_of(e, axis) for e in effects)
    left = sight.left((*columns, *own), axis)
    added = [size * one @ [each[c] for c in more] for each in sight.evidence.columns]
    values = [v + more for v, more in zip(left, added, strict=True)]
    other = sight.evidence.under(search.problem.noise_with(base, values))
    columns = (other.columns_of(e, axis) for e in effects)
    again = _Drawn.of(search, other.sight(), *columns, axis, records)
    return again.found(one, size, trial.axes, needed, kept)


def _least(share, smallest, power):
    """Return the size, not below the smallest, of which a share is found; None at none."""

    def missing(size):
        """Return what a size lacks of the power in normal quantiles."""
        return float(ndtri(power) - ndtri(np.clip(share(size), 1 / RECORDS, 1 - 1 / RECORDS)))

    low, high = None, smallest
    excess = missing(high)
    while excess > 0:
        low, lacking, high = high, excess, high * STEP
        if high > LARGEST * smallest:
            return None
        excess = missing(high)
    if low is None:
        return smallest
    # where two processors take different sides of a zero they still find the same size
    size = low * (high / low) ** (lacking / (lacking - excess))
    if (between := missing(size)) > 0:
        low, lacking = size, between
    else:
        high, excess = size, between
    return low * (high / low) ** (lacking / (lacking - excess))


def _records(sight, fit, seed):
    """Return drawn noise, (n, m) of each block, and its variance, shape (N,)."""
    rng, values, variance = np.random.default_rng(seed), [], []
    # each hypothesis as often as it is likely, by numbers that rounding does not move
    share = np.cumsum(np.round(fit.weight, 6))
    drawn = np.searchsorted(share / share[-1], (np.arange(RECORDS) + 0.5) / RECORDS)
    for block in sight.evidence.blocks:
        white, spread = rng.standard_normal((len(block.values), RECORDS)), 0.0
        for h in np.unique(drawn):
            precision = block.noise.precision[h] / fit.scale[h]
            # with L Lᵀ = P white numbers become noise by L⁻ᵀ
            root = np.linalg.cholesky(precision).T
            white[:, drawn == h] = np.linalg.solve(root, white[:, drawn == h])
            spread = spread + (drawn == h).mean() / np.diag(precision)
        values.append(white)
        variance.append(spread)
    return values, np.concatenate(variance)
