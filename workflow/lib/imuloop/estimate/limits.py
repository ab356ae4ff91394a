"""Detection limits: the least size of an effect that the test and cross-validation would show."""

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ncfdtri, ndtri, stdtrit

from imuloop.core.fisher import fisher
from imuloop.estimate.error_ratio import cut_folds
from imuloop.estimate.p_values import averaged_log_p
from imuloop.estimate.residuals import fold_fits
from imuloop.estimate.verdict import MARGIN

# log p-value of an axis on which the effect is zero: the median
CHANCE = np.log(0.5)
# sizes that are tried, in standard errors of the parameter
SIZES = np.geomspace(1.0, 300.0, 250)
# typical factor between a true time constant, or width, and the one of the nearest shape: the
# root mean square of log factors that are uniform up to log 1.3
BETWEEN = 1.3**3**-0.5
# least noncentrality of F on the grid, and the number of grid points
LEAST, GRID = 1.0, 24
# approximate factor by which slow noise raises the limit of an effect that resembles it
GROWN = 4.0


def detection_limits(search, base, trial, power, must_lower_error=True):
    """Return the least size of each parameter of an effect that these data would show.

    For each limit the data are assumed to have the effect with this one parameter. Its time
    constant or width lies between two neighbours of the library's grid, by the factor `BETWEEN`
    from one of them. The limit is the least of the `SIZES` that passes the test with the
    probability `power` and lowers the held-out error with confidence. Both conditions are computed
    from expected values, see `passes_test` and `lowers_error`. For an effect that slow noise
    imitates, the noise is estimated again with the effect in the data.

    Parameters
    ----------
    search : Search
        The search of all data.
    base : tuple of Effect
        Effects that are in the model already.
    trial : Trial
        The test of the effect.
    power : float
        Probability with which the test has to find the effect.
    must_lower_error : bool
        Whether the held-out error has to fall, too.

    Returns
    -------
    dict of str to float
        The limits, SI, by parameter. A parameter that is not detectable at any size is left out.
    """
    training_fit, limits, names = search.training_fit(base), {}, list(trial.effect.parameters)
    pattern, moved = training_fit.evidence.patterns((trial.effect, trial.effect.moved(BETWEEN)))
    # the axes that do not have the parameter show p-values in the middle of chance
    test = power, search.threshold(len(base)) - trial.tries, (trial.axes - 1) * [CHANCE]
    for axis, added in enumerate(moved.columns):
        # full model, base model, and the effect alone
        effects = [(*base, trial.effect), base, (trial.effect,)]
        fit = training_fit.fit(effects[0], axis) if pattern.columns[axis] else None
        if fit is None:
            continue
        gain = chi_square_drop(training_fit, effects, axis, added) / fit.scale[:, None]
        # under the likeliest hypothesis about the noise
        gain = gain[np.argmax(fit.weight)]
        sizes = SIZES[:, None] / np.sqrt(np.where(gain > 0, gain, np.inf))
        certain = np.broadcast_to(gain > 0, sizes.shape)
        if must_lower_error:
            how = search, training_fit, effects, axis, added, sizes
            certain = certain & lowers_error(*how, ndtri(power))
        passes = certain & passes_test(training_fit, effects, axis, added, sizes, *test)
        if search.problem.is_like_slow_noise(trial.effect):
            for k, column in enumerate(added):
                how = search, training_fit, effects, axis, column, sizes[:, [k]]
                passes[:, k] = passes_with_slow_noise(*how, passes[:, k], test)
        first = first_size(passes)
        for k, parameter in enumerate(moved.parameters[axis]):
            if first[k] < len(SIZES):
                limits[names[parameter]] = float(sizes[first[k], k] / moved.scale[axis][k])
    return {name: limits[name] for name in names if name in limits}


def first_size(passes):
    """Return the index of the size from which on all sizes pass, (q,); s if the last one fails.

    `passes`, (s, q) of bool, has s increasing sizes of each of q parameters.
    """
    failing = np.vstack([np.zeros_like(passes[:1]), passes])[::-1]
    return len(passes) - np.argmin(failing, axis=0)


def passes_with_slow_noise(search, training_fit, effects, axis, column, sizes, passes, test):
    """Return which sizes of a column, (s,) of bool, pass if the effect resembles slow noise.

    Data with such an effect raise the estimate of slow noise. So the noise is estimated again from
    the residuals plus the effect, at `GROWN` times the least size that passes with the present
    noise. `passes`, (s,) of bool, are the sizes that pass with the present noise; `test` has the
    last arguments of `passes_test`.
    """
    evidence, first = training_fit.evidence, first_size(passes[:, None])[0]
    if first == len(sizes):
        return passes
    one, values = evidence.columns[column], training_fit.residuals(effects[0], axis)
    slower = evidence.with_noise(
        search.problem.noise_with(effects[1], values + GROWN * sizes[first, 0] * one)
    )
    numbers = slower.add_columns([one])
    return passes & passes_test(slower.training_fit(), effects, axis, numbers, sizes, *test)[:, 0]


def chi_square_drop(training_fit, effects, axis, added):
    """Return by how much a pattern lowers χ² of data that are one column of size one, (h, q).

    `added` has the numbers of q columns. The result has one entry for each noise hypothesis and
    column: χ² without the pattern in the model minus χ² with it. `effects` has the effects of the
    full model first, then those of the base model.
    """
    every, base, _ = (training_fit.evidence.columns_of(e, axis) for e in effects)
    gram, drops = training_fit.gram((*every, *added)), []
    for n in (len(base), len(every)):
        side = gram[:, :n, -len(added) :]
        drops.append((side * np.linalg.solve(gram[:, :n, :n], side)).sum(axis=1))
    return drops[1] - drops[0]


def passes_test(training_fit, effects, axis, added, sizes, power, threshold, others):
    """Return which sizes of added columns, (s, q) of bool, pass the test with the wanted power.

    `sizes`, (s, q), are sizes of the q columns `added`. Under each noise hypothesis F has the
    noncentrality ``size² drop/scale``, with the `chi_square_drop`; its lower quantile gives the
    p-value that is reached with probability `power`. `averaged_log_p` averages these p-values over
    the hypotheses. `threshold` is the largest log p that passes; `others` has the log p of the
    other axes.
    """
    fit, without = (training_fit.fit(e, axis) for e in effects[:2])
    q, scale = fit.theta.shape[1] - without.theta.shape[1], fit.scale[:, None, None]
    gain = chi_square_drop(training_fit, effects, axis, added)[:, None]
    square = np.maximum(sizes**2 * gain / scale, LEAST)
    grid = np.geomspace(LEAST, max(square.max(), 2 * LEAST), GRID)
    lowest = np.interp(np.log(square), np.log(grid), ncfdtri(q, fit.dof, grid, 1 - power))
    rest = (without.log_weight + without.loss)[:, None, None]
    one = replace(without, square=fit.square[:, None, None] + q * scale * lowest)
    one = replace(one, log_weight=rest - one.loss)
    weight = np.broadcast_to(fit.log_weight[:, None, None], square.shape)
    wide = replace(fit, square=fit.square[:, None, None], log_weight=weight)
    return fisher([averaged_log_p(one, wide, q), *others]) < threshold


def lowers_error(search, training_fit, effects, axis, added, sizes, quantile):
    """Return which sizes of added columns, (s, q) of bool, lower the held-out error.

    A size s counts if the confidence interval of the error ratio would lie below one.

    - e, variance v: the held-out error of a row that the noise alone gives.
    - ``e + s c``: the error of a model without the pattern; c is the held-out part of the column.
    - ``e + s C - d δ``: the error of a model with it; C is what the pattern leaves of c, d the
      held-out part of the pattern's columns, δ the error of their coefficients, V its covariance.

    The expected sums of squares over fold k, without the pattern and with it, are

        B_k = Σ (v + s² c²),    A_k = Σ (v + s² C² + d V dᵀ).

    The variance of their difference is ``Σ 4 v (s² (c - C)² + d V dᵀ)``. From these sums follow the
    ratio ``√(A/B)`` over all folds and its jackknife error. `quantile` is the number of standard
    deviations by which the ratio may vary, from the wanted power.
    """
    problem, evidence = search.problem, training_fit.evidence
    groups, folds = evidence.row_groups, evidence.row_folds
    fit = training_fit.fit(effects[0], axis)
    h = training_fit.hypothesis(fit)
    shared, own = (evidence.matrix(evidence.columns_of(e, axis)) for e in effects[1:])
    shared = np.column_stack([block_diag(*(g.nuisance for g in groups)), shared])
    weights, scale = block_diag(*(g.noise.precision[h] for g in groups)), fit.scale[h]
    unit = np.broadcast_to(problem.error_scale, len(folds))
    values, design = np.column_stack([evidence.matrix(added), own]), np.column_stack([shared, own])
    q, k = len(added), shared.shape[1]
    before, _ = fold_fits(values, weights, shared, folds)
    after, inverses = fold_fits(values[:, :q], weights, design, folds)
    v, before = scale * evidence.held_out_variance(h) / unit**2, before / unit[:, None]
    c, C, d = before[:, :q], after / unit[:, None], before[:, q:]
    kinds = np.array(problem.rows_by_kind()) & (folds[:, 0] >= 0)
    spread, by_kind = np.zeros(len(folds)), 0.0
    for fold, inverse in inverses.items():
        rows, own = folds[:, 0] == fold, scale * inverse[k:, k:]
        spread[rows] = np.einsum("na,ab,nb->n", d[rows], own, d[rows])
        by_kind = by_kind + np.array([d[rows & kind].T @ d[rows & kind] @ own for kind in kinds])
    # δ adds Σ δᵀ dᵀ d δ to the sum of squares of each kind; `most` is an upper quantile of it
    most = np.trace(by_kind, axis1=1, axis2=2)
    variance = np.maximum(2 * np.einsum("kab,kba->k", by_kind, by_kind), 0.0)
    most = most + quantile * np.sqrt(variance)
    lowers = np.zeros(sizes.shape, dtype=bool)
    if np.any(most > (MARGIN**2 - 1) * (kinds @ v)):
        return lowers
    for j in range(q):
        change = (c[:, j] - C[:, j]) ** 2 / np.where(v > 0, v, 1.0)
        rows = kinds[np.argmax(kinds @ change)]
        cut, noise, square = cut_folds(folds[rows, 0], change[rows]), v[rows], sizes[:, [j]] ** 2
        B = cut @ noise + square * (cut @ c[rows, j] ** 2)
        A = cut @ (noise + spread[rows]) + square * (cut @ C[rows, j] ** 2)
        variance = 4 * (cut @ (noise * spread[rows]))
        variance = variance + 4 * square * (cut @ (noise * (c[rows, j] - C[rows, j]) ** 2))
        lowers[:, j] = is_below_one(A, B, variance, quantile)
    return lowers


def is_below_one(after, before, variance, quantile):
    """Return whether ratios of held-out errors are below one with confidence, (s,) of bool.

    `before` and `after`, (s, folds), are the expected sums of squares of each fold, without and
    with the effect; `variance`, (s, folds), is the variance of their difference. The upper end of
    the 95 % interval has to stay below one if the ratio is `quantile` standard deviations larger.
    """
    n, total = before.shape[1], (after.sum(axis=1), before.sum(axis=1))
    ratio = np.sqrt(total[0] / total[1])
    share = after / total[0][:, None] - before / total[1][:, None]
    random = variance.sum(axis=1) / (total[0] * total[1])
    error = ratio / 2 * np.sqrt(n / (n - 1) * (share**2).sum(axis=1) + random)
    return ratio + stdtrit(n - 1, 0.975) * error + quantile * ratio / 2 * np.sqrt(random) < 1
