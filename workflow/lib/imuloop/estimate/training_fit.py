"""The fit to training rows: generalised least squares under every noise hypothesis.

A row is one scalar residual. A noise hypothesis is one of h covariances that the noise of the rows
may have. A column is the derivative of all rows with respect to one parameter of an effect, on one
axis. Nuisance parameters, as the level of each record, are in every fit. A fold has the rows that
cross-validation holds out together; the training rows are all others.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dtrtri

from imuloop.estimate.axis_fit import Fit, scaled_inverse

# a column counts as linearly independent of other columns if more than this share of its square
# remains after the projection onto the others
ABSORBED = 1e-6
# share of a column's square that rounding alone may leave
ROUNDING = 1e-12


@dataclass
class TrainingFit:
    """Least squares of the training rows, which are all rows outside the held-out folds.

    A row is one scalar residual; a fold has the rows that cross-validation holds out together.
    Nuisance parameters are in every fit, so they are projected out first. P̃ is the inverse of the
    covariance of the training rows after this projection. A column is the derivative of all rows by
    one parameter. All products of two columns x and y use P̃: in a group of rows with precision P,
    the inverse covariance, ``xᵀ P̃ y = xᵀ P y - t_x·t_y``. The vectors t_x and t_y, (u,), are
    called the corrections of x and y. Corrections and fits are stored, so that each is computed
    once.

    Shapes: h noise hypotheses, n rows of a group, N rows of all groups, k columns, and u parameters
    that are projected out: one for each held-out row, and the nuisance parameters.
    """

    evidence: object  # the Evidence with all rows
    held_rows: tuple  # for each group, indices of the rows that depend on a held-out fold
    # by number of a column: its corrections, (h, u) for each group of rows, and its square under
    # the first hypothesis, before the nuisance parameters are projected out
    _columns: dict = field(default_factory=dict)
    _fits: dict = field(default_factory=dict)
    # by group and hypothesis: information about a step before each row, (n,)
    _steps: dict = field(default_factory=dict)

    @cached_property
    def _roots(self):
        """The matrix R, (h, u, u), of each group of rows, upper triangular: ``R Rᵀ = (Uᵀ P U)⁻¹``.

        R projects u columns out of the n rows of the group; U, (n, u), has these columns. First, U
        has a unit vector for each held-out row: a row with its own parameter has no influence. Then
        U has the derivative of the rows with respect to the nuisance parameters. P, (n, n), is the
        inverse of the covariance of the rows under each of h noise hypotheses.
        """
        roots, evidence = [], self.evidence
        groups = zip(evidence.row_groups, evidence.weighted_nuisance, self.held_rows, strict=True)
        for group, weighted_nuisance, held_rows in groups:
            if not np.all(np.any(np.delete(group.nuisance, held_rows, axis=0), axis=0)):
                raise np.linalg.LinAlgError("a parameter that nothing seen depends on")
            # Uᵀ P U in blocks: held-out rows first, nuisance parameters last
            normal = group.noise.precision[:, held_rows[:, None], held_rows]
            mixed, corner = weighted_nuisance[:, held_rows], group.nuisance.T @ weighted_nuisance
            below = np.concatenate([np.swapaxes(mixed, 1, 2), corner], axis=2)
            normal = np.concatenate([np.concatenate([normal, mixed], axis=2), below], axis=1)
            size = np.sqrt(np.einsum("huu->hu", normal))
            lower = np.linalg.cholesky(normal / size[:, :, None] / size[:, None])
            # the transposed inverse of each lower triangle; the diagonal was scaled to one
            root = np.array([dtrtri(triangle.T)[0] for triangle in lower])
            roots.append(root / size[:, :, None])
        return roots

    @cached_property
    def free_rows(self):
        """Number of training rows, which are not held out, minus number of nuisance parameters.

        These are the degrees of freedom of a fit without effects.
        """
        nuisances = sum(group.nuisance.shape[1] for group in self.evidence.row_groups)
        return len(self.evidence.row_folds) - sum(map(len, self.held_rows)) - nuisances

    @cached_property
    def log_det(self):
        """The sum ``log|Σ| + log|Nᵀ Σ⁻¹ N|``, (h,); minus half of it is in the log likelihood.

        The likelihood is the restricted one, with the nuisance parameters integrated out. Σ is the
        covariance of the training rows, which are not held out, under each of h noise hypotheses. N
        is the derivative of these rows with respect to the nuisance parameters. The sum equals
        ``log|Σ_all| + log|Uᵀ P U|`` with the covariance Σ_all of all rows and its inverse P. U has
        this derivative for all rows, and a unit vector for each held-out row.
        """
        groups = zip(self.evidence.row_groups, self._roots, strict=True)
        diagonals = ((g, np.einsum("huu->hu", root)) for g, root in groups)
        return sum(g.noise.log_det - 2 * np.log(diagonal).sum(axis=1) for g, diagonal in diagonals)

    def products(self, first, second):
        """Return the products ``Yᵀ P̃ Z``, (h, k, m), of columns Y and Z under h noise hypotheses.

        `first` has the numbers, in the Evidence, of the k columns Y, and `second` has the numbers
        of the m columns Z. A fit is computed from such products. P̃ is the precision, the inverse
        covariance, of the training rows after the nuisance parameters are projected out. A product
        is the sum of ``Yᵀ P Z - (Uᵀ P Y)ᵀ (Uᵀ P U)⁻¹ (Uᵀ P Z)`` over all groups of rows. P is the
        precision of all rows of a group. U has a unit vector for each held-out row, and the
        derivative of the rows with respect to the nuisance parameters.
        """
        self._add_columns((*first, *second))
        total, by_group = 0.0, self.evidence.split(self.evidence.matrix(second))
        for i, z in enumerate(by_group):
            removed = self.corrections(i, first) @ np.swapaxes(self.corrections(i, second), 1, 2)
            total = total + self.evidence.weighted_columns(i, first) @ z - removed
        return total

    def _products_in_sets(self, sets):
        """Return the products ``Zᵀ P̃ Z`` of the columns within each of s sets, (h, s, q, q).

        Z are the q columns of a set. `sets`, (s, q), has their numbers in the Evidence. P̃ is the
        precision, the inverse covariance, of the training rows after the nuisance parameters are
        projected out, under each of h noise hypotheses.
        """
        columns, total = tuple(sets.ravel().tolist()), 0.0
        self._add_columns(columns)
        for i, z in enumerate(self.evidence.split(self.evidence.matrix(columns))):
            weighted, t = self.evidence.weighted_columns(i, columns), self.corrections(i, columns)
            weighted, t = (x.reshape(len(x), *sets.shape, -1) for x in (weighted, t))
            total = total + weighted @ z.T.reshape(*sets.shape, -1).swapaxes(1, 2)
            total = total - t @ np.swapaxes(t, 2, 3)
        return total

    def corrections(self, i, columns):
        """Return the stored corrections of k columns in the row group with index `i`, (h, k, u).

        The correction of a column x is the vector t_x with ``xᵀ P̃ y = xᵀ P y - t_x·t_y``, where P
        is the precision of the rows, and P̃ the precision after u parameters are projected out,
        under each of h noise hypotheses. `columns` are the numbers of the columns, whose
        corrections were stored before.
        """
        return np.array([self._columns[c][0][i] for c in columns]).swapaxes(0, 1)

    def _add_columns(self, columns):
        """Compute and store the correction and the square of each column that has none yet.

        `columns` are numbers of columns in the Evidence. P is the precision of all rows, and P̃ the
        precision of the training rows after the nuisance parameters are projected out.

        - The correction of a column x is the vector t with ``xᵀ P̃ x = xᵀ P x - |t|²``.
        - The square of x is ``xᵀ P x`` minus the part of |t|² by the held-out rows, under the first
          noise hypothesis. A fit compares it with the square that remains of x after the nuisance
          parameters and other columns are projected out: x counts as linearly dependent on them if
          less than the share `ABSORBED` remains. Exception: the square is infinite, so that x
          counts as dependent, if x is zero in all training rows except for rounding errors.
        """
        new = [c for c in dict.fromkeys(columns) if c not in self._columns]
        if not new:
            return
        by_group, squares, all_squares = [], 0.0, 0.0
        for i, z in enumerate(self.evidence.split(self.evidence.matrix(new))):
            weighted, held_rows = self.evidence.weighted_columns(i, new), self.held_rows[i]
            t = self.correction(i, slice(None), weighted)
            square = np.einsum("kn,nk->k", weighted[0], z)
            all_squares = all_squares + square
            squares = squares + square - (t[0, :, : len(held_rows)] ** 2).sum(axis=1)
            by_group.append(t)
        # a column that is zero in all training rows has a square of rounding errors only: with an
        # infinite square it counts as dependent
        squares = np.where(squares > ROUNDING * all_squares, squares, np.inf)
        for k, column in enumerate(new):
            self._columns[column] = [t[:, k] for t in by_group], squares[k]

    def release(self):
        """Delete the stored fits and products, to free memory; they are recomputed if needed."""
        self._fits.clear()
        self._columns.clear()

    def apply_precision(self, i, hypothesis, columns):
        """Return ``P̃ X``, (n, k), for k columns X in the n rows of one group.

        P̃ is the precision, the inverse covariance, of the training rows after the nuisance
        parameters are projected out. `i` is the index of the group, `hypothesis` the index of the
        noise hypothesis, and `columns` are X, (n, k). Held-out rows of the result are zero.
        """
        precision = self.evidence.row_groups[i].noise.precision[hypothesis]
        held_rows = self.held_rows[i]
        result = precision @ columns
        fitted = self._roots[i][hypothesis] @ self.correction(i, hypothesis, result.T).T
        result -= precision[:, held_rows] @ fitted[: len(held_rows)]
        result -= self.evidence.weighted_nuisance[i][hypothesis] @ fitted[len(held_rows) :]
        result[held_rows] = 0.0
        return result

    def correction(self, i, hypothesis, weighted):
        """Return the corrections ``t = xᵀ P U R``, (..., u), of columns x in one group of n rows.

        With them ``xᵀ P̃ y = xᵀ P y - t_x·t_y``, where P̃ is the precision, the inverse covariance,
        of the training rows after u parameters are projected out. P is the precision of all n rows,
        U has the u columns that are projected out, and ``R Rᵀ = (Uᵀ P U)⁻¹``. `i` is the index of
        the group and `weighted`, (..., n), has the products ``xᵀ P``. `hypothesis` is the index of
        one noise hypothesis, or a slice of all.
        """
        nuisance = self.evidence.row_groups[i].nuisance
        side = np.concatenate([weighted[..., self.held_rows[i]], weighted @ nuisance], axis=-1)
        return side @ self._roots[i][hypothesis]

    def step_information(self, i, hypothesis):
        """Return how well n rows of a group would show a step before each of them, (n,).

        An entry is the Fisher information about the size of a step, the inverse of the variance
        with which a fit would estimate it. It is ``xᵀ P̃ x`` for the column x, which is zero before
        the step and one after it. P̃ is the precision of the training rows after the nuisance
        parameters are projected out. `i` is the index of the group of rows, and `hypothesis` the
        index of the noise hypothesis.
        """
        if (i, hypothesis) not in self._steps:
            precision = self.evidence.row_groups[i].noise.precision[hypothesis]
            # the sum over all rows from row k on is the product with a step before row k
            weighted = precision[::-1].cumsum(axis=0)[::-1]
            removed = (self.correction(i, hypothesis, weighted) ** 2).sum(axis=1)
            self._steps[i, hypothesis] = np.triu(weighted).sum(axis=1) - removed
        return self._steps[i, hypothesis]

    def fit(self, effects, axis):
        """Return the Fit of a model with some `effects` to the training rows on one axis, or None.

        `axis` is the index of the axis. The effects have columns there: derivatives with respect to
        their parameters. The result is None if the columns are linearly dependent, or if there are
        as many columns as rows.
        """
        key = tuple(effects)
        if key not in self._fits:
            self._fits[key] = [fit for (fit,) in self.fits(effects, [()])]
        return self._fits[key][axis]

    def fits(self, base, additions):
        """Return the fits of the base effects together with each of several additions.

        Parameters
        ----------
        base : tuple of Effect
            Effects that are in the model already and in every fit.
        additions : list of tuple of Effect
            For each fit the effects that it has in addition.

        Returns
        -------
        list of list of Fit or None
            For each axis a list with an entry for each tuple in `additions`. The entry is None if
            the derivatives with respect to the parameters of the effects (columns) are linearly
            dependent, or if there are as many columns as rows.
        """
        axes, columns_of = range(len(self.evidence.residual_columns)), self.evidence.columns_of
        # by the base's columns and the number q of further columns: for each set of further columns
        # the fits that have it, as (axis, index of the addition)
        fits, groups = [[None] * len(additions) for _ in axes], {}
        for axis in axes:
            shared = columns_of(base, axis)
            for k, effects in enumerate(additions):
                added = columns_of(effects, axis)
                groups.setdefault((shared, len(added)), {}).setdefault(added, []).append((axis, k))
        for (shared, count), indices_by_set in groups.items():
            # axes that have the same columns share the products of these columns
            sets = np.reshape(list(indices_by_set), (len(indices_by_set), count)).astype(int)
            by_set = zip(self._fit(shared, sets), indices_by_set.values(), strict=True)
            for by_axis, indices in by_set:
                # without a fit of these columns, `by_axis` is None
                for axis, k in indices:
                    fits[axis][k] = by_axis and by_axis[axis]
        return fits

    def _fit(self, shared, sets):
        """Return fits of columns that are in every fit, with each of s sets of further columns.

        A column is the derivative of all rows on one axis by one parameter of an effect. The
        Evidence stores it under a number.

        Parameters
        ----------
        shared : tuple of int
            Numbers of the columns in every fit.
        sets : ndarray, shape (s, q) of int
            Numbers of the q further columns of each set.

        Returns
        -------
        list of list of Fit, or None
            For each set a Fit to the residuals of each axis; None if the columns of the fit are
            linearly dependent, or as many as the rows.
        """
        # number of axes, of sets, of further columns, and of all columns of a fit
        axes, (count, q) = len(self.evidence.residual_columns), sets.shape
        k = len(shared) + q
        dof = self.free_rows - k
        if dof < 1:
            return [None] * count
        # products of residuals, shared columns and the columns of each set, (h, s, a + k, a + k)
        common = (*self.evidence.residual_columns, *shared)
        products, c = self.products(common, (*common, *sets.ravel().tolist())), len(common)
        gram = np.empty((len(products), count, c + q, c + q))
        gram[:, :, :c, :c] = products[:, None, :, :c]
        gram[:, :, :c, c:] = products[:, :, c:].reshape(len(products), c, count, q).swapaxes(1, 2)
        gram[:, :, c:, :c] = gram[:, :, :c, c:].swapaxes(2, 3)
        if q:
            gram[:, :, c:, c:] = self._products_in_sets(sets)
        # normal matrix, (h, s, k, k), right-hand sides, (h, s, k, a), and χ² without columns
        normal, moment = gram[:, :, axes:, axes:], gram[:, :, axes:, :axes]
        total = np.einsum("hsaa->hsa", gram[:, :, :axes, :axes])
        # dependent columns, and a nearly singular matrix, give no fit
        squares = np.array(
            [[self._columns[c][1] for c in (*shared, *row)] for row in sets.tolist()]
        )
        norms = np.sqrt(np.maximum(np.einsum("hskk->hsk", normal), 0.0))
        independent = np.all(norms[0] ** 2 > ABSORBED * squares.reshape(count, k), axis=1)
        norms = np.where(norms > 0, norms, 1.0)
        normal, moment = normal / norms[..., None] / norms[:, :, None], moment / norms[..., None]
        independent &= np.linalg.eigvalsh(normal[0]).min(axis=1, initial=1.0) > ABSORBED
        # a singular matrix is replaced, so that the others can be solved with it
        normal[:, ~independent] = np.eye(k)
        scaled = np.linalg.solve(normal, moment)
        chi2 = np.maximum(total - (scaled * moment).sum(axis=2), 1e-12 * total)
        coefficients = scaled / norms[..., None]
        log_det = np.linalg.slogdet(normal)[1] + 2 * np.log(norms).sum(axis=2)
        log_prior = (self.evidence.log_prior - self.log_det / 2)[:, None] - log_det / 2
        fits = [None] * count
        for s in np.flatnonzero(independent):
            # all axes have the same columns
            fits[s] = [
                Fit(
                    chi2=chi2[:, s, a],
                    log_prior=log_prior[:, s],
                    dof=dof,
                    least_scale=self.evidence.least_scale,
                    normal=normal[:, s],
                    norms=norms[:, s],
                    coefficients=coefficients[:, s, :, a],
                )
                for a in range(axes)
            ]
        return fits

    def hypothesis(self, fit):
        """Return the index of the noise hypothesis under which parameters are estimated.

        A noise hypothesis is one covariance that the noise may have. The result is the likeliest,
        by the Fit `fit`, of the hypotheses that estimates may use (`Evidence.estimation_mask`).
        """
        allowed = np.where(self.evidence.estimation_mask, fit.log_probability, -np.inf)
        return int(np.argmax(allowed))

    def solve(self, effects, axis):
        """Return all parameters of a fit on one axis: nuisance parameters, then coefficients.

        `axis` is the index of the axis. A column is the derivative of all rows (scalar residuals)
        with respect to one parameter of an effect.

        Returns
        -------
        list of ndarray, shape (p,)
            For each group of rows its p nuisance parameters, which are in every fit.
        ndarray, shape (k,)
            The coefficients of the k columns that `effects` have on the axis. They are zero if the
            columns are linearly dependent.
        """
        fit, columns = self.fit(effects, axis), self.evidence.columns_of(effects, axis)
        if fit is None and columns:
            return self.solve((), axis)[0], np.zeros(len(columns))
        if fit is None:
            raise np.linalg.LinAlgError("fewer rows are seen than parameters")
        hypothesis = self.hypothesis(fit)
        index = self.evidence.nuisance_index
        # by default the hypothesis of the coefficients also estimates the nuisance parameters
        index = hypothesis if index is None else index
        coefficients, nuisances = fit.coefficients[hypothesis], []
        for i, (root, held_rows) in enumerate(zip(self._roots, self.held_rows, strict=True)):
            # corrections t of the residuals and of the columns: ``R t`` are the projected-out
            # parameters of a fit to the residuals, or to a column
            t = self.corrections(i, (self.evidence.residual_columns[axis], *columns))[index]
            # the first parameters that are projected out belong to the held-out rows
            nuisances.append((root[index] @ (t[0] - coefficients @ t[1:]))[len(held_rows) :])
        return nuisances, coefficients

    def residuals(self, effects, axis):
        """Return the residuals of all N rows on one axis, (N,), SI, by a model with some `effects`.

        A row is one scalar residual. The model is fitted to the training rows alone, so the
        residuals of the other rows are held-out errors. `axis` is the index of the axis.
        """
        nuisances, coefficients = self.solve(effects, axis)
        groups = zip(self.evidence.row_groups, nuisances, strict=True)
        fitted = np.concatenate([g.nuisance @ nuisance for g, nuisance in groups])
        columns = self.evidence.matrix(self.evidence.columns_of(effects, axis))
        return (
            self.evidence.columns[self.evidence.residual_columns[axis]]
            - fitted
            - columns @ coefficients
        )

    def estimate(self, effects, axis):
        """Return the coefficients of k columns, (k,), and their covariance, (k, k).

        The columns are the derivatives of the rows with respect to the parameters of the `effects`,
        on the axis with the index `axis`. The coefficients are estimated with the weights P̃, under
        the likeliest noise hypothesis that estimates may use. P̃ is the precision of the training
        rows after the nuisance parameters are projected out. The covariance of the coefficients is
        ``A⁻¹ Zᵀ P̃ Σ P̃ Z A⁻¹``, with the columns Z, ``A = Zᵀ P̃ Z`` and the noise covariance Σ
        averaged over all hypotheses. Both results are None if the columns are linearly dependent,
        and zero if all residuals of the axis are zero.
        """
        fit, columns = self.fit(effects, axis), self.evidence.columns_of(effects, axis)
        if fit is None:
            return None, None
        if not fit.scale.any():
            # all residuals of the axis are zero, so the coefficients are exactly zero
            return np.zeros(len(columns)), np.zeros((len(columns), len(columns)))
        information, variance = self.moments(fit, self.evidence.matrix(columns))
        inverse = scaled_inverse(information)
        return fit.coefficients[self.hypothesis(fit)], inverse @ variance @ inverse

    def moments(self, fit, columns):
        """Return the information about the coefficients of k columns Z, and its variance by noise.

        The information is ``Zᵀ P̃ Z``, (k, k). The variance is ``Zᵀ P̃ Σ P̃ Z``, (k, k): the
        covariance of the products ``Zᵀ P̃ r`` if r is noise. `columns` are Z, (N, k). P̃ is the
        precision of the training rows after the nuisance parameters are projected out. It belongs
        to one noise hypothesis, which the Fit `fit` selects (see `hypothesis`). The noise
        covariance Σ is averaged over all hypotheses.
        """
        hypothesis, information, variance = self.hypothesis(fit), 0.0, 0.0
        for i, z in enumerate(self.evidence.split(columns)):
            weighted = self.apply_precision(i, hypothesis, z)
            noise = self.evidence.row_groups[i].noise.weighted_sum(fit.probability * fit.scale)
            information = information + z.T @ weighted
            variance = variance + weighted.T @ noise @ weighted
        return information, variance
