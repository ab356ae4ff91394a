"""Detection limits: the least size of an effect that the test and cross-validation would show."""

from dataclasses import dataclass, replace

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
    from expected values, see `AxisTest`. For an effect that slow noise imitates, the noise is
    estimated again with the effect in the data.

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
    problem, effect, limits = search.problem, trial.effect, {}
    training_fit = search.training_fit(base)
    pattern, moved = training_fit.evidence.patterns((effect, effect.moved(BETWEEN)))
    threshold = search.threshold(len(base)) - trial.tries
    # the axes that do not have the parameter show p-values in the middle of chance
    other_log_p = (trial.axes - 1) * [CHANCE]
    for axis, columns in enumerate(moved.columns):
        fit = training_fit.fit((*base, effect), axis) if pattern.columns[axis] else None
        if fit is None:
            continue
        test = AxisTest(training_fit, base, effect, axis, columns, power, threshold, other_log_p)
        # information about each column under the likeliest noise hypothesis
        information = test.chi_square_drop() / fit.scale[:, None]
        information = information[np.argmax(fit.probability)]
        shown = information > 0
        sizes = SIZES[:, None] / np.sqrt(np.where(shown, information, np.inf))
        passes = shown & test.passes(sizes)
        if must_lower_error:
            passes &= test.lowers_error(problem, sizes)
        if problem.is_like_slow_noise(effect):
            for k, column in enumerate(columns):
                column_test, part = replace(test, columns=(column,)), np.s_[:, [k]]
                passes[part] &= column_test.passes_with_slow_noise(
                    problem, sizes[part], passes[part]
                )
        first = first_size(passes)
        for k, index in enumerate(moved.parameters[axis]):
            if first[k] < len(SIZES):
                name = list(effect.parameters)[index]
                limits[name] = float(sizes[first[k], k] / moved.scale[axis][k])
    return {name: limits[name] for name in effect.parameters if name in limits}


def first_size(passes):
    """Return the index of the size from which on all sizes pass, (q,); s if the last one fails.

    `passes`, (s, q) of bool, says which of s increasing sizes of each of q columns pass.
    """
    failing = np.vstack([np.zeros_like(passes[:1]), passes])[::-1]
    return len(passes) - np.argmin(failing, axis=0)


@dataclass(frozen=True)
class AxisTest:
    """The expected test of an effect on one axis, in data that have q columns of known sizes.

    In all methods `sizes`, (s, q), are s sizes of each column, and the data have one column at a
    time. There are h noise hypotheses.
    """

    training_fit: object  # TrainingFit of all rows
    base: tuple  # effects that are in the model already
    effect: object  # the effect that is tested
    axis: int  # index of the axis
    columns: tuple  # numbers of the q columns
    power: float  # probability with which the test has to find the effect
    threshold: float  # largest log p that passes
    other_log_p: list  # log p of the other axes

    @property
    def fits(self):
        """Fit without the effect and Fit with it."""
        extended = (*self.base, self.effect)
        return [self.training_fit.fit(effects, self.axis) for effects in (self.base, extended)]

    def chi_square_drop(self):
        """Return by how much the effect lowers χ² of data that are one column of size one, (h, q).

        The result is χ² without the effect in the model minus χ² with it.
        """
        columns_of, drops = self.training_fit.evidence.columns_of, []
        base, extended = (columns_of(e, self.axis) for e in (self.base, (*self.base, self.effect)))
        columns = (*extended, *self.columns)
        gram = self.training_fit.products(columns, columns)
        for n in (len(base), len(extended)):
            side = gram[:, :n, len(extended) :]
            drops.append((side * np.linalg.solve(gram[:, :n, :n], side)).sum(axis=1))
        return drops[1] - drops[0]

    def passes(self, sizes):
        """Return which sizes pass the test with the wanted power, (s, q) of bool.

        Under each noise hypothesis F has the noncentrality ``size² drop/scale``, with the
        `chi_square_drop`; its lower quantile gives the p-value that is reached with the probability
        `power`. `averaged_log_p` averages these p-values over the hypotheses.
        """
        without, fit = self.fits
        q, scale = without.dof - fit.dof, fit.scale[:, None, None]
        square = np.maximum(sizes**2 * self.chi_square_drop()[:, None] / scale, LEAST)
        grid = np.geomspace(LEAST, max(square.max(), 2 * LEAST), GRID)
        quantiles = ncfdtri(q, fit.dof, grid, 1 - self.power)
        lowest = np.interp(np.log(square), np.log(grid), quantiles)
        # expected fits if F has its lower quantile, (h, s, q)
        chi2 = fit.chi2[:, None, None] + np.zeros_like(square)
        expected, expected_without = (
            replace(f, chi2=x, log_prior=f.log_prior[:, None, None])
            for f, x in ((fit, chi2), (without, chi2 + q * scale * lowest))
        )
        log_p = averaged_log_p(expected_without, expected, q)
        return fisher([log_p, *self.other_log_p]) < self.threshold

    def passes_with_slow_noise(self, problem, sizes, passes):
        """Return which sizes pass if the effect resembles slow noise, (s, 1) of bool.

        Data with such an effect raise the estimate of slow noise. So the noise is estimated again
        from the residuals plus the effect, at `GROWN` times the least size that passes with the
        present noise. `passes`, (s, 1) of bool, are the sizes that pass with the present noise; the
        test has one column.
        """
        first = first_size(passes)[0]
        if first == len(sizes):
            return passes
        evidence = self.training_fit.evidence
        column = evidence.columns[self.columns[0]]
        values = self.training_fit.residuals((*self.base, self.effect), self.axis)
        noise = problem.noise_with(self.base, values + GROWN * sizes[first, 0] * column)
        evidence = evidence.with_noise(noise)
        columns = evidence.add_columns([column])
        test = replace(self, training_fit=evidence.training_fit(), columns=columns)
        return test.passes(sizes)

    def lowers_error(self, problem, sizes):
        """Return which sizes lower the held-out error with confidence, (s, q) of bool.

        A size s counts if the confidence interval of the error ratio would lie below one.

        - e, variance v: the held-out error of a row that the noise alone gives.
        - ``e + s c``: the error of a model without the effect; c is the held-out part of the
          column.
        - ``e + s C - d δ``: the error of a model with it; C is what the effect's pattern leaves of
          c, d the held-out part of the pattern's columns, δ the error of their coefficients, V its
          covariance.

        The expected sums of squares over fold k, without the effect and with it, are

            B_k = Σ (v + s² c²),    A_k = Σ (v + s² C² + d V dᵀ).

        The variance of their difference is ``Σ 4 v (s² (c - C)² + d V dᵀ)``. From these sums follow
        the ratio ``√(A/B)`` over all folds and its jackknife error, see `is_below_one`.
        """
        evidence, quantile = self.training_fit.evidence, ndtri(self.power)
        groups, folds, q = evidence.row_groups, evidence.row_folds, len(self.columns)
        fit = self.fits[1]
        h = self.training_fit.hypothesis(fit)
        scale, weights = fit.scale[h], block_diag(*(g.noise.precision[h] for g in groups))
        base, pattern = (
            evidence.matrix(evidence.columns_of(e, self.axis)) for e in (self.base, (self.effect,))
        )
        base = np.column_stack([block_diag(*(g.nuisance for g in groups)), base])
        columns = evidence.matrix(self.columns)
        unit = np.broadcast_to(problem.error_scale, len(folds))[:, None]
        c, _ = fold_fits(np.column_stack([columns, pattern]), weights, base, folds)
        C, inverses = fold_fits(columns, weights, np.column_stack([base, pattern]), folds)
        c, C, d = c[:, :q] / unit, C / unit, c[:, q:] / unit
        v = scale * evidence.held_out_variance(h) / unit[:, 0] ** 2
        # expected d V dᵀ of each row, and d V summed over the rows of each kind of residual
        kinds = np.array(problem.rows_by_kind()) & (folds[:, 0] >= 0)
        dVd, by_kind = np.zeros(len(folds)), 0.0
        for fold, inverse in inverses.items():
            rows, V = folds[:, 0] == fold, scale * inverse[base.shape[1] :, base.shape[1] :]
            dVd[rows] = np.einsum("na,ab,nb->n", d[rows], V, d[rows])
            by_kind = by_kind + np.array([d[rows & kind].T @ d[rows & kind] @ V for kind in kinds])
        # δ adds Σ δᵀ dᵀ d δ to the sum of squares of each kind; `most` is an upper quantile of it
        variance = np.maximum(2 * np.einsum("kab,kba->k", by_kind, by_kind), 0.0)
        most = np.trace(by_kind, axis1=1, axis2=2) + quantile * np.sqrt(variance)
        lowers = np.zeros(sizes.shape, dtype=bool)
        if np.any(most > (MARGIN**2 - 1) * (kinds @ v)):
            return lowers
        for j in range(q):
            change = (c[:, j] - C[:, j]) ** 2 / np.where(v > 0, v, 1.0)
            # the kind of residual that the effect changes most
            rows = kinds[np.argmax(kinds @ change)]
            cut, noise = cut_folds(folds[rows, 0], change[rows]), v[rows]
            square = sizes[:, [j]] ** 2
            B = cut @ noise + square * (cut @ c[rows, j] ** 2)
            A = cut @ (noise + dVd[rows]) + square * (cut @ C[rows, j] ** 2)
            variance = 4 * (cut @ (noise * dVd[rows]))
            variance = variance + 4 * square * (cut @ (noise * (c[rows, j] - C[rows, j]) ** 2))
            lowers[:, j] = is_below_one(A, B, variance, quantile)
        return lowers


def is_below_one(after, before, variance, quantile):
    """Return whether ratios of held-out errors are below one with confidence, (s,) of bool.

    Parameters
    ----------
    after, before : ndarray, shape (s, folds)
        Expected sums of squares of each fold, with and without the effect, at s sizes.
    variance : ndarray, shape (s, folds)
        Variance of their difference.
    quantile : float
        Number of standard deviations by which the ratio may be larger: the upper end of its 95 %
        interval has to stay below one even then.
    """
    n, total_after, total_before = before.shape[1], after.sum(axis=1), before.sum(axis=1)
    ratio = np.sqrt(total_after / total_before)
    share = after / total_after[:, None] - before / total_before[:, None]
    random = variance.sum(axis=1) / (total_after * total_before)
    error = ratio / 2 * np.sqrt(n / (n - 1) * (share**2).sum(axis=1) + random)
    return ratio + stdtrit(n - 1, 0.975) * error + quantile * ratio / 2 * np.sqrt(random) < 1
