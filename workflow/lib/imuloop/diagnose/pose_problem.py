"""The problem of the poses of a device and the rotations between them: rows, folds and noise."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from imuloop.diagnose.pose_linearization import Linearization, kind_hypotheses
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.steps import Steps
from imuloop.estimate.evidence import Evidence, Hypotheses, RowGroup
from imuloop.estimate.joint_fit import append_prior
from imuloop.estimate.noise_components import SizeLikelihood
from imuloop.estimate.training_fit import ABSORBED
from imuloop.factors.factors import OF_SENSOR

# rise of the log likelihood at which the estimate of the noise for a detection limit ends
ROUGH = 0.05
# number of effects whose derivatives are computed at once
BATCH_SIZE = 32


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """The poses of a device, as a problem for `imuloop.estimate.choice.Choices`.

    A row is one component of a residual of a pose or of a rotation between two poses. All N rows
    are one group, since their noise is correlated; the last ones are rows of a prior. The nuisance
    parameters are the base model and the effects that other records showed.
    """

    joint_fit: object  # JointFit
    recording: object  # Recording
    variants: dict  # variants to try, a tuple for each kind of effect
    settings: DiagnoseSettings
    tests: int  # number of tests that share the significance
    # (n,): fold of each pose, or of each move in a MotionProblem; -1 is no fold
    fold_of_pose: np.ndarray
    nuisance_effects: tuple = ()  # effects that other records showed; every fit estimates them
    # StaticResult of the static records; None if no static record counts. The method `information`
    # takes effects and returns the Fisher information A and the moment b of their parameters θ: the
    # logarithm of the likelihood of θ is ``-θᵀ A θ/2 + bᵀ θ``
    static: object = None
    # for kinds of effects with too many variants for a list: the function that finds the best one
    scans: dict = field(default_factory=dict)
    _fits: dict = field(default_factory=dict, repr=False)
    _columns: dict = field(default_factory=dict, repr=False)
    # whether a scan is repeated after an effect was added. It is, since the turns show the steps of
    # both sensors
    scans_again = True
    error_scale = 1.0  # unit of the held-out errors in the error ratio
    why_no_trial = "what it adds in these data is taken up by the base model"

    @cached_property
    def folds(self):
        """Number of folds: groups of poses, of which cross-validation holds out one at a time."""
        return int(self.fold_of_pose.max()) + 1

    @cached_property
    def static_rows(self):
        """Knowledge from static records, long rests, about effects, as rows ``R θ - z`` of a prior.

        θ are the parameters of all effects that static records can show. Each of the s components
        of ``R θ - z`` has mean 0 and variance 1. The value has two parts. The first is a dict: for
        each effect, the columns of R that belong to its q parameters, (s, q). The second is z,
        (s,). The logarithm of the likelihood of θ by the static records is ``-θᵀ A θ/2 + bᵀ θ``,
        with ``A = Rᵀ R`` and ``b = Rᵀ z``.
        """
        if self.static is None:
            return {}, np.zeros(0)
        # static records have too few attitudes to show formulas
        named = (variants for kind, variants in self.variants.items() if not kind.is_formula)
        effects = self.nuisance_effects + tuple(
            s for variants in named for s in variants if "temperature" in s.needs and not s.timed
        )
        information, moment = self.static.information(effects)
        # parameters have different units: each is scaled so that its information is one
        size = np.sqrt(np.maximum(np.diag(information), 0.0))
        size[size == 0] = 1.0
        # one row for each direction about which there is information
        values, axes = np.linalg.eigh(information / np.outer(size, size))
        shown = values > ABSORBED * max(values.max(initial=0.0), ABSORBED)
        roots, axes = np.sqrt(values[shown]), axes[:, shown].T
        rows = roots[:, None] * axes * size
        return split_by_effect(rows, effects), axes @ (moment / size) / roots

    def prior(self, effects):
        """Return the prior of a fit as R, (k, p), and z, (k,): ``R x - z`` is near zero.

        x are the p parameters of the fit. Before the fit, each of the k components of ``R x - z``
        has mean 0 and variance 1. The first components are the prior of the base model. The last
        ones hold the knowledge from static records about the parameters of `effects`.
        """
        (R_base, z_base), (R_by_effect, z) = self.joint_fit.prior_rows, self.static_rows
        R = [R_by_effect.get(e, np.zeros((len(z), len(e.parameters)))) for e in effects]
        R = np.hstack([np.zeros((len(z), 0)), *R])
        return block_diag(R_base, R), np.append(z_base, z)

    @cached_property
    def rows(self):
        """First and last pose of each row, (n, 2) of int, and the kind of each row, (N,) of str.

        A row is one component of a residual. The first array covers the n rows of poses and moves.
        The row of a pose has the index of this pose twice, the row of a move has the indices of the
        poses at its ends. The second array has the kind of residual of each row. The other N - n
        rows come last and belong to the prior: their kind is an empty string.
        """
        ends, kind = self.joint_fit.rows(self.recording)
        return ends, np.append(kind, np.full(len(self.prior(())[1]), ""))

    @cached_property
    def row_folds(self):
        """Folds of the first and the last pose of each row, (N, 2), one column for each.

        A row is one component of a residual of a pose or of a move between two poses. A fold has
        the poses that cross-validation holds out together; it has a number. A row of the prior has
        no pose; it has -1 in both columns, which stands for no fold.
        """
        folds, kind = self.fold_of_pose[self.rows[0]], self.rows[1]
        return np.pad(folds, ((0, len(kind) - len(folds)), (0, 0)), constant_values=-1)

    @property
    def fold_of_row(self):
        """Fold that each of N rows is held out with, (N,): the fold of its first pose, or -1.

        A row is one component of a residual; -1 stands for no fold.
        """
        return self.row_folds[:, 0]

    def residuals(self, search, effects):
        """Return the residuals of all N rows, (N, 1), by a fit of `effects` to the training rows.

        A row is one component of a residual; the second axis is the single axis of this problem.
        `search` is the Search, which says which rows are training rows and which are held out.
        Held-out rows next to a step of the bias are nan: the training poses do not show on which
        side of the step they are.
        """
        residuals = search.training_fit(effects).residuals(effects, 0)
        for effect in effects:
            if effect.name == Steps.name:
                residuals[self._rows_next_to_step(effect, search.held_out)] = np.nan
        return residuals[:, None]

    def _rows_next_to_step(self, effect, held_out):
        """Return the indices of held-out rows that a step leaves uncertain.

        `effect` is the step, a SensorEffect: the bias of a sensor changes at one time. The training
        poses show only that the step lies between the last training pose before it and the first
        one after it. A held-out pose between these two may lie on either side of the step, so the
        rows that depend on this pose cannot be predicted. `held_out` has the numbers of the
        held-out folds.
        """
        is_held_out, poses_of_row = np.isin(self.fold_of_pose, list(held_out)), self.rows[0]
        after = self.recording.poses.mid_s > effect.effect.times[0]
        # training poses on either side of the step, and the held-out poses between them
        number = np.arange(len(after))
        last = number[~is_held_out & ~after].max(initial=-1)
        first = number[~is_held_out & after].min(initial=len(after))
        poses = number[is_held_out & (number > last) & (number < first)]
        # the kinds of residual that depend on this sensor; both sensors enter a rotation
        kinds = ["rotation", *OF_SENSOR[effect.sensor]]
        of_sensor = np.isin(self.rows[1], kinds)[: len(poses_of_row)]
        return np.flatnonzero(of_sensor & np.isin(poses_of_row, poses).any(axis=1))

    def of_kind(self, kind):
        """Return the mask of the rows that belong to the kind of residual `kind`, (N,) of bool."""
        return self.rows[1] == kind

    @property
    def kinds(self):
        """Kinds of residuals, a dict by name: the SI unit and the number of components."""
        return self.joint_fit.kinds

    def with_folds(self, fold_of_pose):
        """Return the PoseProblem with other folds: `fold_of_pose`, (n,), has the fold of each pose.

        The fits of all poses are kept, as they do not depend on folds.
        """
        problem = replace(self, fold_of_pose=fold_of_pose, _fits={})
        for effects, linearization in self._fits.items():
            evidence = linearization.evidence.with_folds(problem.row_folds)
            problem._fits[effects] = replace(linearization, evidence=evidence)
        return problem

    def with_formulas(self, formulas):
        """Return the PoseProblem with formulas as further effects to try, after all others.

        Formulas are products of powers of outputs; they have no known cause. `formulas` has a tuple
        of variants for each kind of effect.
        """
        # the new problem shares the stored fits and derivatives; each kind is one more test
        count = self.tests + self.settings.family * len(formulas)
        return replace(self, variants=self.variants | formulas, tests=count)

    def linearization(self, effects=()):
        """Return the Linearization at the fit of all poses with some `effects`, a tuple.

        It has the residuals, their derivatives and their noise. It is computed once and then
        stored.
        """
        if effects in self._fits:
            return self._fits[effects]
        all_effects = (*self.nuisance_effects, *effects)
        # effects are added one by one: the fit without the last one is near
        start = self.linearization(effects[:-1]).solution.x if effects else None
        prior = self.prior(all_effects)
        solution = self.joint_fit.fit(self.recording, all_effects, start, prior)
        factors = self.joint_fit.linearise(solution, self.recording)
        values, jacobian = append_prior(factors, solution.x, prior)
        fixed, slow, excess = self.joint_fit.noise_components(factors, len(prior[1]))
        likelihood = SizeLikelihood(jacobian, fixed, [*slow, *excess])
        likeliest = likelihood.maximise(values)
        hypotheses, as_estimated = kind_hypotheses([*slow, *excess], likelihood, likeliest)
        # the nuisance parameters are all parameters of the fit without `effects`
        nuisances = jacobian.shape[1] - sum(len(e.parameters) for e in effects)
        group = RowGroup(
            # a change dx of the parameters makes the residuals r + J dx: J dx is fitted to -r
            values=-values[:, None],
            nuisance=jacobian[:, :nuisances],
            noise=hypotheses,
            row_folds=self.row_folds,
        )
        fitted_patterns = split_by_effect(jacobian[:, None, nuisances:], effects)

        def designs(variants):
            """Return for each variant the derivative of the N rows by its q parameters, (N, 1, q).

            `variants` are effects with values of their constants. The middle axis is the single
            axis of this problem.
            """
            new = [variant for variant in variants if variant not in fitted_patterns]
            patterns = fitted_patterns | self.patterns(new)
            return [patterns[variant] for variant in variants]

        evidence = Evidence(
            [group],
            # all hypotheses are equally probable
            log_prior=np.full(len(as_estimated), -np.log(len(as_estimated))),
            designs=designs,
            # the size of the noise is known, so that a small χ² does not make errors smaller
            least_scale=1.0,
            as_estimated_mask=as_estimated,
        )
        self._fits[effects] = Linearization(
            solution=solution,
            factors=factors,
            values=values,
            jacobian=jacobian,
            evidence=evidence,
            likelihood=likelihood,
            likeliest=likeliest,
        )
        return self._fits[effects]

    # every fit is stored: later tests are linearised at the fit of all poses with these effects
    refit = linearization

    def patterns(self, effects):
        """Return for each effect the derivative of the N rows by its q parameters, (N, 1, q).

        A pattern is this derivative. The result is a dict; its keys are the `effects`. A row is one
        component of a residual, and the middle axis is the single axis of this problem. The
        derivatives are taken at the fit without effects, and stored. The last rows belong to the
        prior.
        """
        new, first = [e for e in effects if e not in self._columns], len(self.joint_fit.names)
        factors = self.linearization(()).factors
        for start in range(0, len(new), BATCH_SIZE):
            batch = new[start : start + BATCH_SIZE]
            columns = np.concatenate([factors.columns(batch), self.prior(batch)[0][:, first:]])
            self._columns.update(split_by_effect(columns[:, None], batch))
        return {effect: self._columns[effect] for effect in effects}

    def nearest_linearization(self, effects):
        """Return the stored Linearization whose effects are the largest subset of `effects`.

        A Linearization is the fit of all poses with some effects. The rows are taken as linear in
        the effects that it lacks, by the derivatives in its Evidence. So a fit without some fold,
        which may choose other effects, needs no new fit of all poses.
        """
        subsets = [stored for stored in self._fits if set(stored) <= set(effects)]
        return self.linearization(max(subsets, key=len, default=()))

    def training_fit(self, base, held_out):
        """Return the TrainingFit: least squares of the rows without the folds in `held_out`.

        `held_out` is a set of numbers of folds. The rows are linearised at a fit of all poses that
        has the effects in `base`, or some of them.
        """
        return self.nearest_linearization(base).evidence.training_fit(held_out)

    def is_like_slow_noise(self, effect):
        """Return whether an `effect` may be taken for slow noise, a bool.

        This holds for every effect of time or of temperature, as these change slowly. For the
        detection limit of such an effect, the noise is estimated again from data with the effect
        (`noise_with`).
        """
        return effect.timed or "temperature" in effect.needs

    def noise_with(self, base, values):
        """Return the noise hypotheses for other values of the rows, a list of one Hypotheses.

        They serve detection limits: an effect is added to the residuals, and the noise is estimated
        again from the sum. `values`, (N,), is this sum; its sign is the one to which effects are
        fitted, the reverse of `Linearization.values`. There are two hypotheses: the noise as
        estimated, and the noise that is most likely for `values`. The list has one entry because
        all rows are one group. `base` has the effects in the model.
        """
        linearization = self.nearest_linearization(base)
        likelihood = linearization.likelihood
        likeliest = likelihood.maximise(-values, linearization.likeliest, ROUGH)
        squares = likelihood.prior_sizes**2, likeliest**2
        return [Hypotheses.of(map(likelihood.covariance, squares))]

    def most_changed_rows(self, search, base, trial):
        """Return the kind of residual that an added effect changes most, and the mask of its rows.

        The mask is (N,) of bool: all rows of this kind among the N rows of the problem. Changes are
        compared in standard deviations of the noise, over the training rows of `search`, a Search.
        `trial` is the Trial of the added effect, and `base` has the effects already in the model.
        """
        training_fit = search.training_fit(base)
        extended = (*base, trial.effect)
        change = training_fit.residuals(base, 0) - training_fit.residuals(extended, 0)
        square = change**2 / self.nearest_linearization(base).variance
        square[self.fold_of_row < 0] = 0.0
        kind = max(self.kinds, key=lambda kind: square[self.of_kind(kind)].sum())
        return kind, self.of_kind(kind)

    def covariance(self, effects):
        """Return the covariance of the p parameters of the fit of all poses, (p, p), nominal SI.

        The fit has the `effects`. A noise hypothesis is one covariance that the noise may have. The
        result is the mean over all hypotheses, weighted with their probability, of the sum of two
        terms. The first is the covariance by generalised least squares, times the reduced χ² if
        that is above one. The second is ``d dᵀ``, where d is the solution under this hypothesis
        minus the fit.

        The constants of the effects, such as time constants, are uncertain too: their logarithms
        count as further parameters with a prior standard deviation of one.
        """
        linearization = self.linearization(effects)
        evidence, jacobian = linearization.evidence, linearization.jacobian
        fit, p = evidence.training_fit().fit(effects, 0), jacobian.shape[1]
        of_constants = self._constant_derivatives(effects, linearization.solution.x)
        sum_of_squares, design = 0.0, np.column_stack([jacobian, *of_constants])
        # columns of length one: parameters have different units
        size = np.linalg.norm(design, axis=0)
        size[size == 0] = 1.0
        # the prior of the logarithms of constants, which come after the p parameters of the fit
        design, prior = design / size, np.diag(size**-2.0 * (np.arange(len(size)) >= p))
        probable, of_prior = fit.probability > 1e-6, self.rows[1] == ""
        for h in np.flatnonzero(probable):
            # the rows of the prior keep their variance, independent of the residuals of the poses
            scale = np.where(of_prior, 1.0, fit.scale[h])
            weighted = (design.T / scale) @ evidence.row_groups[0].noise.precision[h]
            inverse = np.linalg.inv(weighted @ design + prior / fit.scale[h])
            change = inverse @ (weighted @ linearization.values)
            square = inverse + np.outer(change, change)
            sum_of_squares = sum_of_squares + fit.probability[h] * square
        covariance = sum_of_squares / fit.probability[probable].sum() / np.outer(size, size)
        return covariance[:p, :p]

    def _constant_derivatives(self, effects, x):
        """Return the derivatives of the N rows by the logarithms of constants, a list of (N,).

        A constant is, for example, a time constant of one of the `effects`. The list has an entry
        for each effect with a constant that the search refines. The derivative is the difference
        quotient for a factor of 1.05 on the constant. `x`, (p,), are the parameters of the fit with
        these effects.
        """
        derivatives, first = [], len(self.joint_fit.names)
        parameters = split_by_effect(x[first:], (*self.nuisance_effects, *effects))
        for effect, values in parameters.items():
            # an effect without such a constant is the same after a change
            if effect.moved(2.0) != effect:
                variants = [effect.moved(f) for f in (1.05, 1 / 1.05)]
                up, down = (design[:, 0] @ values for design in self.patterns(variants).values())
                derivatives.append((up - down) / (2 * np.log(1.05)))
        return derivatives

    def fit(self, effects, held_out=frozenset()):
        """Return the Fit with some `effects` to the rows without the folds in `held_out`.

        By default no fold is held out. The fit is not iterated. It starts from the nearest fit of
        all poses, and adds the change of the parameters by linear least squares of the remaining
        rows. The covariance in the Fit is set to zero, since it is not used.
        """
        solution, first = self.nearest_linearization(effects).solution, len(self.joint_fit.names)
        all_effects = (*self.nuisance_effects, *effects)
        # the fit of all poses may lack an effect: its parameters then start at zero
        start = split_by_effect(solution.x[first:], solution.effects)
        start = [start.get(e, np.zeros(len(e.parameters))) for e in all_effects]
        training_fit = self.training_fit(effects, held_out)
        (nuisances,), coefficients = training_fit.solve(effects, 0)
        index, scale = training_fit.evidence.parameters_of(effects, 0)
        x = np.concatenate([solution.x[:first], *start])
        # the base model and the effects that other records showed are nuisance parameters
        x[: len(nuisances)] += nuisances
        x[len(nuisances) + index] += coefficients / scale
        return replace(solution, effects=all_effects, x=x, covariance=np.zeros((len(x),) * 2))


def split_by_effect(values, effects):
    """Return a dict that has the part of `values` that belongs to each effect.

    The last axis of `values`, (..., q), has the parameters of all `effects`, one effect after the
    other. It is cut into the parameters of each effect.
    """
    ends = pairwise(np.cumsum([0, *(len(e.parameters) for e in effects)]))
    return {e: values[..., i:j] for e, (i, j) in zip(effects, ends, strict=True)}


def interleaved_folds(count, folds):
    """Return the number of the fold of each of `count` poses, (count,) of int.

    Neighbours are in different folds, so that a held-out pose is predicted by the poses before and
    after it. If there are at most four `folds`, two neighbours share a fold. Otherwise too few
    neighbours would remain when this fold and a second one are held out.
    """
    folds = min(folds, count)
    return np.arange(count) // (1 if folds > 4 else 2) % folds
