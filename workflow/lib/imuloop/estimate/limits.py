"""Detection limits: the least size of an effect that the test and cross-validation would show.

A row is one scalar residual. A column is the derivative of all rows on one axis with respect to one
parameter of the effect, scaled to length one. The size of a column is the parameter times the norm
of that derivative. A noise hypothesis is one covariance that the noise of the rows may have.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ncfdtri, ndtri, stdtrit

from imuloop.core.fisher import fisher
from imuloop.estimate.axis_fit import averaged_log_p
from imuloop.estimate.held_out import cut_folds, fold_fits
from imuloop.estimate.verdict import MARGIN

# log p-value of an axis on which the effect is zero: the median
CHANCE = np.log(0.5)
# sizes that are tried, in standard errors of the parameter
SIZES = np.geomspace(1.0, 300.0, 250)
# typical factor between a true time constant, or width, and the one of the nearest variant: the
# root mean square of log factors that are uniform up to log 1.3
BETWEEN = 1.3**3**-0.5
# least noncentrality of F on the grid, and the number of grid points
LEAST, GRID = 1.0, 24
# approximate factor by which slow noise raises the limit of an effect that resembles it
GROWN = 4.0


def detection_limits(search, base, trial, power, must_lower_error=True):
    """Return the detection limits of an effect: for each parameter the least size that would show.

    For each limit the data are assumed to have the effect with this one parameter. The time
    constant or width in the data differs by the factor `BETWEEN` from the constant of the tested
    effect, as the true one lies between two values of the grid that is searched. The limit is the
    least of the `SIZES` from which on all meet two conditions: they pass the significance test with
    the probability `power`, and lower the held-out error with confidence. Both are computed from
    expected values, without random data. For an effect that slow noise imitates, the noise is
    estimated again with the effect in the data.

    Parameters
    ----------
    search : Search
        The search for effects in all rows.
    base : tuple of Effect
        Effects that are in the model already.
    trial : Trial
        The significance test of the effect, with the constants that fit best.
    power : float
        Probability with which the test has to find the effect.
    must_lower_error : bool
        Whether the second condition, a lower held-out error, has to be met too. If not, the limits
        come from the significance test alone.

    Returns
    -------
    dict of str to float
        The limits, SI, by name of the parameter. A parameter that no size shows is left out.
    """
    problem, limits = search.problem, {}
    training_fit = search.training_fit(base)
    # patterns of the tested effect, and of the effect that the data are assumed to have
    pattern, in_data = training_fit.evidence.patterns((trial.effect, trial.effect.moved(BETWEEN)))
    for axis, columns in enumerate(in_data.columns):
        fit = training_fit.fit((*base, trial.effect), axis) if pattern.columns[axis] else None
        if fit is None:
            continue
        test = AxisTest(
            training_fit=training_fit,
            base=base,
            trial=trial,
            axis=axis,
            columns=columns,
            power=power,
            # the test multiplies the p-value by the number of variants that were tried
            threshold=search.threshold(len(base)) - trial.log_tries,
        )
        # information about each column under the likeliest noise hypothesis
        information = test.chi_square_drop() / fit.scale[:, None]
        information = information[np.argmax(fit.probability)]
        # a column that the other parameters explain has no information: no size of it passes
        shown = information > 0
        sizes = SIZES[:, None] / np.sqrt(np.where(shown, information, np.inf))
        passes = shown & test.passes(sizes)
        if must_lower_error:
            passes &= test.lowers_error(problem, sizes)
        if problem.is_like_slow_noise(trial.effect):
            for k, column in enumerate(columns):
                column_test, part = replace(test, columns=(column,)), np.s_[:, [k]]
                passes[part] &= column_test.passes_with_slow_noise(
                    problem, sizes[part], passes[part]
                )
        first = first_size(passes)
        for k, index in enumerate(in_data.parameters[axis]):
            if first[k] < len(SIZES):
                name = list(trial.effect.parameters)[index]
                limits[name] = float(sizes[first[k], k] / in_data.scale[axis][k])
    return {name: limits[name] for name in trial.effect.parameters if name in limits}


def first_size(passes):
    """Return for each of q parameters the first size from which on all sizes pass, (q,) of int.

    `passes`, (s, q) of bool, says which of s increasing sizes of each parameter pass a test. The
    result has indices of sizes; by it a detection limit is found. An index is s, beyond the last
    size, if the largest size fails.
    """
    # from the largest size down; the last row, which fails, ends the search for the first failure
    descending = np.vstack([np.zeros_like(passes[:1]), passes])[::-1]
    return len(passes) - np.argmin(descending, axis=0)


@dataclass(frozen=True)
class AxisTest:
    """The expected outcome of the test of an effect on one axis, in data with a known effect.

    The data are assumed to have one of q columns, times its size. A column is the derivative of all
    rows with respect to one parameter, scaled to length one. In all methods `sizes`, (s, q), has s
    increasing sizes of each column. The covariance of the noise is one of h hypotheses.
    """

    training_fit: object  # TrainingFit of all rows
    base: tuple  # effects that are in the model already
    trial: object  # Trial of the effect that is tested
    axis: int  # index of the axis
    columns: tuple  # numbers, in the Evidence, of the q columns that the data may have
    power: float  # probability with which the test has to find the effect
    threshold: float  # largest logarithm of a p-value that passes

    @property
    def fits(self):
        """Two Fits of the axis to all rows, a list: without the tested effect, then with it.

        Both have the effects that are in the model already.
        """
        extended = (*self.base, self.trial.effect)
        return [self.training_fit.fit(effects, self.axis) for effects in (self.base, extended)]

    def chi_square_drop(self):
        """Return by how much χ² falls if the effect is added to the model, (h, q).

        It is χ² of the fit without the effect minus χ² of the fit with it, under each of h noise
        hypotheses. The data are assumed to have no noise and one of q columns at a time, of size
        one. A column is the derivative of all rows with respect to one parameter of the effect in
        the data.
        """
        columns_of, drops = self.training_fit.evidence.columns_of, []
        base, extended = (
            columns_of(e, self.axis) for e in (self.base, (*self.base, self.trial.effect))
        )
        columns = (*extended, *self.columns)
        gram = self.training_fit.products(columns, columns)
        # a fit of the first n columns explains gᵀ G⁻¹ g of χ², with the products g with the data
        for n in (len(base), len(extended)):
            side = gram[:, :n, len(extended) :]
            drops.append((side * np.linalg.solve(gram[:, :n, :n], side)).sum(axis=1))
        return drops[1] - drops[0]

    def passes(self, sizes):
        """Return whether each size passes the significance test often enough, (s, q) of bool.

        `sizes`, (s, q), has s increasing sizes of each of q parameters; the data have one of them
        at a time. A size counts if it passes with the probability `power`. Under each noise
        hypothesis the F statistic of the test has the noncentrality ``size² drop/scale``. Here drop
        is the fall of χ² by the effect at size one (`chi_square_drop`), and scale is the estimated
        factor on the covariance of the noise. F exceeds its lower quantile with the probability
        `power`, so the p-value of this quantile counts. These p-values are averaged over the
        hypotheses. Fisher's method combines the average with one p-value for each other axis: one
        half, the median in data without an effect on that axis.
        """
        without, fit = self.fits
        # number of parameters that the effect adds
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
        # an axis without the parameter counts with its median p-value
        return fisher([log_p, *[CHANCE] * (self.trial.axes - 1)]) < self.threshold

    def passes_with_slow_noise(self, problem, sizes, passes):
        """Return whether sizes of an effect that resembles slow noise pass the significance test.

        The estimate of slow noise is higher in data with such an effect. So the noise is estimated
        again in data with the effect, and the test is repeated. These data are the residuals plus
        the effect, at `GROWN` times the least size that passes with the present noise. The AxisTest
        must have one column: the data have this parameter of the effect alone.

        Parameters
        ----------
        problem : StaticProblem, PoseProblem or MotionProblem
            The rows; its `noise_with` estimates the noise of other residuals.
        sizes : ndarray, shape (s, 1)
            Sizes of the column.
        passes : ndarray of bool, shape (s, 1)
            Whether each size passes with the present noise.

        Returns
        -------
        ndarray of bool, shape (s, 1)
            Whether each size passes with the noise that is estimated again.
        """
        first = first_size(passes)[0]
        if first == len(sizes):
            return passes
        evidence = self.training_fit.evidence
        column = evidence.columns[self.columns[0]]
        values = self.training_fit.residuals((*self.base, self.trial.effect), self.axis)
        noise = problem.noise_with(self.base, values + GROWN * sizes[first, 0] * column)
        evidence = evidence.with_noise(noise)
        columns = evidence.add_columns([column])
        test = replace(self, training_fit=evidence.training_fit(), columns=columns)
        return test.passes(sizes)

    def lowers_error(self, problem, sizes):
        """Return which sizes lower the held-out error with confidence, (s, q) of bool.

        `sizes`, (s, q), has s increasing sizes of each of q parameters; the data have one of them
        at a time. A size counts if the effect, added to the model, is expected to lower the
        held-out error: the 95 % interval of the ratio, error with the effect over error without it,
        then lies below one. The data have z times the column x, the derivative of all rows (scalar
        residuals) with respect to one parameter of the effect; z is the size. A row is predicted by
        a fit to the rows of other folds; its held-out error is

        - e, with the variance v, by the noise alone;
        - ``e + z c`` without the effect in the model, where c is the held-out error of x;
        - ``e + z C - d δ`` with the effect in the model, where C is the held-out error of x in a
          fit that has the effect's columns. d are the held-out errors of these columns without the
          effect in the model, and δ is the error of their coefficients, with the covariance V.

        The expected sums of squares over fold k, without the effect and with it, are

            B_k = Σ (v + z² c²),    A_k = Σ (v + z² C² + d V dᵀ).

        The variance of their difference is ``Σ 4 v (z² (c - C)² + d V dᵀ)``. From these sums follow
        the ratio ``√(A/B)`` over all folds and its jackknife error. They have only the rows of one
        kind of residual, the one that the effect changes most.

        Exception: no size counts if the errors δ alone may make the held-out error of some kind of
        residual more than `MARGIN` times the error by noise alone. The verdict could then be
        ``partly_explained`` even with the right effect.

        `problem` is the StaticProblem, PoseProblem or MotionProblem; it gives the unit of the
        errors and the kinds of residuals.
        """
        evidence, quantile = self.training_fit.evidence, ndtri(self.power)
        groups, folds, q = evidence.row_groups, evidence.row_folds, len(self.columns)
        fit = self.fits[1]
        h = self.training_fit.hypothesis(fit)
        # h is the likeliest noise hypothesis, `scale` the estimated factor on its covariance, and
        # `weights` the inverse of that covariance
        scale, weights = fit.scale[h], block_diag(*(g.noise.precision[h] for g in groups))
        base, pattern = (
            evidence.matrix(evidence.columns_of(e, self.axis))
            for e in (self.base, (self.trial.effect,))
        )
        # the model without the effect: nuisance parameters, which are in every fit, and the base
        base = np.column_stack([block_diag(*(g.nuisance for g in groups)), base])
        columns = evidence.matrix(self.columns)
        unit = np.broadcast_to(problem.error_scale, len(folds))[:, None]
        # held-out errors of the columns, in units that make all kinds of residuals comparable
        values, design = np.column_stack([columns, pattern]), np.column_stack([base, pattern])
        counts = base.shape[1], design.shape[1]
        (c, _), (C, inverses) = fold_fits(values, weights, design, folds, counts)
        c, C, d = c[:, :q] / unit, C[:, :q] / unit, c[:, q:] / unit
        v = scale * evidence.held_out_variance(h) / unit[:, 0] ** 2
        # expected d V dᵀ of each row, and d V summed over the rows of each kind of residual
        kinds = np.array([problem.of_kind(kind) for kind in problem.kinds]) & (folds[:, 0] >= 0)
        dVd, by_kind = np.zeros(len(folds)), 0.0
        for fold, inverse in inverses.items():
            rows, V = folds[:, 0] == fold, scale * inverse[base.shape[1] :, base.shape[1] :]
            dVd[rows] = np.einsum("na,ab,nb->n", d[rows], V, d[rows])
            by_kind = by_kind + np.array([d[rows & kind].T @ d[rows & kind] @ V for kind in kinds])
        # δ adds Σ δᵀ dᵀ d δ to the sum of squares of each kind; `most` is an upper quantile of it
        variance = np.maximum(2 * np.einsum("kab,kba->k", by_kind, by_kind), 0.0)
        most = np.trace(by_kind, axis1=1, axis2=2) + quantile * np.sqrt(variance)
        lowers = np.zeros(sizes.shape, dtype=bool)
        # the error of the coefficients alone may put the held-out error too far above its floor
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

    A ratio is ``√(A/B)``, with the sums of squares A with an effect in the model and B without it,
    over all folds. The standard error of a ratio comes from the scatter between folds, as in a
    jackknife, and from the noise.

    Parameters
    ----------
    after, before : ndarray, shape (s, folds)
        Expected sums of squares A and B of the held-out errors in each fold, at s sizes of the
        effect in the data.
    variance : ndarray, shape (s, folds)
        Variance, by the noise, of the difference of `after` and `before`.
    quantile : float
        Number of standard deviations by which the noise may make the ratio larger than expected. A
        ratio passes if the upper end of its 95 % interval is below one even then.
    """
    n, total_after, total_before = before.shape[1], after.sum(axis=1), before.sum(axis=1)
    ratio = np.sqrt(total_after / total_before)
    share = after / total_after[:, None] - before / total_before[:, None]
    by_noise = variance.sum(axis=1) / (total_after * total_before)
    error = ratio / 2 * np.sqrt(n / (n - 1) * (share**2).sum(axis=1) + by_noise)
    return ratio + stdtrit(n - 1, 0.975) * error + quantile * ratio / 2 * np.sqrt(by_noise) < 1
