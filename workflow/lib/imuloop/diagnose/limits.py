"""Detection limits: the sizes that would have been found, and kept, with the wanted power."""

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from imuloop.core.fisher import fisher
from imuloop.diagnose.p_values import averaged_log_p
from imuloop.diagnose.residuals import held_out_errors
from imuloop.diagnose.verdict import MARGIN

# logarithm of the p-value in the middle of chance, for the axes that show nothing
CHANCE = np.log(0.5)
# ends of the search, from the size of one standard deviation of the noise; halvings of the interval
SMALLEST, LARGEST, HALVINGS = 1.0, 300.0, 9
# what a time constant or a width, even up to 1.3 from a shape, is off by: root mean square
BETWEEN = 1.3**3**-0.5
# what changes with time changes at a log's first rest too, where its noise was estimated larger for
# it; so much larger are limits in such logs, as the study measured
OWN_REST = 1.10
# records of noise that are drawn, each used with its negative too, since what is found too easily
# with the one is not with the other; and draws of whole parts
RECORDS, DRAWS = 100, 200
# times that noise is estimated again with the effect in the data, and the largest share of a step
# that the next one is taken to have; a growth that is none
ROUNDS, STEADY, SAME = 2, 0.5, 1.02


def detection_limits(search, base, trial, power, kept=True):
    """Return the smallest size of each parameter of a trial that these data would have shown.

    A parameter alone is not zero. In drawn records of noise, each hypothesis as often as the data
    let expect, it passes the test and lowers the error of parts that are held out for certain. What
    the noise does to the parameters shall not raise that error by a quarter, as where one part
    alone shows them. What changes with time or temperature can look like slow noise: where data
    with it would let expect more, the hypotheses are those of such data. Time constants and widths
    lie between those of the shapes.

    `search` is that of all data, `base` the effects beside that of the trial, `power` the
    probability of finding it, `kept` whether held-out parts have to confirm it. The sizes are by
    parameter; those that no axis shows, or at no size, are left out.
    """
    training_fit, limits, names = search.training_fit(base), {}, list(trial.effect.parameters)
    pattern, moved = training_fit.evidence.patterns((trial.effect, trial.effect.moved(BETWEEN)))
    rules = kept, power, trial.axes, search.threshold(len(base)) - trial.tries
    for axis, own in enumerate(pattern.columns):
        fit = training_fit.fit((*base, *trial.effects), axis) if own else None
        if fit is None:
            continue
        how = base, trial.effects, axis, _records(training_fit, fit, search.problem.settings.seed)
        sizes = _sizes(search, training_fit, moved.columns[axis], how, *rules)
        if search.problem.slow(trial.effect):
            values = training_fit.residuals((*base, *trial.effects), axis)
            for k, column in enumerate(moved.columns[axis]):
                one = training_fit.evidence.columns[column]
                rounds, grown = [sizes[k]], np.isfinite(sizes[k])
                while grown and len(rounds) <= ROUNDS:
                    noise = search.problem.noise_with(base, values + rounds[-1] * one)
                    slower = training_fit.evidence.with_noise(noise)
                    number = slower.add_columns([one])
                    (size,) = _sizes(search, slower.training_fit(), number, how, *rules)
                    grown = SAME * rounds[-1] < size < np.inf
                    rounds.append(max(sizes[k], size))
                sizes[k] = _settled(*rounds) if len(rounds) > ROUNDS else rounds[-1]
            if search.problem.own_rest and trial.effect.timed:
                sizes = sizes * OWN_REST
        sizes = search.problem.limit_correction * sizes / moved.scale[axis]
        shown = [names[p] for p in pattern.parameters[axis]]
        limits |= {n: float(s) for n, s in zip(shown, sizes, strict=True) if np.isfinite(s)}
    return {name: limits[name] for name in names if name in limits}


def _settled(first, second, third):
    """Return where sizes settle that go on as from the first to the third, by Aitken's step."""
    if not np.isfinite(third) or second <= first:
        return third
    step, last = np.log(second / first), np.log(third / second)
    share = np.clip(last / step, 0.0, STEADY)
    return third * np.exp(last * share / (1 - share))


def _sizes(search, training_fit, added, how, kept, power, axes, threshold):
    """Return the least size of each of some columns, (q,), infinite where none is found.

    `how` holds the effects of the base model and of the pattern, the axis, and records of noise.
    """
    least = np.zeros(len(added))
    if kept:
        least = _confirmed(search, training_fit, added, *how, power)
    if np.all(np.isinf(least)):
        return least
    return _tested(training_fit, added, *how, axes, threshold, power, least)


def _tested(training_fit, added, base, own, axis, records, axes, threshold, power, least):
    """Return the least sizes, (q,), from `least` on, that pass the test; infinite where none does.

    The squares that a fit leaves of records, ``|e + s c|²``, are parabolas of the size s.
    """
    evidence = training_fit.evidence
    fits = [training_fit.fit(e, axis) for e in (base, (*base, *own))]
    columns, own = (evidence.columns_of(e, axis) for e in (base, own))
    numbers, q = (*columns, *own, *added), len(added)
    gram, product, square = training_fit.gram(numbers), 0.0, 0.0
    for i, values in enumerate(evidence.split(records)):
        of_columns, lost = training_fit.with_vectors(i, numbers, values)
        whole = evidence.row_groups[i].noise.precision @ values
        product, square = product + of_columns, square + (values * whole).sum(axis=1) - lost
    parabolas = []
    for n in (len(columns), len(columns) + len(own)):
        side = np.concatenate([product[:, :n], gram[:, :n, -q:]], axis=2)
        taken = np.linalg.solve(gram[:, :n, :n], side)
        of_noise, of_added = taken[:, :, :-q], taken[:, :, -q:]
        both = product[:, -q:] - np.swapaxes(gram[:, :n, -q:], 1, 2) @ of_noise
        left = square - (product[:, :n] * of_noise).sum(axis=1)
        # (h, q, m) of each record and its negative, and (h, q, 1)
        every = np.einsum("hqq->hq", gram[:, -q:, -q:]) - (gram[:, :n, -q:] * of_added).sum(axis=1)
        parabolas.append((np.tile(left, 2)[:, None], np.dstack([both, -both]), every[:, :, None]))

    def passes(size):
        """Return whether columns of some size, (q,), pass with the wanted power."""
        drawn = []
        for fit, (left, both, every) in zip(fits, parabolas, strict=True):
            # what the weight holds beside the residuals stays
            rest = (fit.log_weight + fit.spent)[:, None, None]
            square = left + 2 * size[:, None] * both + size[:, None] ** 2 * every
            one = replace(fit, square=square)
            drawn.append(replace(one, log_weight=rest - one.spent))
        log_p = averaged_log_p(*drawn, fits[1].theta.shape[1] - fits[0].theta.shape[1])
        joint = fisher([log_p] + [np.full(log_p.shape, CHANCE)] * (axes - 1))
        return np.mean(joint < threshold, axis=1) >= power

    h = int(np.argmax(fits[1].log_weight))
    unit = fits[1].scale[h] / np.maximum(parabolas[0][2] - parabolas[1][2], 1e-300)[h, :, 0]
    low, high = np.log(SMALLEST * np.sqrt(unit)), np.log(LARGEST * np.sqrt(unit))
    known = np.where(np.isfinite(least), least, 0.0)
    enough = passes(known)
    if np.all(enough | np.isinf(least)):
        return least
    never = ~passes(np.exp(high)) | np.isinf(least)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        passed = passes(np.exp(middle))
        low, high = np.where(passed, low, middle), np.where(passed, middle, high)
    return np.where(never, np.inf, np.where(enough, known, np.maximum(known, np.exp(high))))


def _confirmed(search, training_fit, added, base, own, axis, records, power):
    """Return the sizes from which on held-out parts confirm columns of what is added, (q,).

    An error falls for certain where it does in 97.5 % of draws of whole parts. With held-out errors
    of a record of noise without the pattern, e, and with it, E, and of a column, c and C, the sum
    over a draw, ``Σ (e + s c)² - (E + s C)²``, is positive from its larger root s on.
    """
    problem, evidence = search.problem, training_fit.evidence
    groups, row_parts = evidence.row_groups, evidence.row_parts
    h, added = (
        training_fit.hypothesis(training_fit.fit((*base, *own), axis)),
        evidence.matrix(added),
    )
    known, own = (evidence.matrix(evidence.columns_of(e, axis)) for e in (base, own))
    known = np.column_stack([block_diag(*(g.nuisance for g in groups)), known])
    weights = block_diag(*(g.noise.precision[h] for g in groups))
    design, counts = np.column_stack([known, own]), (known.shape[1], known.shape[1] + own.shape[1])
    errors = (
        held_out_errors(np.column_stack([records, added]), weights, design, row_parts, counts)
        / np.broadcast_to(problem.error_scale, len(row_parts))[:, None]
    )
    (before, left), (after, held) = (np.split(e, [records.shape[1]], axis=1) for e in errors)
    parts, kinds = np.unique(row_parts[:, 0]), np.array(problem.rows_by_kind())
    parts = row_parts[:, 0] == parts[parts >= 0][:, None]
    kinds = kinds[(kinds & parts.any(axis=0)).any(axis=1)] & parts.any(axis=0)
    if np.mean(np.all(kinds @ after**2 <= MARGIN**2 * (kinds @ before**2), axis=0)) < power:
        return np.full(added.shape[1], np.inf)
    # in the kind of residual where it changes most
    change = (left - held) ** 2 / np.maximum((before**2).mean(axis=1, keepdims=True), 1e-300)
    rng, found = np.random.default_rng(problem.settings.seed), []
    draws = rng.multinomial(len(parts), np.full(len(parts), 1 / len(parts)), DRAWS)
    for c, C, rows in zip(left.T, held.T, kinds[np.argmax(kinds @ change, axis=0)], strict=True):
        of_draw = draws @ (parts & rows)
        square = of_draw @ (c**2 - C**2)
        noise, both = of_draw @ (before**2 - after**2), of_draw @ (c[:, None] * before)
        both = both - of_draw @ (C[:, None] * after)
        root = np.sqrt(np.maximum(both**2 - square[:, None] * noise, 0.0))
        # a record and its negative
        sizes = np.hstack([root - both, root + both])
        with np.errstate(divide="ignore"):
            sizes = np.where(square > 0, sizes.T / np.maximum(square, 0.0), np.inf)
        found.append(np.quantile(np.quantile(sizes, 0.975, axis=1, method="higher"), power))
    return np.array(found)


def _records(training_fit, fit, seed):
    """Return records of noise, (N, RECORDS), each hypothesis as often as a Fit finds it likely."""
    rng, values, number = np.random.default_rng(seed), [], np.arange(RECORDS) + 0.5
    # by numbers that rounding does not move
    share = np.cumsum(np.round(fit.weight, 6))
    drawn = np.searchsorted(share / share[-1], number / RECORDS)
    for group in training_fit.evidence.row_groups:
        white = rng.standard_normal((len(group.values), RECORDS))
        for h in np.unique(drawn):
            # with L Lᵀ = P white numbers become noise by L⁻ᵀ
            root = np.linalg.cholesky(group.noise.precision[h] / fit.scale[h])
            white[:, drawn == h] = solve_triangular(root.T, white[:, drawn == h])
        values.append(white)
    return np.concatenate(values)
