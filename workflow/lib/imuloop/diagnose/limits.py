"""Detection limits: the sizes that would have been found, and kept, with the wanted power."""

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.linalg import block_diag, solve_triangular
from scipy.special import chdtri, chndtrinc, ndtr, ndtri

from imuloop.core.fisher import fisher
from imuloop.diagnose.p_values import averaged_log_p
from imuloop.diagnose.residuals import held_out_errors
from imuloop.diagnose.verdict import MARGIN

# logarithm of the p-value in the middle of chance, for the axes that show nothing
CHANCE = np.log(0.5)
# records of noise that are drawn, each used with its negative too, since what is found too easily
# with the one is not with the other; and parts of each drawn again
PAIRS, DRAWS = 100, 200
RECORDS = 2 * PAIRS
# the largest size that is tried, in those of the test alone, the largest step between two, by how
# much the power may rise faster or slower than expected, and the last step, in logarithms
LARGEST, STEP, STEEPER, CLOSE = 16.0, 2.0, 4.0, 0.1
# what a time constant or a width, even up to 1.3 from a shape, is off by: root mean square
BETWEEN = 1.3**3**-0.5
# what changes with time changes at a log's first rest too, where its noise was estimated larger for
# it; so much larger are limits in such logs than those of drawn records, as the study measured
OWN_REST = 1.10
# width, in logarithms, over which a record goes from lost to found: no count hangs on the last bit
SOFT = 0.02


def detection_limits(search, base, trial, power, kept=True):
    """Return the smallest size of each parameter of a trial that these data would have shown.

    A parameter of size s that alone is not zero, in every session where an effect has one each, is
    added to drawn records of noise, each hypothesis as often as the data let expect. Each has to
    pass the test, its p-value averaged over the hypotheses as it has them itself, and to lower the
    error of parts that are held out, for certain by whole parts drawn again; what the noise does to
    the parameters shall not raise that error by a quarter, as where one part alone shows them. What
    changes with time or temperature can look like slow noise: where data with it would let expect
    more, the hypotheses are those of such data. Time constants and widths that are added lie
    between those of the shapes.

    `search` is that of all data, `base` the effects beside that of the trial, `power` the
    probability of finding it, `kept` whether held-out parts have to confirm it. The sizes are by
    parameter; those that no axis shows, or at no size, are left out.
    """
    training_fit, limits, names = search.training_fit(base), {}, list(trial.effect.parameters)
    effects = base, trial.effects, (trial.effect.moved(BETWEEN),)
    pattern, added = training_fit.evidence.patterns((*effects[1], *effects[2]))
    threshold = search.threshold(len(base)) - trial.tries
    rules = {"axes": trial.axes, "threshold": threshold, "kept": kept}
    for axis, own in enumerate(pattern.columns):
        fit = training_fit.fit((*base, *trial.effects), axis) if own else None
        if fit is None:
            continue
        records = _Records.of(training_fit, fit, search.problem.settings.seed)
        drawn = _Drawn.of(search, training_fit, effects, axis, records)
        shown = [names[p] for p in pattern.parameters[axis]]
        for together in dict.fromkeys(map(trial.effect.together, shown)):
            one = np.isin(shown, together) * added.scale[axis]
            scale = np.linalg.norm(one)
            one = one / scale
            # of a kind that noise alone spoils no size is found
            if kept and drawn.close.mean() < power:
                continue
            start, strength = drawn.typical(one, threshold, power)
            size = least_size(partial(drawn.found, one, **rules), start, power, strength)
            if size and search.problem.slow(trial.effect):
                slow = partial(_with_pattern, search, effects, axis, records, one, **rules)
                slower = least_size(slow, size, power, strength)
                size = slower and max(size, slower)
                if size and search.problem.own_rest and trial.effect.timed:
                    size *= OWN_REST
            if size is not None:
                limits |= dict.fromkeys(together, search.problem.limit_correction * size / scale)
    return {name: limits[name] for name in names if name in limits}


@dataclass(frozen=True)
class _Drawn:
    """Drawn records of noise, and what a pattern like that of the model adds to them."""

    fits: tuple  # Fits to the data, without the pattern and with it
    # of what either leaves: squares of the records, (h, m), their products with the added columns,
    # (h, q, m), and the products of these, (h, q, q)
    left: tuple
    # held-out errors of the records, (N, m), and of the added columns, (N, q): two pairs, without
    # the pattern in the model and with it
    errors: tuple
    rows_of_parts: np.ndarray  # (kinds, parts, N): whether a row is of a kind and of a part
    variance: np.ndarray  # (N,): of the noise
    counts: np.ndarray  # (d, parts): how often each part is drawn

    @classmethod
    def of(cls, search, training_fit, effects, axis, records):
        """Return them for effects of a base model, of its pattern and of what is added."""
        evidence, values = training_fit.evidence, records.values
        columns, own, added = each = [evidence.columns_of(e, axis) for e in effects]
        fits = [training_fit.fit(e, axis) for e in (effects[0], (*effects[0], *effects[1]))]
        product, square, numbers = 0.0, 0.0, (*columns, *own, *added)
        for i, drawn in enumerate(values):
            of_columns, lost = training_fit.with_vectors(i, numbers, drawn)
            product, square = product + of_columns, square + records.squares(i, evidence) - lost
        whole = np.concatenate([training_fit.gram(numbers), product], axis=2)
        k, q, left = whole.shape[1], len(added), []
        for n in (len(columns), len(columns) + len(own)):
            side = whole[:, :n, k - q :]
            taken = np.linalg.solve(whole[:, :n, :n], side)
            rest = whole[:, k - q :, k - q :] - np.swapaxes(side[:, :, :q], 1, 2) @ taken
            less = (side * taken)[:, :, q:].sum(axis=1)
            squares, products = np.tile(square - less, 2), _with_negatives(rest[:, :, q:])
            left.append((squares, products, rest[:, :, :q]))
        row_parts = np.concatenate([g.row_parts for g in evidence.row_groups])
        known, pattern, more = map(evidence.matrix, each)
        known = np.column_stack([block_diag(*(g.nuisance for g in evidence.row_groups)), known])
        estimated = training_fit.hypothesis(fits[1])
        weights = block_diag(*(g.noise.precision[estimated] for g in evidence.row_groups))
        parts = sorted(set(row_parts[:, 0].tolist()) - {-1})
        of_part = row_parts[:, 0] == np.array(parts)[:, None]
        everything = np.column_stack([np.concatenate(values), more])
        measure = np.broadcast_to(search.problem.error_scale, len(row_parts))[:, None]
        design = np.column_stack([known, pattern])
        counts = known.shape[1], design.shape[1]
        errors = held_out_errors(everything, weights, design, row_parts, counts)
        errors = (np.split(e / measure, [PAIRS], axis=1) for e in errors)
        return cls(
            tuple(fits),
            tuple(left),
            tuple((_with_negatives(records), columns) for records, columns in errors),
            np.array([rows & of_part for rows in search.problem.rows_by_kind()]),
            records.variance / measure[:, 0] ** 2,
            np.random.default_rng(search.problem.settings.seed).multinomial(
                len(parts), np.full(len(parts), 1 / len(parts)), DRAWS
            ),
        )

    def typical(self, one, threshold, power):
        """Return the size along a direction of the columns, (q,), that the test alone needs.

        By the noncentral χ² of known noise, with its deviation from none in standard deviations.
        """
        q = self.fits[1].theta.shape[1] - self.fits[0].theta.shape[1]
        hypothesis = int(np.argmax(self.fits[1].log_weight))
        own = np.linalg.inv(self.fits[1].covariance[hypothesis][-q:, -q:])
        needed = np.sqrt(chndtrinc(chdtri(q, np.exp(threshold)), q, 1 - power))
        return needed / np.sqrt(one @ own @ one), needed

    def found(self, one, size, axes, threshold, kept=True):
        """Return the share of the records in which a size along a direction is found."""
        added, fits = size * one, []
        for fit, (square, product, gram) in zip(self.fits, self.left, strict=True):
            change = 2 * np.einsum("k,hkm->hm", added, product)
            drawn = replace(fit, square=square + change + (gram @ added @ added)[:, None])
            # what the weight holds beside the residuals stays
            rest = (fit.log_weight + fit.spent)[:, None]
            fits.append(replace(drawn, log_weight=rest - drawn.spent))
        log_p = averaged_log_p(*fits, len(one))
        joint = fisher([log_p] + [np.full(len(log_p), CHANCE)] * (axes - 1))
        passed = ndtr((threshold - joint) / SOFT)
        near = passed > 1e-6
        if not (kept and near.any()):
            return float(passed.mean())
        # in the kind of residual where it changes most
        (_, before), (_, after) = self.errors
        change = ((before - after) @ one) ** 2 / self.variance
        rows = self.rows_of_parts[np.argmax((self.rows_of_parts @ change).sum(axis=1))]
        before, after = (
            self.counts @ (rows @ (records[:, near] + (columns @ added)[:, None]) ** 2)
            for records, columns in self.errors
        )
        highest = np.quantile(after / before, 0.975, axis=0)
        lower = ndtr(-np.log(highest) / SOFT)
        return float((passed * self.close)[near] @ lower / len(passed))

    @cached_property
    def close(self):
        """Weight of each record by what its noise does to the parameters, in every kind, (m,)."""
        kinds = self.rows_of_parts.any(axis=1)
        noise, more = (kinds[kinds.any(axis=1)] @ e**2 for e, _ in self.errors)
        return ndtr(np.log(MARGIN**2 / np.max(more / noise, axis=0)) / SOFT)


def _with_negatives(records):
    """Return numbers of records, (..., m), followed by those of their negatives, (..., 2 m)."""
    return np.concatenate([records, -records], axis=-1)


def _with_pattern(search, effects, axis, records, one, size, **rules):
    """Return the share that is found where the noise is what data with the pattern let expect."""
    training_fit, (base, own, added) = search.training_fit(effects[0]), effects
    evidence = training_fit.evidence
    values = training_fit.residuals((*base, *own), axis)
    values = values + evidence.matrix(evidence.columns_of(added, axis)) @ (size * one)
    other = evidence.with_noise(search.problem.noise_with(base, values))
    return _Drawn.of(search, other.training_fit(), effects, axis, records).found(one, size, **rules)


def least_size(share, start, power, strength):
    """Return the size of which a share is found; None at none within `LARGEST` of the start.

    By secants in the logarithm of the size, within what was too small and what was found.
    `strength` is by how many normal quantiles a size that is e times as large is found more often.
    """
    wanted, last, slope = ndtri(power), None, strength
    first, small, large = np.log(start), -np.inf, np.inf
    size = first
    # of what the noise alone shows any size is found
    while abs(size - first) <= np.log(LARGEST):
        # by how much it misses the wanted power
        missing = wanted - ndtri(np.clip(share(np.exp(size)), 1 / RECORDS, 1 - 1 / RECORDS))
        small, large = (size, large) if missing > 0 else (small, size)
        if last and size != last[0]:
            slope = (last[1] - missing) / (size - last[0])
            slope = np.clip(slope, strength / STEEPER, strength * STEEPER)
        step = np.clip(missing / slope, -np.log(STEP), np.log(STEP))
        following = size + step if small <= size + step <= large else (small + large) / 2
        if last and abs(following - size) < CLOSE:
            return float(np.exp(following))
        last, size = (size, missing), following
    return None


@dataclass(frozen=True)
class _Records:
    """Records of noise that are drawn for a fit."""

    evidence: object  # whose noise they have
    # (m,): the hypothesis about the noise that each is drawn by, and the size of its variance
    drawn: np.ndarray
    scale: np.ndarray
    values: list  # (n, m) of each group
    variance: np.ndarray  # (N,): of the noise

    @classmethod
    def of(cls, training_fit, fit, seed):
        """Return them for a Fit of a TrainingFit, by a seed."""
        rng, values, variance = np.random.default_rng(seed), [], []
        # each hypothesis as often as it is likely, by numbers that rounding does not move
        share = np.cumsum(np.round(fit.weight, 6))
        drawn = np.searchsorted(share / share[-1], (np.arange(PAIRS) + 0.5) / PAIRS)
        for group in training_fit.evidence.row_groups:
            white, spread = rng.standard_normal((len(group.values), PAIRS)), 0.0
            for h in np.unique(drawn):
                precision = group.noise.precision[h] / fit.scale[h]
                # with L Lᵀ = P white numbers become noise by L⁻ᵀ
                root = np.linalg.cholesky(precision)
                white[:, drawn == h] = solve_triangular(root.T, white[:, drawn == h])
                spread = spread + (drawn == h).mean() / np.diag(precision)
            values.append(white)
            variance.append(spread)
        own = fit.scale[drawn], values, np.concatenate(variance)
        return cls(training_fit.evidence, drawn, *own)

    def squares(self, i, evidence):
        """Return ``vᵀ P v`` of each record in a group by each hypothesis of some evidence, (h, m).

        The white numbers are always the same: those of a record that the same hypothesis drew
        before differ in size alone, and are not computed twice.
        """
        known = evidence.squares.setdefault(i, {}) if evidence is self.evidence else {}
        drawn = list(zip(self.drawn.tolist(), range(PAIRS), strict=True))
        new = [m for m, key in enumerate(drawn) if key not in known]
        if new:
            values = self.values[i][:, new]
            precision = evidence.row_groups[i].noise.precision
            found = np.array([(values * (own @ values)).sum(axis=0) for own in precision])
            found = found / self.scale[new]
            known |= {drawn[m]: own for m, own in zip(new, found.T, strict=True)}
        return np.array([known[key] for key in drawn]).T * self.scale
