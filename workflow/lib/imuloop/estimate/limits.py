"""Detection limits: the sizes of an effect that the test and the held-out data would show."""

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ncfdtri, ndtri, stdtrit

from imuloop.core.fisher import fisher
from imuloop.estimate.error_ratio import cut_parts
from imuloop.estimate.p_values import averaged_log_p
from imuloop.estimate.residuals import fold_fits
from imuloop.estimate.verdict import MARGIN

# logarithm of the p-value in the middle of chance, for the axes that show nothing
CHANCE = np.log(0.5)
# sizes that are tried, in standard errors of the parameter
SIZES = np.geomspace(1.0, 300.0, 250)
# what a time constant or a width, even up to 1.3 from a shape, is off by: root mean square
BETWEEN = 1.3**3**-0.5
# noncentrality, the least, and how many of them are computed
LEAST, GRID = 1.0, 24
# by how much slow noise makes the limit of an effect that looks like it larger, about
GROWN = 4.0


def detection_limits(search, base, trial, power, kept=True):
    """Return the least size of each parameter of a trial that these data would show.

    One parameter is not zero, and has a time constant or a width between those of the shapes. Its
    size is a limit where it passes the test with the wanted power, and lowers the held-out error
    for certain. Both are computed from expected values, see `tested` and `confirmed`.

    Parameters
    ----------
    search : Search
        The search of all data.
    base : tuple of Effect
        Effects beside that of the trial.
    trial : Trial
        The effect.
    power : float
        Probability with which the test finds it.
    kept : bool
        Whether the held-out error has to fall.

    Returns
    -------
    dict of str to float
        SI, by parameter; those that no size shows are left out.
    """
    training_fit, limits, names = search.training_fit(base), {}, list(trial.effect.parameters)
    pattern, moved = training_fit.evidence.patterns((trial.effect, trial.effect.moved(BETWEEN)))
    rules = power, search.threshold(len(base)) - trial.tries, (trial.axes - 1) * [CHANCE]
    for axis, added in enumerate(moved.columns):
        effects = [(*base, trial.effect), base, (trial.effect,)]
        fit = training_fit.fit(effects[0], axis) if pattern.columns[axis] else None
        if fit is None:
            continue
        gain = explained(training_fit, effects, axis, added) / fit.scale[:, None]
        gain = gain[np.argmax(fit.weight)]
        sizes = SIZES[:, None] / np.sqrt(np.where(gain > 0, gain, np.inf))
        certain = np.broadcast_to(gain > 0, sizes.shape)
        if kept:
            how = search, training_fit, effects, axis, added, sizes
            certain = certain & confirmed(*how, ndtri(power))
        passes = certain & tested(training_fit, effects, axis, added, sizes, *rules)
        if search.problem.slow(trial.effect):
            for k, column in enumerate(added):
                how = search, training_fit, effects, axis, column, sizes[:, [k]]
                passes[:, k] = beside_noise(*how, passes[:, k], rules)
        first = first_size(passes)
        for k, parameter in enumerate(moved.parameters[axis]):
            if first[k] < len(SIZES):
                limits[names[parameter]] = float(sizes[first[k], k] / moved.scale[axis][k])
    return {name: limits[name] for name in names if name in limits}


def first_size(passes):
    """Return the number of the first size from which on all pass, (q,), of sizes, (s, q)."""
    failing = np.vstack([np.zeros_like(passes[:1]), passes])[::-1]
    return len(passes) - np.argmin(failing, axis=0)


def beside_noise(search, training_fit, effects, axis, column, sizes, passes, rules):
    """Return which sizes of a column, (s,), pass the test of an effect that slow noise imitates.

    Data with the effect let expect more slow noise: it is estimated again with the effect in the
    data, `GROWN` times as large as the size that passes by the noise as it is. Takes which sizes
    pass by that, (s,).
    """
    evidence, first = training_fit.evidence, first_size(passes[:, None])[0]
    if first == len(sizes):
        return passes
    one, values = evidence.columns[column], training_fit.residuals(effects[0], axis)
    slower = evidence.with_noise(
        search.problem.noise_with(effects[1], values + GROWN * sizes[first, 0] * one)
    )
    numbers = slower.add_columns([one])
    return passes & tested(slower.training_fit(), effects, axis, numbers, sizes, *rules)[:, 0]


def explained(training_fit, effects, axis, added):
    """Return by how much χ² falls, by the pattern in the model, for added columns of size one.

    Takes the numbers of what is added, (q,); gives (h, q), for each hypothesis about the noise.
    """
    every, base, _ = (training_fit.evidence.columns_of(e, axis) for e in effects)
    gram, left = training_fit.gram((*every, *added)), []
    for n in (len(base), len(every)):
        side = gram[:, :n, -len(added) :]
        left.append((side * np.linalg.solve(gram[:, :n, :n], side)).sum(axis=1))
    return left[1] - left[0]


def tested(training_fit, effects, axis, added, sizes, power, threshold, others):
    """Return which sizes of added columns, (s, q), pass the test with the wanted power.

    F has the noncentrality ``s² gain`` under each hypothesis about the noise, of which the
    p-values are averaged as those of data are.
    """
    fit, without = (training_fit.fit(e, axis) for e in effects[:2])
    q, scale = fit.theta.shape[1] - without.theta.shape[1], fit.scale[:, None, None]
    gain = explained(training_fit, effects, axis, added)[:, None]
    square = np.maximum(sizes**2 * gain / scale, LEAST)
    grid = np.geomspace(LEAST, max(square.max(), 2 * LEAST), GRID)
    lowest = np.interp(np.log(square), np.log(grid), ncfdtri(q, fit.dof, grid, 1 - power))
    rest = (without.log_weight + without.spent)[:, None, None]
    one = replace(without, square=fit.square[:, None, None] + q * scale * lowest)
    one = replace(one, log_weight=rest - one.spent)
    weight = np.broadcast_to(fit.log_weight[:, None, None], square.shape)
    alike = replace(fit, square=fit.square[:, None, None], log_weight=weight)
    return fisher([averaged_log_p(one, alike, q), *others]) < threshold


def confirmed(search, training_fit, effects, axis, added, sizes, quantile):
    """Return which sizes of added columns, (s, q), lower the held-out error for certain.

    Without the pattern in the model the held-out errors of part k are ``e + s c``, e of the noise,
    with it ``e + s C - d δ``, d those of the pattern's own columns and δ the error of their
    parameters, of covariance V. The sums of their squares over a part are expected to be

        B_k = Σ (v + s² c²),    A_k = Σ (v + s² C² + d V dᵀ),    v the variance of e,

    and their difference has the variance ``Σ 4 v (s² (c - C)² + d V dᵀ)``. The ratio ``√(A/B)`` of
    the sums over all parts and its jackknife error follow; it has to be below one by Student's
    quantile and by what that variance adds: so many standard deviations, `quantile`, as belong to
    the wanted power.
    """
    problem, evidence = search.problem, training_fit.evidence
    groups, parts = evidence.row_groups, evidence.row_parts
    fit = training_fit.fit(effects[0], axis)
    h = training_fit.hypothesis(fit)
    known, own = (evidence.matrix(evidence.columns_of(e, axis)) for e in effects[1:])
    known = np.column_stack([block_diag(*(g.nuisance for g in groups)), known])
    weights, scale = block_diag(*(g.noise.precision[h] for g in groups)), fit.scale[h]
    unit = np.broadcast_to(problem.error_scale, len(parts))
    values, design = np.column_stack([evidence.matrix(added), own]), np.column_stack([known, own])
    q, k = len(added), known.shape[1]
    before, _ = fold_fits(values, weights, known, parts)
    after, inverses = fold_fits(values[:, :q], weights, design, parts)
    v, before = scale * evidence.held_out_variance(h) / unit**2, before / unit[:, None]
    c, C, d = before[:, :q], after / unit[:, None], before[:, q:]
    kinds = np.array(problem.rows_by_kind()) & (parts[:, 0] >= 0)
    spread, by_kind = np.zeros(len(parts)), 0.0
    for part, inverse in inverses.items():
        rows, own = parts[:, 0] == part, scale * inverse[k:, k:]
        spread[rows] = np.einsum("na,ab,nb->n", d[rows], own, d[rows])
        by_kind = by_kind + np.array([d[rows & kind].T @ d[rows & kind] @ own for kind in kinds])
    # what δ adds to the errors of a kind is Σ δᵀ dᵀ d δ: its mean, and standard deviation
    most = np.trace(by_kind, axis1=1, axis2=2)
    variance = np.maximum(2 * np.einsum("kab,kba->k", by_kind, by_kind), 0.0)
    most = most + quantile * np.sqrt(variance)
    found = np.zeros(sizes.shape, dtype=bool)
    if np.any(most > (MARGIN**2 - 1) * (kinds @ v)):
        return found
    for j in range(q):
        change = (c[:, j] - C[:, j]) ** 2 / np.where(v > 0, v, 1.0)
        rows = kinds[np.argmax(kinds @ change)]
        cut, noise, square = cut_parts(parts[rows, 0], change[rows]), v[rows], sizes[:, [j]] ** 2
        B = cut @ noise + square * (cut @ c[rows, j] ** 2)
        A = cut @ (noise + spread[rows]) + square * (cut @ C[rows, j] ** 2)
        variance = 4 * (cut @ (noise * spread[rows]))
        variance = variance + 4 * square * (cut @ (noise * (c[rows, j] - C[rows, j]) ** 2))
        found[:, j] = surely_below_one(A, B, variance, quantile)
    return found


def surely_below_one(after, before, variance, quantile):
    """Return whether ratios of held-out errors are below one for certain, (s,) of bool.

    Takes the expected sums of squares of each part, (s, parts), and the variance of their
    difference.
    """
    n, total = before.shape[1], (after.sum(axis=1), before.sum(axis=1))
    ratio = np.sqrt(total[0] / total[1])
    share = after / total[0][:, None] - before / total[1][:, None]
    random = variance.sum(axis=1) / (total[0] * total[1])
    error = ratio / 2 * np.sqrt(n / (n - 1) * (share**2).sum(axis=1) + random)
    return ratio + stdtrit(n - 1, 0.975) * error + quantile * ratio / 2 * np.sqrt(random) < 1
